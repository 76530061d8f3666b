//! Files, and objects that lie elsewhere, that are read by position.

use std::fs::File;
use std::io::{self, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use crate::open::open_regular;

/// What is read by position.
pub trait ReadAt: std::fmt::Debug + Send + Sync {
    /// The number of its bytes.
    ///
    /// # Errors
    ///
    /// The system does not tell.
    fn length(&self) -> io::Result<u64>;

    /// Fills `out` with the bytes from `at` on, without moving a cursor: handles share what is open.
    ///
    /// # Errors
    ///
    /// It ends before, or cannot be read.
    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()>;
}

impl ReadAt for File {
    fn length(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        read_file_at(self, out, at)
    }
}

/// An open file, or an object that lies elsewhere.
#[derive(Clone, Debug)]
pub struct Readable(Source);

#[derive(Clone, Debug)]
enum Source {
    File(Arc<File>),
    #[cfg(feature = "remote")]
    Object(Arc<crate::remote::Object>),
}

impl Readable {
    /// Opens a regular file, or what lies at an address.
    ///
    /// # Errors
    ///
    /// It is a folder or something else, or cannot be opened.
    pub fn open(path: &Path) -> io::Result<Self> {
        #[cfg(feature = "remote")]
        if crate::remote::is_remote(path) {
            return match crate::remote::Found::at(path)? {
                crate::remote::Found::Object(object) => Ok(Self(Source::Object(object))),
                crate::remote::Found::Folder(_) => {
                    Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"))
                }
            };
        }
        Ok(open_regular(path)?.into())
    }
}

impl From<File> for Readable {
    fn from(file: File) -> Self {
        Self(Source::File(Arc::new(file)))
    }
}

impl ReadAt for Readable {
    fn length(&self) -> io::Result<u64> {
        match &self.0 {
            Source::File(file) => file.length(),
            #[cfg(feature = "remote")]
            Source::Object(object) => Ok(object.length()),
        }
    }

    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        match &self.0 {
            Source::File(file) => file.read_exact_at(out, at),
            #[cfg(feature = "remote")]
            Source::Object(object) => object.read_exact_at(out, at),
        }
    }
}

/// Fills `out` with the bytes from `at` on.
///
/// # Errors
///
/// As of [`ReadAt::read_exact_at`].
pub fn read_exact_at(file: &dyn ReadAt, out: &mut [u8], at: u64) -> io::Result<()> {
    file.read_exact_at(out, at)
}

/// A cursor over what is read by position. Clones do not move each other's.
#[derive(Clone, Debug)]
pub struct Cursor {
    file: Readable,
    length: u64,
    at: u64,
}

impl Cursor {
    /// A cursor at the beginning.
    ///
    /// # Errors
    ///
    /// As of [`ReadAt::length`].
    pub fn new(file: Readable) -> io::Result<Self> {
        let length = file.length()?;
        Ok(Self { file, length, at: 0 })
    }

    /// The number of all bytes.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.length
    }
}

impl io::Read for Cursor {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let left = self.length.saturating_sub(self.at);
        let count = usize::try_from(left).unwrap_or(usize::MAX).min(out.len());
        read_exact_at(&self.file, &mut out[..count], self.at)?;
        self.at += count as u64;
        Ok(count)
    }
}

impl io::Seek for Cursor {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let place = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.length.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = place.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.at)
    }
}

#[cfg(unix)]
fn read_file_at(file: &File, out: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, out, at)
}

#[cfg(windows)]
fn read_file_at(file: &File, mut out: &mut [u8], mut at: u64) -> io::Result<()> {
    while !out.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, out, at)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            read => {
                out = &mut out[read..];
                at += read as u64;
            }
        }
    }
    Ok(())
}

/// Writes all bytes at a place of the file.
///
/// # Errors
///
/// They cannot be written.
#[cfg(unix)]
pub fn write_all_at(file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
}

/// Writes all bytes at a place of the file.
///
/// # Errors
///
/// They cannot be written.
#[cfg(windows)]
pub fn write_all_at(file: &File, mut bytes: &[u8], mut at: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, at)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            written => {
                bytes = &bytes[written..];
                at += written as u64;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Seek as _, Write as _};

    use super::*;

    #[test]
    fn a_cursor_reads_from_where_it_is_and_not_beyond_the_end() {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"0123456789").unwrap();
        let mut cursor = Cursor::new(file.into()).unwrap();
        let mut other = cursor.clone();
        let mut out = [0; 4];
        assert_eq!(cursor.seek(SeekFrom::End(-3)).unwrap(), 7);
        assert_eq!((cursor.read(&mut out).unwrap(), &out[..3]), (3, &b"789"[..]));
        assert_eq!(cursor.read(&mut out).unwrap(), 0);
        assert!(cursor.seek(SeekFrom::Current(-11)).is_err());
        assert_eq!(cursor.seek(SeekFrom::Current(-9)).unwrap(), 1);
        cursor.read_exact(&mut out).unwrap();
        assert_eq!(&out, b"1234");
        let mut whole = String::new();
        other.read_to_string(&mut whole).unwrap();
        assert_eq!(whole, "0123456789", "clones do not move each other");
        assert!(read_exact_at(&tempfile::tempfile().unwrap(), &mut out, 0).is_err());
    }
}
