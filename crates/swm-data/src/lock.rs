//! One writer at a time: a lock file beside the dataset, locked through the operating system, which frees it when
//! the process ends in any way. The file says who holds it, for the message to the next; one that is left behind by a kill
//! does no harm. Readers need no lock.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use crate::error::DataError;
use crate::formats::disk;

/// A lock file above this size is not ours.
const MAX_BYTES: u64 = 4096;

/// Looks at a lock file that others make and remove.
const MAX_TRIES: usize = 1000;

/// Held while a writer lives; removes the lock file when dropped.
#[derive(Debug)]
pub struct WriterLock {
    path: PathBuf,
    file: File,
}

impl WriterLock {
    /// Takes the lock of the dataset at `dataset`.
    ///
    /// # Errors
    ///
    /// [`DataError::Busy`]: another writer has it, who is named; or the file of the lock cannot be made.
    pub fn take(dataset: &Path) -> Result<Self, DataError> {
        Self::take_file(beside(dataset, ".lock"), dataset)
    }

    /// Takes the lock of a folder that one process at a time writes to, in its file `lock`.
    ///
    /// # Errors
    ///
    /// As of [`WriterLock::take`].
    pub fn take_within(folder: &Path) -> Result<Self, DataError> {
        Self::take_file(folder.join("lock"), folder)
    }

    /// Takes the lock in the file `path`; messages name `dataset`.
    fn take_file(path: PathBuf, dataset: &Path) -> Result<Self, DataError> {
        let failed = |source| DataError::io(dataset, "create", source);
        let busy = |holder: Option<Holder>| DataError::Busy {
            path: dataset.to_owned(),
            holder: holder.map_or_else(|| "another process".to_owned(), |holder| holder.to_string()),
        };
        let mut tries = 0;
        loop {
            tries += 1;
            let mut file = match disk::open_own(&path, true) {
                // Another writer made or removed it between two looks at it.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists && tries < MAX_TRIES => continue,
                // Nothing can be made in a folder that was removed under this process, and in some of the system.
                Err(error)
                    if error.kind() == io::ErrorKind::NotFound
                        && tries < MAX_TRIES
                        && folder_of(&path).is_dir() =>
                {
                    continue;
                }
                Err(error) if error.kind() == io::ErrorKind::Other => {
                    return Err(DataError::io(&path, "lock", error));
                }
                opened => opened.map_err(failed)?,
            };
            let mut is_locked = false;
            match file.try_lock() {
                Ok(()) => is_locked = true,
                Err(TryLockError::WouldBlock) => return Err(busy(Holder::read(&file))),
                // Some network file systems have no locks: there only what the file says protects, and only from
                // processes of this machine, for whether others still live cannot be found out.
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                    if let Some(holder) = Holder::read(&file).filter(Holder::lives_here) {
                        return Err(busy(Some(holder)));
                    }
                }
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
            // The former owner may have removed the file between our open and our lock: then take the new one.
            if is_at(&file, &path) {
                let named = file.set_len(0).and_then(|()| writeln!(file, "{}", Holder::this()));
                // On a full disk the lock of the system is one without a name.
                if !is_locked {
                    named.map_err(failed)?;
                }
                return Ok(Self { path, file });
            }
        }
    }

    /// The writer of the dataset at `dataset`, if it is a process of this machine that has not ended: `process 123 on host`. Writers
    /// on other machines are not found. Nothing is locked, so that nobody is kept from writing.
    pub fn holder_here(dataset: &Path) -> Option<String> {
        let file = disk::open_own(&beside(dataset, ".lock"), false).ok()?;
        Holder::read(&file).filter(Holder::lives_here).map(|holder| holder.to_string())
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

/// Who holds a lock: `process 123 on host`.
#[derive(Debug, PartialEq, Eq)]
struct Holder {
    process: u32,
    host: String,
}

impl Holder {
    fn this() -> Self {
        Self { process: std::process::id(), host: host() }
    }

    /// What a lock file says; nothing if it is of an older version, or cannot be read while it is locked.
    fn read(file: &File) -> Option<Self> {
        let mut text = String::new();
        file.take(MAX_BYTES).read_to_string(&mut text).ok()?;
        let (process, host) = text.trim_end().strip_prefix("process ")?.split_once(" on ")?;
        Some(Self { process: process.parse().ok()?, host: host.to_owned() })
    }

    /// Whether it is a process of this machine that has not ended, as far as that can be known.
    fn lives_here(&self) -> bool {
        self.host == host() && Path::new(&format!("/proc/{}", self.process)).exists()
    }
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "process {} on {}", self.process, self.host)
    }
}

/// The name of this machine.
fn host() -> String {
    let named = fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let named =
        named.or_else(|| std::env::var("COMPUTERNAME").ok()).or_else(|| std::env::var("HOSTNAME").ok());
    match named.as_deref().map(str::trim) {
        None | Some("") => "an unnamed host".to_owned(),
        Some(name) => name.to_owned(),
    }
}

/// `folder/name.h5` → `folder/name.h5.lock`.
pub(crate) fn beside(dataset: &Path, suffix: &str) -> PathBuf {
    let mut name = dataset.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// Whether `path` still names the open `file`. Where files cannot be told apart, an open one cannot be removed.
fn is_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(ours), Ok(there)) => disk::identity(&ours) == disk::identity(&there),
        _ => false,
    }
}

/// The folder that a file lies in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_writer_and_no_traces() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = folder.path().join("a.h5");
        // What a killed writer left.
        fs::write(beside(&dataset, ".lock"), "process 4194305 on elsewhere, with a longer name\n").unwrap();
        assert_eq!(WriterLock::holder_here(&dataset), None);
        let first = WriterLock::take(&dataset).unwrap();
        let message = WriterLock::take(&dataset).unwrap_err().to_string();
        if cfg!(unix) {
            let holder = format!("a.h5 is being written by process {} on {};", std::process::id(), host());
            assert!(message.contains(&holder), "{message}");
            assert_eq!(WriterLock::holder_here(&dataset), Some(Holder::this().to_string()));
        }
        drop(first);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        WriterLock::take(&dataset).unwrap();
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_in_which_nothing_can_be_made_is_an_error() {
        let message = WriterLock::take(Path::new("/proc/a.h5")).unwrap_err().to_string();
        assert!(message.contains("/proc/a.h5"), "{message}");
    }

    #[test]
    fn holders_that_have_ended_are_recognized() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let holder = |text: &str| {
            fs::write(&path, text).unwrap();
            Holder::read(&File::open(&path).unwrap())
        };
        let this = Holder::this();
        assert_eq!(holder(&format!("{this}\n")).as_ref(), Some(&this));
        assert_eq!(this.lives_here(), cfg!(target_os = "linux"));
        // Above the largest process id that Linux gives.
        assert!(!Holder { process: 4_194_305, ..Holder::this() }.lives_here());
        assert!(!Holder { host: "elsewhere".to_owned(), ..Holder::this() }.lives_here());
        for text in ["", "process", "process x on y", "anything else"] {
            assert_eq!(holder(text), None, "{text}");
        }
    }
}
