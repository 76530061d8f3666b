//! How an MCAP file ends: as one that was finished, whose footer and summary must then agree with the records before
//! them, or as one whose recording was cut off, behind whose last episode no other may have been committed.

use std::collections::BTreeMap;
use std::ops::Range;

use crc32fast::Hasher;
use swm_files::{ReadAt, read_exact_at};

use super::index::EPISODE;
use super::records::{FOOTER, HEAD, MAGIC, METADATA, Reader, STATISTICS};
use crate::error::{Result, invalid};

/// Bytes of a footer with its head, and of the magic behind it.
const FOOTER_BYTES: u64 = HEAD + 20;
const END_BYTES: u64 = FOOTER_BYTES + MAGIC.len() as u64;
/// Bytes that are read at once.
const PIECE: u64 = 1 << 20;

/// The record that ends the data.
#[derive(Clone, Copy, Debug)]
pub(super) struct DataEnd {
    pub(super) at: u64,
    pub(super) end: u64,
    /// Of all bytes before `at`; 0 stands for "no checksum".
    pub(super) checksum: u32,
}

/// The last record of a finished file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footer {
    at: u64,
    /// Where the summary begins; 0: there is none.
    summary: u64,
    /// Of the summary, and of the footer up to here; 0 stands for "no checksum".
    checksum: u32,
}

impl Footer {
    /// Reads it; `None` if the file was not finished.
    pub(super) fn read(file: &dyn ReadAt, length: u64) -> Result<Option<Self>> {
        let Some(at) = length.checked_sub(END_BYTES).filter(|&at| at >= MAGIC.len() as u64) else {
            return Ok(None);
        };
        let mut bytes = [0; END_BYTES as usize];
        read_exact_at(file, &mut bytes, at)?;
        if !bytes.ends_with(MAGIC) {
            return Ok(None);
        }
        let mut reader = Reader(&bytes[1..]);
        if bytes[0] != FOOTER || reader.u64()? != FOOTER_BYTES - HEAD {
            return Err(invalid("it was finished, but its footer is damaged"));
        }
        let (summary, _) = (reader.u64()?, reader.u64()?);
        Ok(Some(Self { at, summary, checksum: reader.u32()? }))
    }

    /// Whether the summary, or the footer if there is none, begins where the data ends.
    pub(super) fn follows(&self, data: &DataEnd) -> bool {
        let start = if self.summary == 0 { self.at } else { self.summary };
        start == data.end && start <= self.at
    }

    /// Compares the checksum of the summary, and its counts of metadata records and chunks with those that were `found`.
    pub(super) fn check(&self, file: &dyn ReadAt, length: u64, found: [usize; 2]) -> Result<()> {
        let start = if self.summary == 0 { self.at } else { self.summary };
        // The footer up to its checksum.
        let end = length - MAGIC.len() as u64 - 4;
        if self.checksum != 0 && checksum(file, start..end)?.finalize() != self.checksum {
            return Err(invalid("the checksum of its summary is wrong, it was changed after it was written"));
        }
        let mut at = start;
        while at + HEAD <= self.at {
            let mut head = [0; HEAD as usize];
            read_exact_at(file, &mut head, at)?;
            let size = Reader(&head[1..]).u64()?;
            let Some(next) = size.checked_add(at + HEAD).filter(|&next| next <= self.at) else {
                return Err(invalid("a record of its summary reaches behind it"));
            };
            if head[0] == STATISTICS {
                // Messages, schemas, channels, attachments; metadata records, chunks.
                let mut counts = [0; 26];
                read_exact_at(file, &mut counts, at + HEAD)?;
                let mut reader = Reader(&counts[18..]);
                let counted = [reader.u32()? as usize, reader.u32()? as usize];
                if counted != found {
                    let [[metadata, chunks], [there, chunks_there]] = [counted, found];
                    return Err(invalid(format!(
                        "its summary counts {metadata} metadata records and {chunks} chunks, but {there} and {chunks_there} \
                         are there"
                    )));
                }
            }
            at = next;
        }
        Ok(())
    }
}

/// The checksum of a range of bytes.
pub(super) fn checksum(file: &dyn ReadAt, range: Range<u64>) -> Result<Hasher> {
    let (mut hasher, mut at) = (Hasher::new(), range.start);
    let mut bytes = Vec::new();
    while at < range.end {
        bytes.resize(PIECE.min(range.end - at) as usize, 0);
        read_exact_at(file, &mut bytes, at)?;
        hasher.update(&bytes);
        at += bytes.len() as u64;
    }
    Ok(hasher)
}

/// Looks through what lies behind the last committed episode of a file that was not finished, `rest`: if one from
/// number `next` on was committed there, a record before it is damaged, and nothing may be cut.
pub(super) fn check_cut(file: &dyn ReadAt, rest: Range<u64>, next: u64) -> Result<()> {
    let needle = [&(EPISODE.len() as u32).to_le_bytes(), EPISODE.as_bytes()].concat();
    let (mut at, mut bytes) = (rest.start, Vec::new());
    while at + (needle.len() as u64) < rest.end {
        bytes.resize(PIECE.min(rest.end - at) as usize, 0);
        read_exact_at(file, &mut bytes, at)?;
        for (offset, _) in bytes.windows(needle.len()).enumerate().filter(|(_, window)| *window == needle) {
            let name = at + offset as u64;
            let index = name.checked_sub(HEAD).and_then(|record| committed(file, record, rest.end));
            if let Some(index) = index.filter(|&index| index >= next) {
                return Err(invalid(format!(
                    "a record behind its first {next} episodes, from byte {} on, is damaged: episode {index} was committed at \
                     byte {name}; nothing of it is cut, get the file again from where it came",
                    rest.start
                )));
            }
        }
        // The next piece begins with what may be the start of a name.
        at += (bytes.len() - needle.len() + 1) as u64;
    }
    Ok(())
}

/// The number of the episode that a record commits, if one begins there.
fn committed(file: &dyn ReadAt, at: u64, length: u64) -> Option<u64> {
    let mut head = [0; HEAD as usize];
    read_exact_at(file, &mut head, at).ok()?;
    let size = Reader(&head[1..]).u64().ok()?;
    if head[0] != METADATA || size > PIECE || at + HEAD + size > length {
        return None;
    }
    let mut bytes = vec![0; size as usize];
    read_exact_at(file, &mut bytes, at + HEAD).ok()?;
    let mut reader = Reader(&bytes);
    reader.text().ok()?;
    let values: BTreeMap<&str, &str> = reader.map().ok()?;
    values.get("index")?.parse().ok()
}
