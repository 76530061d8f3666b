//! One writer at a time: a lock file beside the dataset, locked through the operating system, which frees it when
//! the process ends in any way. A lock file that is left behind by a kill does no harm. Readers need no lock.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use crate::error::DataError;

/// Held while a writer lives; removes the lock file when dropped.
#[derive(Debug)]
pub(crate) struct WriterLock {
    path: PathBuf,
    file: File,
}

impl WriterLock {
    /// Takes the lock of the dataset at `dataset`; an error if another writer has it.
    pub(crate) fn take(dataset: &Path) -> Result<Self, DataError> {
        let path = beside(dataset, ".lock");
        let failed = |source| DataError::io(dataset, "create", source);
        loop {
            let file =
                OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(failed)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(DataError::Busy { path: dataset.to_owned() }),
                // Some network file systems have no locks: recording works there, unprotected.
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
            // The former owner may have removed the file between our open and our lock: then take the new one.
            if is_at(&file, &path) {
                return Ok(Self { path, file });
            }
        }
    }
}

impl Drop for WriterLock {
    fn drop(&mut self) {
        // The lock is still held here, so this removes no other writer's file. If it fails, the file does no harm.
        let _ = fs::remove_file(&self.path);
        // Closing is not enough while a child process that is being started still has a copy of the handle.
        let _ = self.file.unlock();
    }
}

/// `folder/name.h5` → `folder/name.h5.lock`.
pub(crate) fn beside(dataset: &Path, suffix: &str) -> PathBuf {
    let mut name = dataset.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// Whether `path` still names the open `file`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(ours), Ok(there)) => (ours.dev(), ours.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// Elsewhere an open file cannot be removed.
#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_writer_and_no_traces() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = folder.path().join("a.h5");
        let first = WriterLock::take(&dataset).unwrap();
        let message = WriterLock::take(&dataset).unwrap_err().to_string();
        assert!(message.contains("a.h5") && message.contains("another process"), "{message}");
        drop(first);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        WriterLock::take(&dataset).unwrap();
    }
}
