//! The first bytes of an HDF5 file: is it one, was it closed cleanly, and putting it right after a crash.
//!
//! A recording that is killed leaves a mark that keeps the file from being opened, and an end-of-file address that
//! lies before data that had been written already; new data would overlap it. [`repair`] does what the tool `h5clear`
//! does, with one write of 48 bytes. Only versions 2 and 3 of the superblock carry a mark or a checksum; recordings
//! have version 3. Source: HDF5 file format specification 3.0, section II.A.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use swm_files::has_no_locks;

use crate::error::DataError;

const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";
/// With 8-byte addresses, the only size that the library writes on 64-bit systems.
const SIZE: usize = 48;
const FLAGS: usize = 11;
const WRITER: u8 = 1;
const SWMR_WRITER: u8 = 4;
const END_OF_FILE: usize = 28;
const CHECKSUM: usize = 44;

/// The fields of the superblock that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Superblock {
    version: u8,
    bytes: [u8; SIZE],
    file_length: u64,
}

/// Whether the file begins as an HDF5 file does. The signature stands at 0 or, behind a user's block, at a power of
/// two from 512 on.
pub(super) fn detect(path: &Path) -> bool {
    let found = || -> io::Result<bool> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        let mut at = 0;
        while at < length {
            let mut bytes = [0; SIGNATURE.len()];
            file.seek(SeekFrom::Start(at))?;
            if file.read_exact(&mut bytes).is_ok() && bytes == SIGNATURE {
                return Ok(true);
            }
            at = if at == 0 { 512 } else { at * 2 };
        }
        Ok(false)
    };
    path.is_file() && found().unwrap_or(false)
}

impl Superblock {
    /// Reads and checks it. The library retries a torn one with growing pauses, for minutes: this does not.
    pub(super) fn read(path: &Path) -> Result<Self, DataError> {
        let file = File::open(path).map_err(|source| DataError::io(path, "open", source))?;
        let file_length = file.metadata().map_err(|source| DataError::io(path, "open", source))?.len();
        let mut start = Vec::with_capacity(SIZE);
        let read = file.take(SIZE as u64).read_to_end(&mut start);
        read.map_err(|source| DataError::io(path, "read", source))?;
        // A text, for instance, was never longer.
        if !start.starts_with(&SIGNATURE[..SIGNATURE.len().min(start.len())]) && start.len() < SIZE {
            return Err(DataError::not_a_dataset(
                path,
                "it does not begin as HDF5 files do: it is another file",
            ));
        }
        let cut = || cut_short(path, file_length, None);
        let bytes: [u8; SIZE] = start.try_into().map_err(|_| cut())?;
        let version = bytes[SIGNATURE.len()];
        if bytes.starts_with(&SIGNATURE) && version >= 2 {
            // No recording has addresses of another size; the library reads them, and nothing of such a file is repaired here.
            if has_other_sizes(&bytes) {
                return Ok(Self { version: 0, bytes, file_length });
            }
            let stored = u32::from_le_bytes([bytes[44], bytes[45], bytes[46], bytes[47]]);
            if bytes[9..11] != [8, 8] || stored != lookup3(&bytes[..CHECKSUM]) {
                return Err(DataError::damaged(path, "the checksum of its first 48 bytes is wrong"));
            }
            return Ok(Self { version, bytes, file_length });
        }
        Ok(Self { version: 0, bytes, file_length })
    }

    /// Whether the file was not closed properly: a writer has it open, was killed, or ran out of space.
    pub(super) fn is_unclean(&self) -> bool {
        self.version >= 2 && (self.bytes[FLAGS] != 0 || self.end_of_file() > self.file_length)
    }

    /// Whether a writer is about to enter SWMR mode, or was killed while it was: nobody can open such a file.
    fn is_locked_out(&self) -> bool {
        self.version >= 2 && self.bytes[FLAGS] & SWMR_WRITER == 0 && self.bytes[FLAGS] & WRITER != 0
    }

    /// What is wrong with a file that cannot be read and ends before the end that its superblock knows; `None` where no byte is
    /// missing. Of files of version 0, which other programs write, too.
    pub(super) fn missing_end(&self, path: &Path) -> Option<DataError> {
        // Version, and bytes of an address.
        let is_first = self.bytes.starts_with(&SIGNATURE) && self.bytes[8] == 0 && self.bytes[13] == 8;
        let end = match self.version {
            0 if is_first => u64::from_le_bytes(self.bytes[40..48].try_into().ok()?),
            0 => return None,
            _ => self.end_of_file(),
        };
        (end > self.file_length).then(|| cut_short(path, self.file_length, Some(end)))
    }

    /// Where the file ends according to the superblock.
    fn end_of_file(&self) -> u64 {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(&self.bytes[END_OF_FILE..END_OF_FILE + 8]);
        u64::from_le_bytes(bytes)
    }
}

/// Whether addresses or lengths have 2 or 4 bytes, in a superblock of version 2 or 3 whose checksum is right.
fn has_other_sizes(bytes: &[u8; SIZE]) -> bool {
    let is_known = |size: u8| matches!(size, 2 | 4 | 8);
    let (addresses, lengths) = (bytes[9], bytes[10]);
    if !is_known(addresses) || !is_known(lengths) || [addresses, lengths] == [8, 8] {
        return false;
    }
    // Behind four addresses.
    let end = 12 + 4 * usize::from(addresses);
    bytes[end..].first_chunk().is_some_and(|stored| u32::from_le_bytes(*stored) == lookup3(&bytes[..end]))
}

/// The error of a file without its end.
fn cut_short(path: &Path, there: u64, wanted: Option<u64>) -> DataError {
    let of = wanted.map_or(String::new(), |wanted| format!(" of {wanted}"));
    DataError::damaged(
        path,
        format!(
            "it is cut short: {there}{of} bytes are there, as after a copy or a download that was interrupted, or on a full disk; \
             copy or record it again, as no repair brings back what is missing"
        ),
    )
}

/// How long to wait for a writer that is entering SWMR mode, which takes it milliseconds.
const PATIENCE: Duration = Duration::from_secs(2);

/// Makes a file readable whose writer was killed before it entered SWMR mode. It had not changed anything yet but
/// the mark. A living writer holds the library's lock on the file in that state, and is waited for.
pub(super) fn ensure_readable(path: &Path) -> Result<Superblock, DataError> {
    let start = Instant::now();
    loop {
        let superblock = Superblock::read(path)?;
        if !superblock.is_locked_out() {
            return Ok(superblock);
        }
        let failed = |source| DataError::io(path, "repair", source);
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        match file.try_lock() {
            // Under the lock the state may be another one than above.
            Ok(()) if Superblock::read(path)?.is_locked_out() => repair(path, 0)?,
            Ok(()) => {}
            Err(TryLockError::WouldBlock) if start.elapsed() < PATIENCE => {
                thread::sleep(Duration::from_millis(10));
            }
            Err(TryLockError::WouldBlock) => {
                return Err(DataError::Busy { path: path.to_owned(), holder: "another process".to_owned() });
            }
            // There the library takes no lock either: a writer that lives leaves this state in milliseconds.
            Err(TryLockError::Error(error)) if has_no_locks(&error) => {
                if start.elapsed() >= PATIENCE {
                    repair(path, 0)?;
                }
                thread::sleep(Duration::from_millis(10));
            }
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
    }
}

/// Takes the mark away, and moves the end of the file behind everything that may lie there: the end that the
/// superblock knows, the length of the file, and `chunks_end`, the end of the last chunk.
///
/// The caller must know that no writer lives. Killed at any moment, this leaves a file that can be repaired again.
pub(super) fn repair(path: &Path, chunks_end: u64) -> Result<(), DataError> {
    let superblock = Superblock::read(path)?;
    let failed = |source| DataError::io(path, "repair", source);
    let mut file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
    let end = superblock.file_length.max(superblock.end_of_file()).max(chunks_end);
    if end == superblock.end_of_file() && !superblock.is_unclean() {
        return Ok(());
    }
    let mut bytes = superblock.bytes;
    bytes[FLAGS] = 0;
    bytes[END_OF_FILE..END_OF_FILE + 8].copy_from_slice(&end.to_le_bytes());
    let checksum = lookup3(&bytes[..CHECKSUM]);
    bytes[CHECKSUM..].copy_from_slice(&checksum.to_le_bytes());
    file.set_len(end).map_err(failed)?;
    file.write_all(&bytes).map_err(failed)
}

/// Bob Jenkins' lookup3 (`hashlittle` with initial value 0), the checksum of HDF5 metadata:
/// <http://burtleburtle.net/bob/c/lookup3.c>.
pub(super) fn lookup3(key: &[u8]) -> u32 {
    let start = 0xdead_beef_u32.wrapping_add(key.len() as u32);
    let [mut a, mut b, mut c] = [start; 3];
    let word = |key: &[u8], index: usize| {
        let mut bytes = [0; 4];
        for (byte, &value) in bytes.iter_mut().zip(key.iter().skip(4 * index)) {
            *byte = value;
        }
        u32::from_le_bytes(bytes)
    };
    let mut rest = key;
    while rest.len() > 12 {
        [a, b, c] =
            [a.wrapping_add(word(rest, 0)), b.wrapping_add(word(rest, 1)), c.wrapping_add(word(rest, 2))];
        for rotations in [[4, 6, 8], [16, 19, 4]] {
            a = a.wrapping_sub(c) ^ c.rotate_left(rotations[0]);
            c = c.wrapping_add(b);
            b = b.wrapping_sub(a) ^ a.rotate_left(rotations[1]);
            a = a.wrapping_add(c);
            c = c.wrapping_sub(b) ^ b.rotate_left(rotations[2]);
            b = b.wrapping_add(a);
        }
        rest = &rest[12..];
    }
    if rest.is_empty() {
        return c;
    }
    [a, b, c] = [a.wrapping_add(word(rest, 0)), b.wrapping_add(word(rest, 1)), c.wrapping_add(word(rest, 2))];
    c = (c ^ b).wrapping_sub(b.rotate_left(14));
    a = (a ^ c).wrapping_sub(c.rotate_left(11));
    b = (b ^ a).wrapping_sub(a.rotate_left(25));
    c = (c ^ b).wrapping_sub(b.rotate_left(16));
    a = (a ^ c).wrapping_sub(c.rotate_left(4));
    b = (b ^ a).wrapping_sub(a.rotate_left(14));
    (c ^ b).wrapping_sub(b.rotate_left(24))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_lookup3() {
        // From the driver in lookup3.c.
        assert_eq!(lookup3(b""), 0xdead_beef);
        assert_eq!(lookup3(b"Four score and seven years ago"), 0x1777_0551);
    }

    #[test]
    fn short_files_are_cut_short_only_if_they_begin_as_hdf5_does() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.h5");
        let cases = [
            (&b"hello"[..], "it is another file"),
            (b"\x89HDF", "it is cut short"),
            (b"", "it is cut short"),
        ];
        for (content, reason) in cases {
            std::fs::write(&path, content).unwrap();
            let error = Superblock::read(&path).expect_err("no superblock").to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn other_files_are_not_taken_for_hdf5() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.h5");
        assert!(!detect(&path) && !detect(folder.path()));
        for content in [&b""[..], b"\x89HDF", &[7; 5000]] {
            std::fs::write(&path, content).unwrap();
            assert!(!detect(&path));
        }
        let mut shifted = vec![0; 1024];
        shifted.extend(SIGNATURE);
        std::fs::write(&path, shifted).unwrap();
        assert!(detect(&path));
    }
}
