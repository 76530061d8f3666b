//! Reading and writing pieces of files, files that appear whole or not at all, and files that are a dataset's own: nothing
//! is written through a link.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;

use crate::error::DataError;

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
#[cfg(unix)]
pub(crate) fn write_all_at(file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
}

#[cfg(windows)]
pub(crate) fn write_all_at(file: &File, mut bytes: &[u8], mut at: u64) -> io::Result<()> {
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

/// Opens a file to read it: a regular one, for nobody knows how long a pipe waits or when a device ends.
pub(crate) fn open_regular(path: &Path) -> io::Result<File> {
    match fs::metadata(path)?.is_file() {
        true => File::open(path),
        false => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no regular file")),
    }
}

/// A file above this size is not read as a whole: no index, image or video of an episode is as large.
const MAX_WHOLE: u64 = 1 << 30;

/// All of a file that [`crate::files::open_regular`] opens, up to the length that it has now.
///
/// # Errors
///
/// It cannot be read, or is too large to be read at once.
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let file = open_regular(path)?;
    let length = file.metadata()?.len();
    if length > MAX_WHOLE {
        let reason = format!("it has {length} bytes, more than are read at once");
        return Err(io::Error::new(io::ErrorKind::InvalidData, reason));
    }
    let mut bytes = Vec::with_capacity(length as usize);
    file.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Opens a file to change it, and makes it if `create`. What is not a file of this name alone is refused: a symbolic link,
/// a file with a second name, a pipe. Nothing is cut.
pub(crate) fn open_own(path: &Path, create: bool) -> io::Result<File> {
    let foreign = |what: &str| {
        let fix = "remove it, or copy the dataset without links and use the copy";
        io::Error::other(format!("it is {what}, and what lies behind it may not be the dataset's; {fix}"))
    };
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    let there = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound && create => {
            return options.create_new(true).open(path);
        }
        there => there?,
    };
    if there.is_symlink() {
        return Err(foreign("a symbolic link"));
    }
    if !there.is_file() {
        return Err(foreign("no regular file"));
    }
    let file = options.open(path)?;
    let (opened, names) = (file.metadata()?, names(&file.metadata()?));
    if identity(&opened) != identity(&there) {
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, "it was replaced while it was opened"));
    }
    if names > 1 {
        return Err(foreign(&format!("a file with {names} names (hard links)")));
    }
    Ok(file)
}

/// Makes a new file. What had its name is removed: a link is not followed.
///
/// # Errors
///
/// It cannot be made.
pub fn new_file(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    OpenOptions::new().read(true).write(true).create_new(true).open(path)
}

/// As [`new_file`], with this content.
pub(crate) fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    new_file(path)?.write_all(bytes)
}

/// What tells a file from all others; nothing where the system has no such thing.
#[cfg(unix)]
pub(crate) fn identity(file: &fs::Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((file.dev(), file.ino()))
}

#[cfg(not(unix))]
pub(crate) fn identity(_file: &fs::Metadata) -> Option<(u64, u64)> {
    None
}

/// How many names a file has.
#[cfg(unix)]
pub(crate) fn names(file: &fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(file)
}

#[cfg(not(unix))]
pub(crate) fn names(_file: &fs::Metadata) -> u64 {
    1
}

/// Bytes of a file, or of all files of a folder; links are not followed.
pub(crate) fn size(path: &Path) -> io::Result<u64> {
    let there = fs::symlink_metadata(path)?;
    if there.is_symlink() || !there.is_dir() {
        // A dataset that is a link is opened by it.
        return Ok(fs::metadata(path)?.len());
    }
    let mut bytes = 0u64;
    for entry in fs::read_dir(path)? {
        let entry = entry?;
        bytes = bytes.saturating_add(match entry.file_type()? {
            kind if kind.is_dir() => size(&entry.path())?,
            _ => entry.metadata()?.len(),
        });
    }
    Ok(bytes)
}

/// The first symbolic link below a folder.
pub(crate) fn first_link(folder: &Path) -> io::Result<Option<PathBuf>> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_symlink() {
            return Ok(Some(entry.path()));
        }
        if kind.is_dir()
            && let Some(found) = first_link(&entry.path())?
        {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// Brings files, and the folders that name them, from the system's memory to the disk. Files that are gone again are
/// passed over.
///
/// # Errors
///
/// A file cannot be opened or synced.
pub fn sync(files: &[PathBuf]) -> io::Result<()> {
    let folders: BTreeSet<&Path> = files.iter().filter_map(|file| file.parent()).collect();
    let mut options = OpenOptions::new();
    options.read(true).write(cfg!(windows));
    let one = |path: &Path| match options.open(path).and_then(|file| file.sync_all()) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        done => done,
    };
    files.par_iter().try_for_each(|file| one(file))?;
    // Elsewhere folders cannot be opened, and need not be.
    if cfg!(unix) { folders.into_iter().try_for_each(one) } else { Ok(()) }
}

/// Puts `bytes` in the place of the file at `path`: at any moment either the old content stands there or the new.
///
/// # Errors
///
/// It cannot be written.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    write_new(Path::new(&name), bytes)?;
    fs::rename(&name, path)
}

/// As [`replace`], with a value as indented JSON.
///
/// # Errors
///
/// It cannot be written.
pub fn replace_json(path: &Path, value: &impl Serialize) -> Result<(), DataError> {
    let bytes = serde_json::to_vec_pretty(value).map_err(|error| DataError::record(path, error))?;
    replace(path, &bytes).map_err(|source| DataError::io(path, "write", source))
}

/// Whether `name` stays in the folder that it is joined to, on every system.
pub(crate) fn is_plain_name(name: &str) -> bool {
    !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', '\0', ':'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_leave_the_folder() {
        for name in ["", ".", "..", "../x", "/etc", "a/b", "a\\b", "c:x", "a\0"] {
            assert!(!is_plain_name(name), "{name:?}");
        }
        assert!(is_plain_name("variation.block.color") && is_plain_name("..."));
    }
}
