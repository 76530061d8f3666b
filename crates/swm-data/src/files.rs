//! Small files that are replaced as a whole, whichever crate they belong to: at any moment readers see the old content or the new, also
//! after a loss of power.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::formats::disk;

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
}
