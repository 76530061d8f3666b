//! Zip archives of `torch.save`, as far as needed to look at their pickle, and to change a byte of it in a copy.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use tempfile::NamedTempFile;

/// The longest pickle that is looked at: as the reader of tensors allows.
const LONGEST: u64 = 100 << 20;
/// The longest end of an archive: its record, and a comment.
const END: u64 = 22 + 0xffff;

/// What an entry of the list begins with.
const ENTRY: &[u8; 4] = b"PK\x01\x02";

/// The list of an archive's entries.
struct Directory {
    /// Where it begins.
    start: u64,
    /// How many entries it has.
    count: u64,
    /// Its bytes.
    len: u64,
    /// Where the record of it begins.
    end: u64,
}

/// Where an archive's pickle is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pickle {
    start: u64,
    len: u64,
    /// Where the archive keeps its checksum.
    checksum: u64,
}

/// Whether an archive has an end: it is cut off otherwise.
pub(crate) fn has_end(file: &mut File) -> io::Result<bool> {
    Ok(directory(file)?.is_some())
}

/// A copy whose list of entries ends where its last record begins; `None`: there is no need.
///
/// PyTorch puts the records of large archives between both, also in small ones. A reader that counts the length of the list back from the last
/// record takes such an archive for damaged where an entry of the list begins just there.
pub(crate) fn copy_abutting(file: &mut File) -> io::Result<Option<NamedTempFile>> {
    let Some(Directory { start, len, end, .. }) = directory(file)? else { return Ok(None) };
    let Some(counted) = end.checked_sub(len).filter(|counted| *counted > start) else { return Ok(None) };
    let mut mark = [0; 4];
    file.seek(SeekFrom::Start(counted))?;
    file.read_exact(&mut mark)?;
    if mark != *ENTRY {
        return Ok(None);
    }
    let mut out = NamedTempFile::new()?;
    file.seek(SeekFrom::Start(0))?;
    io::copy(&mut (&mut *file).take(start + len), &mut out)?;
    file.seek(SeekFrom::Start(end))?;
    io::copy(file, &mut out)?;
    Ok(Some(out))
}

/// The entry `data.pkl` of an archive, where it is stored as it is.
pub(crate) fn find_pickle(file: &mut File) -> io::Result<Option<Pickle>> {
    let Some(Directory { start: mut at, count, .. }) = directory(file)? else { return Ok(None) };
    for _ in 0..count {
        let mut head = [0; 46];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut head)?;
        let two = |place: usize| u64::from(u16::from_le_bytes([head[place], head[place + 1]]));
        let four = |place: usize| two(place) | two(place + 2) << 16;
        if head[..4] != *ENTRY {
            return Ok(None);
        }
        let mut name = vec![0; two(28) as usize];
        file.read_exact(&mut name)?;
        let is_pickle = name == b"data.pkl" || name.ends_with(b"/data.pkl");
        let (method, len, local) = (two(10), four(24), four(42));
        if is_pickle && method == 0 && len <= LONGEST && local != 0xffff_ffff {
            let mut local_head = [0; 30];
            file.seek(SeekFrom::Start(local))?;
            file.read_exact(&mut local_head)?;
            let skipped =
                |place: usize| u64::from(u16::from_le_bytes([local_head[place], local_head[place + 1]]));
            let start = local + 30 + skipped(26) + skipped(28);
            return Ok(Some(Pickle { start, len, checksum: at + 16 }));
        }
        at += 46 + two(28) + two(30) + two(32);
    }
    Ok(None)
}

/// The list of entries, as the last record has it, or that of large archives.
fn directory(file: &mut File) -> io::Result<Option<Directory>> {
    let len = file.metadata()?.len();
    let mut end = vec![0; len.min(END) as usize];
    file.seek(SeekFrom::Start(len - end.len() as u64))?;
    file.read_exact(&mut end)?;
    let Some(record) = end.windows(22).rposition(|bytes| bytes.starts_with(b"PK\x05\x06")) else {
        return Ok(None);
    };
    let little = |bytes: &[u8], place: usize, count: usize| {
        bytes[place..place + count].iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
    };
    let of = |place, bytes| little(&end[record..], place, bytes);
    let (count, bytes, start) = (of(10, 2), of(12, 4), of(16, 4));
    let begins = len - end.len() as u64;
    if start != 0xffff_ffff && count != 0xffff {
        return Ok(Some(Directory { start, count, len: bytes, end: begins + record as u64 }));
    }
    // The record of large archives, whose place stands right before this one.
    let Some(locator) = record.checked_sub(20).filter(|at| end[*at..].starts_with(b"PK\x06\x07")) else {
        return Ok(None);
    };
    let mut large = [0; 56];
    let place = little(&end[locator..], 8, 8);
    file.seek(SeekFrom::Start(place))?;
    file.read_exact(&mut large)?;
    let of = |place| little(&large, place, 8);
    let found = Directory { start: of(48), count: of(32), len: of(40), end: place };
    Ok(large.starts_with(b"PK\x06\x06").then_some(found))
}

impl Pickle {
    /// Its bytes.
    pub(crate) fn read(&self, file: &mut File) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(self.start))?;
        file.take(self.len).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Copies the archive at `from` with these bytes for its pickle, which are as many.
    pub(crate) fn copy_with(&self, from: &Path, to: &mut File, bytes: &[u8]) -> io::Result<()> {
        io::copy(&mut File::open(from)?, to)?;
        to.seek(SeekFrom::Start(self.start))?;
        to.write_all(bytes)?;
        to.seek(SeekFrom::Start(self.checksum))?;
        to.write_all(&checksum(bytes).to_le_bytes())
    }
}

/// CRC-32 of zip archives.
fn checksum(bytes: &[u8]) -> u32 {
    let mut sum = Checksum::default();
    sum.add(bytes);
    sum.value()
}

/// The table of CRC-32, one entry per byte.
const TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut value, mut bit) = (byte as u32, 0);
        while bit < 8 {
            value = value >> 1 ^ if value & 1 == 1 { 0xedb8_8320 } else { 0 };
            bit += 1;
        }
        table[byte] = value;
        byte += 1;
    }
    table
};

/// CRC-32 of what has been added.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Checksum(u32);

impl Checksum {
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        self.0 =
            !bytes.iter().fold(!self.0, |sum: u32, byte| sum >> 8 ^ TABLE[usize::from(sum as u8 ^ byte)]);
    }

    pub(crate) fn value(self) -> u32 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_zip() {
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
    }
}
