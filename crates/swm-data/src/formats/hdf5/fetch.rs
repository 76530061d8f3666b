//! Reading pieces of a file at given places, several at once where they lie together.

use std::fs::File;
use std::io;

use swm_files::read_exact_at;

/// A piece of the file in memory.
#[derive(Debug, Default)]
pub(super) struct Fetched {
    /// Never shrinks: clearing it for every fetch would cost as much as some of them.
    bytes: Vec<u8>,
    /// How many of them are of the file, from `start` on.
    len: usize,
    start: u64,
}

impl Fetched {
    /// Empties it: the file may have changed.
    pub(super) fn forget(&mut self) {
        self.len = 0;
    }

    /// Bytes `start..start + size` of the file; if they have to be fetched, `ahead` bytes are.
    pub(super) fn get(&mut self, file: &File, start: u64, size: u64, ahead: u64) -> io::Result<&[u8]> {
        let held = |fetched: &Self| {
            let from = start.checked_sub(fetched.start)?;
            (from + size <= fetched.len as u64).then_some(from as usize..(from + size) as usize)
        };
        let range = match held(self) {
            Some(range) => range,
            None => {
                self.forget();
                let len = ahead.max(size) as usize;
                if self.bytes.len() < len {
                    self.bytes.resize(len, 0);
                }
                read_exact_at(file, &mut self.bytes[..len], start)?;
                (self.start, self.len) = (start, len);
                0..size as usize
            }
        };
        Ok(&self.bytes[range])
    }
}
