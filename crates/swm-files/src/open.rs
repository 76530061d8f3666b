//! Opening files with care: regular ones alone, none outside of a folder, and no file of others through a link.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _};
use std::path::Path;

use crate::read_at::{ReadAt as _, Readable};

/// A file above this size is not read as a whole: no index, image or video of an episode is as large.
const MAX_WHOLE: u64 = 1 << 30;

/// Opens a regular file to read it: nobody knows how long a pipe waits, or when a device ends.
///
/// # Errors
///
/// It is something else, or cannot be opened.
pub fn open_regular(path: &Path) -> io::Result<File> {
    match fs::metadata(path)?.is_file() {
        true => File::open(path),
        false => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no regular file")),
    }
}

/// All of a file that [`open_regular`] opens, up to the length that it has now.
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

/// Whether a file begins with these bytes. What cannot be opened, or is shorter, does not.
#[must_use]
pub fn begins(path: &Path, start: &[u8]) -> bool {
    let mut found = vec![0; start.len()];
    Readable::open(path).is_ok_and(|file| file.read_exact_at(&mut found, 0).is_ok()) && found == start
}

/// Whether a file begins as a zip archive.
#[must_use]
pub fn is_zip(path: &Path) -> bool {
    begins(path, b"PK\x03\x04")
}

/// Opens the regular file `below` the folder `root` to read it: no part of its path leads out of the root, neither by `..` nor by a link,
/// also while others exchange folders for links.
///
/// # Errors
///
/// It leads out of the root, is no regular file, or cannot be opened.
pub fn open_beneath(root: &Path, below: &Path) -> io::Result<File> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, Mode, OFlags, ResolveFlags, openat, openat2};
        use rustix::io::Errno;

        let folder = openat(CWD, root, OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())?;
        // Without waiting for the writer of a pipe.
        let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
        match openat2(
            folder,
            below,
            flags,
            Mode::empty(),
            ResolveFlags::BENEATH | ResolveFlags::NO_MAGICLINKS,
        ) {
            Ok(file) => return regular(file.into()),
            Err(Errno::XDEV) => return Err(outside()),
            // A kernel before 5.6, or one that forbids it: by steps.
            Err(Errno::NOSYS | Errno::PERM) => {}
            Err(error) => return Err(error.into()),
        }
    }
    let real = fs::canonicalize(root.join(below))?;
    if !real.starts_with(fs::canonicalize(root)?) {
        return Err(outside());
    }
    open_regular(&real).and_then(regular)
}

fn outside() -> io::Error {
    io::Error::new(io::ErrorKind::PermissionDenied, "it leads out of its folder, by a link or `..`")
}

fn regular(file: File) -> io::Result<File> {
    match file.metadata()?.is_file() {
        true => Ok(file),
        false => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no regular file")),
    }
}

/// Opens a file of a program's own to append to it, and makes it if it is not there. A link or a file with a second name is refused: what
/// lies behind it may be somebody else's.
///
/// # Errors
///
/// It is such a file, or cannot be opened.
pub fn append_own(path: &Path) -> io::Result<File> {
    let checked = open_own(path, true)?;
    let file = OpenOptions::new().read(true).append(true).open(path)?;
    match identity(&checked.metadata()?) == identity(&file.metadata()?) {
        true => Ok(file),
        false => Err(io::Error::new(io::ErrorKind::AlreadyExists, "it was replaced while it was opened")),
    }
}

/// Opens a file to change it, and makes it if `create`. What is not a file of this name alone is refused: a symbolic link,
/// a file with a second name, a pipe. Nothing is cut.
///
/// # Errors
///
/// It is such a thing, was replaced meanwhile, or cannot be opened.
pub fn open_own(path: &Path, create: bool) -> io::Result<File> {
    let foreign = |what: &str| {
        let fix = "remove it, or copy what it belongs to without links and use the copy";
        io::Error::other(format!("it is {what}, and what lies behind it may be somebody else's; {fix}"))
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
    let (opened, names) = (file.metadata()?, link_count(&file.metadata()?));
    if identity(&opened) != identity(&there) {
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, "it was replaced while it was opened"));
    }
    if names > 1 {
        return Err(foreign(&format!("a file with {names} names (hard links)")));
    }
    Ok(file)
}

/// What tells a file from all others; nothing where the system has no such thing.
#[cfg(unix)]
#[must_use]
pub fn identity(file: &fs::Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((file.dev(), file.ino()))
}

/// What tells a file from all others; nothing where the system has no such thing.
#[cfg(not(unix))]
#[must_use]
pub fn identity(_file: &fs::Metadata) -> Option<(u64, u64)> {
    None
}

/// How many names a file has.
#[cfg(unix)]
#[must_use]
pub fn link_count(file: &fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(file)
}

/// How many names a file has.
#[cfg(not(unix))]
#[must_use]
pub fn link_count(_file: &fs::Metadata) -> u64 {
    1
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;
    use crate::folders::link_out_of;

    #[cfg(unix)]
    #[test]
    fn nothing_is_opened_outside_of_a_folder() {
        use std::os::unix::fs::symlink;

        let folder = tempfile::tempdir().unwrap();
        let (root, private) = (folder.path().join("root"), folder.path().join("private"));
        fs::create_dir_all(root.join("below")).unwrap();
        fs::create_dir(&private).unwrap();
        fs::write(private.join("a"), "private").unwrap();
        fs::write(root.join("below/a"), "shown").unwrap();
        symlink(private.join("a"), root.join("file")).unwrap();
        symlink(&private, root.join("folder")).unwrap();
        symlink("below/a", root.join("inside")).unwrap();
        let read = |below: &str| open_beneath(&root, Path::new(below)).and_then(io::read_to_string);
        assert_eq!(read("below/a").unwrap(), "shown");
        assert_eq!(read("inside").unwrap(), "shown");
        let outside = private.join("a");
        for below in ["file", "folder/a", "../private/a", outside.to_str().unwrap()] {
            let message = read(below).unwrap_err().to_string();
            assert!(message.contains("out of its folder"), "{below}: {message}");
        }
        assert!(read("below").is_err() && read("none").is_err());
        let allowed = |real: &Path| real.starts_with(fs::canonicalize(&root).unwrap());
        let found = link_out_of(&root, &allowed).unwrap().unwrap();
        assert!(["file", "folder"].iter().any(|name| found.ends_with(name)), "{found:?}");
        fs::remove_file(root.join("file")).unwrap();
        fs::remove_file(root.join("folder")).unwrap();
        assert_eq!(link_out_of(&root, &allowed).unwrap(), None);
        append_own(&root.join("log")).unwrap().write_all(b"one").unwrap();
        append_own(&root.join("log")).unwrap().write_all(b" two").unwrap();
        assert_eq!(read("log").unwrap(), "one two");
        assert!(append_own(&root.join("inside")).unwrap_err().to_string().contains("symbolic link"));
        assert_eq!(read("below/a").unwrap(), "shown");
    }
}
