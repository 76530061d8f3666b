//! Repair of what a kill cut in two. A write that crosses a page of memory is not one step for the system: a process that is killed amid
//! it leaves the new bytes of the first page before the old ones of the second, and the library refuses the block, as its checksum fits
//! neither. In SWMR mode blocks of a dataset only grow: what belongs to finished episodes is the same in both halves, so that a
//! new checksum makes the block valid again, and rows behind the last finished episode are cut by whoever continues the file.
//!
//! Blocks are found from the dataset's object header on: its continuations, and the extensible array of the addresses of its chunks. Source:
//! HDF5 file format specification 3.0, sections IV.A.1.b, IV.A.2.i and VII.C.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::Path;

use swm_files::{read_exact_at, write_all_at};

use super::ffi;
use super::reader::open_library;
use super::superblock::lookup3;
use crate::error::DataError;

const CHECKSUM: usize = 4;
/// No block is longer: one of a chunk index has up to a thousand elements, or a few thousand addresses.
const MAX_BLOCK: usize = 1 << 22;
/// An address that is none.
const UNDEFINED: u64 = u64::MAX;

/// Gives blocks of a file's datasets that have wrong checksums right ones; returns whether there were any.
///
/// The caller must know that no writer lives. Killed at any moment, this leaves a file that can be repaired again.
pub(super) fn repair(path: &Path) -> Result<bool, DataError> {
    // What cannot be opened at all is not repaired here: links and attributes are not changed while a file is recorded.
    let headers = ffi::addresses_of_members(&open_library(path, true)?);
    let failed = |source| DataError::io(path, "repair", source);
    let headers = headers.map_err(|error| failed(io::Error::other(error)))?;
    let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
    let found = blocks(&file, headers).map_err(failed)?;
    let mut is_repaired = false;
    for &Found { at, len, checksum, .. } in found.iter().filter(|block| block.stored != block.checksum) {
        write_all_at(&file, &checksum.to_le_bytes(), at + (len - CHECKSUM) as u64).map_err(failed)?;
        is_repaired = true;
    }
    Ok(is_repaired)
}

/// The blocks of the datasets whose headers lie at these addresses.
fn blocks(file: &File, headers: Vec<u64>) -> io::Result<Vec<Found>> {
    let mut walk = Walk { file, unread: file.metadata()?.len(), found: Vec::new() };
    headers.into_iter().try_for_each(|at| walk.object(at))?;
    Ok(walk.found)
}

/// A block that ends with a checksum.
struct Found {
    at: u64,
    len: usize,
    stored: u32,
    checksum: u32,
}

/// The blocks of datasets. What does not look like a block is left alone, with all that lies behind it.
struct Walk<'a> {
    file: &'a File,
    /// Blocks do not overlap: no more bytes than these can be blocks, which ends a walk in a circle.
    unread: u64,
    found: Vec<Found>,
}

impl Walk<'_> {
    /// Bytes of the file, if it has them.
    fn bytes(&self, at: u64, len: usize) -> io::Result<Option<Vec<u8>>> {
        if at == UNDEFINED || len > MAX_BLOCK {
            return Ok(None);
        }
        let mut bytes = vec![0; len];
        match read_exact_at(self.file, &mut bytes, at) {
            Ok(()) => Ok(Some(bytes)),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// A block that begins with `begin` and ends with a checksum, which is noted.
    fn block(&mut self, at: u64, len: usize, begin: &[u8]) -> io::Result<Option<Vec<u8>>> {
        let Some(unread) = self.unread.checked_sub(len as u64) else { return Ok(None) };
        let read = self.bytes(at, len)?;
        if read.is_some() {
            self.unread = unread;
        }
        let bytes = read.filter(|bytes| bytes.starts_with(begin));
        if let Some((content, stored)) = bytes.as_deref().and_then(<[u8]>::split_last_chunk::<CHECKSUM>) {
            let stored = u32::from_le_bytes(*stored);
            self.found.push(Found { at, len, stored, checksum: lookup3(content) });
        }
        Ok(bytes)
    }

    /// The header of an object, version 2.
    fn object(&mut self, at: u64) -> io::Result<()> {
        let Some(&[b'O', b'H', b'D', b'R', 2, flags]) = self.bytes(at, 6)?.as_deref() else { return Ok(()) };
        let times = if flags & 0x20 == 0 { 0 } else { 16 };
        let phases = if flags & 0x10 == 0 { 0 } else { 4 };
        let (begin, width) = (6 + times + phases, 1 << (flags & 3));
        let Some(size) = self.bytes(at + begin as u64, width)? else { return Ok(()) };
        let (begin, size) = (begin + width, number(&size) as usize);
        let whole = begin.saturating_add(size).saturating_add(CHECKSUM);
        let Some(header) = self.block(at, whole, b"OHDR")? else { return Ok(()) };
        let mut messages = vec![header[begin..begin + size].to_vec()];
        while let Some(part) = messages.pop() {
            for (kind, message) in split(&part, flags & 4 != 0) {
                match (kind, message) {
                    (0x10, _) if message.len() >= 16 => {
                        let (at, len) = (number(&message[..8]), number(&message[8..16]) as usize);
                        if let Some(block) = self.block(at, len, b"OCHK")?
                            && block.len() > 8
                        {
                            messages.push(block[4..block.len() - CHECKSUM].to_vec());
                        }
                    }
                    // A chunked layout whose index is an extensible array.
                    (0x08, &[4 | 5, 2, _, dimensions, bytes, ref rest @ ..]) => {
                        let rest =
                            rest.get(usize::from(dimensions) * usize::from(bytes)..).unwrap_or_default();
                        if let &[4, _, _, _, _, _, ref address @ ..] = rest
                            && address.len() >= 8
                        {
                            self.array(number(&address[..8]))?;
                        }
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// An extensible array: header, index block, and the blocks of elements below.
    fn array(&mut self, at: u64) -> io::Result<()> {
        let Some(header) = self.block(at, 72, b"EAHD\0")? else { return Ok(()) };
        let [_, element, bits, in_index, least, pointers, page_bits] = header[5..12] else { return Ok(()) };
        if bits > 64 || page_bits > 20 || !least.is_power_of_two() || !pointers.is_power_of_two() {
            return Ok(());
        }
        let Some(above) = (1 + u32::from(bits)).checked_sub(least.trailing_zeros()) else { return Ok(()) };
        let shape = Shape {
            prefix: 14 + usize::from(bits).div_ceil(8),
            element: usize::from(element),
            least: usize::from(least),
            page: 1 << page_bits,
        };
        // Super blocks whose data blocks the index block names itself, and the rest.
        let direct = 2 * pointers.trailing_zeros();
        let (direct_blocks, supers) =
            (2 * (usize::from(pointers) - 1), above.saturating_sub(direct) as usize);
        let first = 14 + usize::from(in_index) * shape.element;
        let len = first + 8 * (direct_blocks + supers) + CHECKSUM;
        let Some(index) = self.block(number(&header[60..68]), len, b"EAIB\0")? else { return Ok(()) };
        let mut addresses = index[first..len - CHECKSUM].chunks_exact(8).map(number);
        for level in 0..direct {
            for at in addresses.by_ref().take(1 << (level / 2)) {
                self.elements(&shape, at, level, |_| true)?;
            }
        }
        for (level, at) in (direct..above).zip(addresses) {
            self.super_block(&shape, at, level)?;
        }
        Ok(())
    }

    /// A block of addresses of data blocks, with a bit for each of their pages.
    fn super_block(&mut self, shape: &Shape, at: u64, level: u32) -> io::Result<()> {
        let Some(blocks) = 1_usize.checked_shl(level / 2) else { return Ok(()) };
        let pages = shape.pages(level);
        let first = shape.prefix + blocks.saturating_mul(pages.div_ceil(8));
        let len = first.saturating_add(blocks.saturating_mul(8)).saturating_add(CHECKSUM);
        let Some(block) = self.block(at, len, b"EASB\0")? else { return Ok(()) };
        let bits = &block[shape.prefix..first];
        for (index, at) in block[first..len - CHECKSUM].chunks_exact(8).map(number).enumerate() {
            let is_there = |page: usize| {
                let bit = index * pages + page;
                bits.get(bit / 8).is_some_and(|byte| byte & (0x80 >> (bit % 8)) != 0)
            };
            self.elements(shape, at, level, is_there)?;
        }
        Ok(())
    }

    /// A data block: its elements, or pages of them.
    fn elements(
        &mut self,
        shape: &Shape,
        at: u64,
        level: u32,
        is_there: impl Fn(usize) -> bool,
    ) -> io::Result<()> {
        let pages = shape.pages(level);
        if pages == 0 {
            let len = shape.prefix + shape.elements(level) * shape.element + CHECKSUM;
            return self.block(at, len, b"EADB\0").map(drop);
        }
        let head = shape.prefix + CHECKSUM;
        if self.block(at, head, b"EADB\0")?.is_some() {
            let len = shape.page * shape.element + CHECKSUM;
            for page in (0..pages).filter(|&page| is_there(page)) {
                self.block(at + (head + page * len) as u64, len, b"")?;
            }
        }
        Ok(())
    }
}

/// What is the same for all blocks of an extensible array.
struct Shape {
    /// Bytes before the content: signature, version, kind, address of the header, index of the first element.
    prefix: usize,
    /// Bytes of an element.
    element: usize,
    /// Elements of the first data blocks.
    least: usize,
    /// Elements of a page.
    page: usize,
}

impl Shape {
    /// Elements of each data block of a super block.
    fn elements(&self, level: u32) -> usize {
        1_usize.checked_shl(level.div_ceil(2)).map_or(usize::MAX, |times| times.saturating_mul(self.least))
    }

    /// Pages of each of these data blocks; 0: they are not divided.
    fn pages(&self, level: u32) -> usize {
        let elements = self.elements(level);
        if elements > self.page { elements / self.page } else { 0 }
    }
}

/// Types and contents of the messages of a header.
fn split(mut part: &[u8], has_order: bool) -> Vec<(u8, &[u8])> {
    let mut messages = Vec::new();
    let head = if has_order { 6 } else { 4 };
    while let Some((begin, rest)) = part.split_at_checked(head) {
        let Some((message, rest)) = rest.split_at_checked(number(&begin[1..3]) as usize) else { break };
        messages.push((begin[0], message));
        part = rest;
    }
    messages
}

/// A little-endian number.
fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use hdf5_metno as h5;
    use hdf5_metno::file::LibraryVersion;
    use hdf5_metno::{Extent, SimpleExtents};

    use super::*;

    /// Rows, each in a chunk of its own, so many that data blocks have pages.
    const ROWS: usize = 140_000;

    /// The file of a writer that was killed: a copy of one that is open.
    fn unclean(folder: &Path) -> std::path::PathBuf {
        let (open, copy) = (folder.join("open.h5"), folder.join("a.h5"));
        let mut builder = h5::File::with_options();
        builder.fapl().libver_bounds(LibraryVersion::V110, LibraryVersion::V110);
        let file = builder.create(&open).unwrap();
        for (name, deflate) in [("plain", false), ("filtered", true)] {
            let extents = SimpleExtents::new([Extent::resizable(ROWS)]);
            let dataset = file.new_dataset::<u8>().shape(extents).chunk(1);
            let dataset = if deflate { dataset.deflate(1) } else { dataset };
            let values: Vec<u8> = (0..ROWS).map(|row| (row % 251) as u8).collect();
            dataset.create(name).unwrap().write_raw(&values).unwrap();
        }
        file.start_swmr().unwrap();
        file.flush().unwrap();
        fs::copy(&open, &copy).unwrap();
        copy
    }

    fn blocks_of(path: &Path) -> Vec<Found> {
        let headers = ffi::addresses_of_members(&open_library(path, true).unwrap()).unwrap();
        blocks(&File::open(path).unwrap(), headers).unwrap()
    }

    #[test]
    fn a_walk_in_a_circle_ends() {
        // A header of 31 bytes, and a continuation of 28 behind it that is its own.
        let message = [&[0x10, 16, 0, 0][..], &31_u64.to_le_bytes(), &28_u64.to_le_bytes()].concat();
        let header = [&b"OHDR\x02\0\x14"[..], &message, &[0; CHECKSUM]].concat();
        assert_eq!(header.len(), 31);
        let bytes = [&header[..], b"OCHK", &message, &[0; 1000]].concat();
        let mut file = tempfile::tempfile().unwrap();
        io::Write::write_all(&mut file, &bytes).unwrap();
        let found = blocks(&file, vec![0]).unwrap();
        assert!((2..50).contains(&found.len()), "{} blocks", found.len());
    }

    #[test]
    fn every_block_with_a_wrong_checksum_is_repaired() {
        let folder = tempfile::tempdir().unwrap();
        let path = unclean(folder.path());
        let bytes = fs::read(&path).unwrap();
        let found = blocks_of(&path);
        assert!(found.iter().all(|block| block.stored == block.checksum), "a block is none");
        let begins = |block: &&Found, begin: &[u8]| bytes[block.at as usize..].starts_with(begin);
        for (begin, least) in [(b"OHDR", 2), (b"EAHD", 2), (b"EAIB", 2), (b"EASB", 2), (b"EADB", 100)] {
            let there = found.iter().filter(|block| begins(block, begin)).count();
            assert!(there >= least, "{there} of {}", String::from_utf8_lossy(begin));
        }
        let pages = found.iter().filter(|block| !begins(block, b"EA") && !begins(block, b"O")).count();
        assert!(pages > 4, "{pages} pages");
        assert!(!repair(&path).unwrap());

        let mut torn = bytes.clone();
        for block in &found {
            torn[block.at as usize + block.len - 1] ^= 0x55;
        }
        fs::write(&path, &torn).unwrap();
        let read = |path: &Path| open_library(path, true).unwrap().dataset("plain")?.read_raw::<u8>();
        read(&path).unwrap_err();
        assert!(repair(&path).unwrap());
        assert!(fs::read(&path).unwrap() == bytes);
        assert_eq!(read(&path).unwrap().len(), ROWS);
    }
}
