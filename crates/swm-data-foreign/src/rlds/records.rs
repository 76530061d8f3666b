//! Files of TFRecord: each record behind its length, both with a checksum.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_data::dataset::CHANGED;
use swm_data::error::{At as _, Result, invalid};
use swm_files::{ReadAt as _, open_regular};

use crate::zarr::crc32c;

/// The length of a record and its checksum, and the checksum behind the record.
const HEAD: u64 = 12;
const TAIL: u64 = 4;
/// A record is never longer: it is one episode, in memory.
const MAX_RECORD: u64 = 1 << 30;

/// Where a record is.
#[derive(Clone, Debug)]
pub(super) struct Record {
    file: Arc<Shard>,
    at: u64,
    length: u64,
}

#[derive(Debug)]
struct Shard {
    file: File,
    path: PathBuf,
}

/// A checksum as it is stored: turned, so that one over data with checksums is none of their sums.
fn masked(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

impl Record {
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Fills `out` with its bytes from `at` on, which are not compared with their checksum.
    pub(super) fn part(&self, out: &mut [u8], at: u64) -> Result<()> {
        Ok(self.file.file.read_exact_at(out, self.at + at)?)
    }

    /// Its bytes; they are compared with their checksum.
    pub(super) fn bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = vec![0; (self.length + TAIL) as usize];
        self.file.file.read_exact_at(&mut bytes, self.at)?;
        let sum = bytes.split_off(self.length as usize);
        match sum == masked(&bytes).to_le_bytes() {
            true => Ok(bytes),
            false => {
                let place = format!("{}, byte {}", self.file.path.display(), self.at);
                Err(invalid(CHANGED).at(place))
            }
        }
    }
}

/// The records of a file.
pub(super) fn records(path: &Path) -> Result<Vec<Record>> {
    all(path).at(path.display())
}

fn all(path: &Path) -> Result<Vec<Record>> {
    let shard = Arc::new(Shard { file: open_regular(path)?, path: path.to_owned() });
    let (end, mut at, mut found) = (shard.file.length()?, 0, Vec::new());
    while at < end {
        let mut head = [0; HEAD as usize];
        if end - at < HEAD + TAIL {
            return Err(invalid(format!("it is cut short: {} bytes are left at byte {at}", end - at)));
        }
        shard.file.read_exact_at(&mut head, at)?;
        let [a, b, c, d, e, f, g, h, sum @ ..] = head;
        let bytes = [a, b, c, d, e, f, g, h];
        if sum != masked(&bytes).to_le_bytes() {
            return Err(invalid(format!(
                "the length of the record at byte {at} was changed after it was written"
            )));
        }
        let length = u64::from_le_bytes(bytes);
        if length > MAX_RECORD || length > end - at - HEAD - TAIL {
            return Err(invalid(format!(
                "it is cut short: the record at byte {at} claims {length} bytes of {end}"
            )));
        }
        found.push(Record { file: shard.clone(), at: at + HEAD, length });
        at += HEAD + length + TAIL;
    }
    Ok(found)
}
