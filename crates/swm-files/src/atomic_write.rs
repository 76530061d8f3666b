//! Small files that are replaced as a whole, whichever crate they belong to: at any moment readers see the old content or the new, and, where
//! it is brought to the disk, also after a loss of power.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use crate::folders::{beside, folder_of};

/// What the names of files that are being written begin with; see [`draft`].
pub const DRAFT: &str = "new-";

/// Where a file is written before it takes its place: `new-PROCESS-COUNT-NAME`. No two writers share one. Its name ends as the file's
/// own, which is how some programs find out what is in it.
#[must_use]
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
    let folder = folder_of(path);
    // Some file systems cannot sync a folder, or let nobody open it: the file is whole all the same.
    if cfg!(unix) {
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    Ok(())
}

/// As [`replace`], by the only writer of the file, of what is brought to the disk later ([`sync`]): readers see the old content or the new, as
/// long as the system runs.
///
/// # Errors
///
/// It cannot be written.
pub fn replace_unsynced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let draft = beside(path, ".new");
    // Of a full disk something may be left.
    write_new(&draft, bytes).inspect_err(|_| drop(fs::remove_file(&draft)))?;
    fs::rename(&draft, path)
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
///
/// # Errors
///
/// It cannot be made or written.
pub fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    new_file(path)?.write_all(bytes)
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

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_file_is_replaced_by_its_only_writer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("info.json");
        for text in ["old", "new"] {
            replace_unsynced(&path, text.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        // What was left behind by a kill is no obstacle.
        fs::write(beside(&path, ".new"), "half").unwrap();
        replace_unsynced(&path, b"newer").unwrap();
        sync(&[path.clone(), folder.path().join("gone")]).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"newer");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
