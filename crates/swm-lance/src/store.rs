//! Where the files of a table are: a folder of this machine, or what a caller provides.

use std::fmt::Debug;
use std::fs::{self, File};
use std::io;
use std::path::PathBuf;

use crate::error::{Result, damaged};

/// The files below a table's folder. Paths are relative to it, and their parts are divided by `/`.
pub trait Store: Debug + Send + Sync {
    /// Names of the files in a folder, in any order.
    ///
    /// # Errors
    ///
    /// The folder is missing or cannot be listed.
    fn names(&self, folder: &str) -> io::Result<Vec<String>>;

    /// Opens a file.
    ///
    /// # Errors
    ///
    /// The file is missing or cannot be opened.
    fn open(&self, path: &str) -> io::Result<Box<dyn Bytes>>;
}

/// An open file.
pub trait Bytes: Debug + Send + Sync {
    /// Its size.
    fn length(&self) -> u64;

    /// Fills `out` with the bytes from `at` on.
    ///
    /// # Errors
    ///
    /// The file ends before, or cannot be read.
    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()>;
}

/// A folder of this machine.
#[derive(Debug)]
pub(crate) struct Folder(pub(crate) PathBuf);

impl Store for Folder {
    fn names(&self, folder: &str) -> io::Result<Vec<String>> {
        let names = fs::read_dir(self.0.join(folder))?.map(|entry| Ok(entry?.file_name().into_string().ok()));
        names.filter_map(io::Result::transpose).collect()
    }

    fn open(&self, path: &str) -> io::Result<Box<dyn Bytes>> {
        let path = self.0.join(path);
        // A pipe would wait for its writer.
        if !fs::metadata(&path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file"));
        }
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok(Box::new(Local { file, length }))
    }
}

#[derive(Debug)]
struct Local {
    file: File,
    length: u64,
}

impl Bytes for Local {
    fn length(&self) -> u64 {
        self.length
    }

    #[cfg(unix)]
    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, out, at)
    }

    #[cfg(windows)]
    fn read_exact_at(&self, mut out: &mut [u8], mut at: u64) -> io::Result<()> {
        while !out.is_empty() {
            match std::os::windows::fs::FileExt::seek_read(&self.file, out, at)? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                read => {
                    out = &mut out[read..];
                    at += read as u64;
                }
            }
        }
        Ok(())
    }
}

/// A part of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Extent {
    pub(crate) at: u64,
    pub(crate) size: u64,
}

impl Extent {
    /// A part of this part.
    pub(crate) fn part(self, from: u64, size: u64) -> Result<Self> {
        match from.checked_add(size).is_some_and(|end| end <= self.size) {
            true => Ok(Self { at: self.at + from, size }),
            false => {
                Err(damaged(format!("{size} bytes from {from} on are not within its {} bytes", self.size)))
            }
        }
    }
}

/// Reads a part of a file that is within it.
pub(crate) fn read(file: &dyn Bytes, Extent { at, size }: Extent) -> Result<Vec<u8>> {
    let length = file.length();
    if at.checked_add(size).is_none_or(|end| end > length) {
        return Err(damaged(format!(
            "it ends after {length} bytes, before the {size} bytes from {at} on; it may be cut"
        )));
    }
    let size = usize::try_from(size).map_err(|_| damaged(format!("{size} bytes are too many to read")))?;
    let mut bytes = vec![0; size];
    file.read_exact_at(&mut bytes, at)?;
    Ok(bytes)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A file in memory.
    #[derive(Debug)]
    pub(crate) struct Memory(pub(crate) Vec<u8>);

    impl Bytes for Memory {
        fn length(&self) -> u64 {
            self.0.len() as u64
        }

        fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
            out.copy_from_slice(&self.0[at as usize..][..out.len()]);
            Ok(())
        }
    }

    #[test]
    fn parts_beyond_the_end_are_errors() {
        let file = Memory(vec![1, 2, 3]);
        assert_eq!(read(&file, Extent { at: 1, size: 2 }).unwrap(), [2, 3]);
        for (at, size) in [(2, 2), (4, 0), (u64::MAX, 1), (0, u64::MAX)] {
            assert!(read(&file, Extent { at, size }).is_err());
        }
        let extent = Extent { at: 10, size: 5 };
        assert_eq!(extent.part(2, 3).unwrap(), Extent { at: 12, size: 3 });
        assert!(extent.part(3, 3).is_err() && extent.part(u64::MAX, 2).is_err());
    }
}
