//! Reading pieces of a file at given places, several at once where they lie together.

use std::fs::File;
use std::io;

use crate::formats::disk::read_exact_at;

/// A piece of the file in memory.
#[derive(Debug, Default)]
pub(super) struct Fetched {
    bytes: Vec<u8>,
    start: u64,
}

impl Fetched {
    /// Empties it: the file may have changed.
    pub(super) fn forget(&mut self) {
        self.bytes.clear();
    }

    /// Bytes `start..start + size` of the file; if they have to be fetched, `ahead` bytes are.
    pub(super) fn get(&mut self, file: &File, start: u64, size: u64, ahead: u64) -> io::Result<&[u8]> {
        let held = |fetched: &Self| {
            let from = start.checked_sub(fetched.start)?;
            (from + size <= fetched.bytes.len() as u64).then_some(from as usize..(from + size) as usize)
        };
        let range = match held(self) {
            Some(range) => range,
            None => {
                self.bytes.resize(ahead.max(size) as usize, 0);
                self.start = start;
                if let Err(error) = read_exact_at(file, &mut self.bytes, start) {
                    self.forget();
                    return Err(error);
                }
                0..size as usize
            }
        };
        Ok(&self.bytes[range])
    }
}
