//! Small files that are replaced as a whole, whichever crate they belong to: at any moment readers see the old content or the new, also
//! after a loss of power. And files, or objects that lie elsewhere, that are read by position.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::formats::disk;

pub use crate::formats::disk::{Cursor, ReadAt, Readable, read_exact_at, read_regular};

/// What the names of files that are being written begin with; see [`draft`].
pub const DRAFT: &str = "new-";

/// Where a file is written before it takes its place: `new-PROCESS-COUNT-NAME`. No two writers share one. Its name ends as the file's
/// own, which is how some programs find out what is in it.
pub fn draft(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let (process, count) = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    path.with_file_name(format!("{DRAFT}{process}-{count}-{name}"))
}

/// Puts `bytes` in the place of the file at `path`. A symbolic link there is replaced, not followed.
///
/// # Errors
///
/// The file cannot be written; then the old one is still there.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let draft = draft(path);
    let written = OpenOptions::new().write(true).create_new(true).open(&draft).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    // What is half written is of no use; the error that counts is the first one.
    written.and_then(|()| settle(&draft, path)).inspect_err(|_| drop(fs::remove_file(&draft)))
}

/// Puts the file `draft`, which is on the disk, in the place of the one at `path`, and the names of its folder on the disk.
///
/// # Errors
///
/// The file cannot be renamed.
pub fn settle(draft: &Path, path: &Path) -> io::Result<()> {
    fs::rename(draft, path)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Some file systems cannot sync a folder, or let nobody open it: the file is whole all the same.
    if cfg!(unix) {
        let _ = fs::File::open(folder).and_then(|folder| folder.sync_all());
    }
    Ok(())
}

/// Opens a regular file to read it: nobody knows how long a pipe waits, or when a device ends.
///
/// # Errors
///
/// It is something else, or cannot be opened.
pub fn open_regular(path: &Path) -> io::Result<fs::File> {
    disk::open_regular(path)
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
pub fn open_beneath(root: &Path, below: &Path) -> io::Result<fs::File> {
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
    disk::open_regular(&real).and_then(regular)
}

fn outside() -> io::Error {
    io::Error::new(io::ErrorKind::PermissionDenied, "it leads out of its folder, by a link or `..`")
}

fn regular(file: fs::File) -> io::Result<fs::File> {
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
pub fn append_own(path: &Path) -> io::Result<fs::File> {
    let checked = disk::open_own(path, true)?;
    let file = OpenOptions::new().read(true).append(true).open(path)?;
    match disk::identity(&checked.metadata()?) == disk::identity(&file.metadata()?) {
        true => Ok(file),
        false => Err(io::Error::new(io::ErrorKind::AlreadyExists, "it was replaced while it was opened")),
    }
}

/// The first symbolic link below a folder that leads to where `is_allowed` is false, or nowhere.
///
/// # Errors
///
/// A folder cannot be read.
pub fn link_out_of(folder: &Path, is_allowed: &impl Fn(&Path) -> bool) -> io::Result<Option<PathBuf>> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (kind, path) = (entry.file_type()?, entry.path());
        if kind.is_symlink() {
            // What is behind an allowed link to a folder may have links, too; loops end, as they lead to what is looked at already.
            match fs::canonicalize(&path) {
                Ok(real) if is_allowed(&real) && !folder.starts_with(&real) => {
                    if real.is_dir()
                        && let Some(found) = link_out_of(&real, is_allowed)?
                    {
                        return Ok(Some(found));
                    }
                }
                _ => return Ok(Some(path)),
            }
        } else if kind.is_dir()
            && let Some(found) = link_out_of(&path, is_allowed)?
        {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// Whether `name` stays in the folder that it is joined to, on every system.
pub fn is_plain_name(name: &str) -> bool {
    disk::is_plain_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_file_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a.json"), folder.path().join("other"));
        replace(&path, b"old").unwrap();
        replace(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        #[cfg(unix)]
        {
            fs::write(&other, "of others").unwrap();
            fs::remove_file(&path).unwrap();
            std::os::unix::fs::symlink(&other, &path).unwrap();
            replace(&path, b"own").unwrap();
            assert_eq!(
                (fs::read(&other).unwrap(), fs::read(&path).unwrap()),
                (b"of others".to_vec(), b"own".to_vec())
            );
            fs::remove_file(&other).unwrap();
        }
        assert!(replace(&folder.path().join("none/a.json"), b"").is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no draft is left");
        assert_ne!(draft(&other), draft(&other));
    }
}
