//! Room for the copies of whole objects in the cache. Beside each copy is a file that has its size, whose time is that of its last use,
//! and which its readers lock. The copies that were not used for longest go first; those in use stay.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, SystemTime};

use swm_core::dataset::DataError;

use super::error::{RemoteError, RemoteErrorKind as Kind};
use crate::lock::{WriterLock, has_no_locks, is_at};

/// The extension of the files beside copies.
const USED: &str = "used";
/// How often a file beside a copy is looked for, while others remove it.
const MAX_TRIES: usize = 1000;
/// Digits of a size, at most.
const MAX_DIGITS: u64 = 20;

/// A copy that is in use: no process removes it until this is dropped.
#[derive(Debug)]
pub struct Used {
    file: File,
}

/// A copy in the cache.
struct Kept {
    used: SystemTime,
    bytes: u64,
    /// The file beside it.
    mark: PathBuf,
}

impl Used {
    /// Marks a copy, which need not be there yet, as used from now on.
    pub(super) fn of(copies: &Path, key: &str) -> io::Result<Self> {
        fs::create_dir_all(copies)?;
        let mark = copies.join(key).with_extension(USED);
        for _ in 0..MAX_TRIES {
            let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&mark)?;
            match file.lock_shared() {
                Err(error) if !has_no_locks(&error) => return Err(error),
                _ => {}
            }
            // It may have been removed between the two.
            if is_at(&file, &mark) {
                file.set_modified(super::now())?;
                return Ok(Self { file });
            }
        }
        Err(io::Error::other("other processes remove it again and again"))
    }

    /// Makes room for the bytes of this copy, by removing others.
    pub(super) fn reserve(
        &mut self,
        name: &str,
        copies: &Path,
        bytes: u64,
        limit: u64,
    ) -> Result<(), RemoteError> {
        let failed = |error: io::Error| RemoteError::cache(name, copies, &error);
        // One process at a time makes room.
        let _one = wait_for(name, Duration::from_millis(50), || WriterLock::take_within(copies))?;
        let mut others: Vec<Kept> = kept(copies).map_err(failed)?;
        others.retain(|other| !is_at(&self.file, &other.mark));
        others.sort_by_key(|other| other.used);
        let mut taken = others.iter().map(|other| other.bytes).fold(0, u64::saturating_add);
        for other in others {
            if taken.saturating_add(bytes) <= limit {
                break;
            }
            if remove(&other.mark).map_err(failed)? {
                taken = taken.saturating_sub(other.bytes);
            }
        }
        if taken.saturating_add(bytes) > limit {
            let gigabytes = |bytes: u64| format!("{:.1} GB", bytes as f64 / 1e9);
            let reason = format!(
                "its format is read from a whole copy of {}, and copies may take {}, of which {} are in use",
                gigabytes(bytes),
                gigabytes(limit),
                gigabytes(taken)
            );
            let fix = "set SWM_CACHE_GB to more, or fetch it to a place of its own and open that";
            return Err(RemoteError::new(Kind::Cache, name, reason, fix));
        }
        let written = self.file.set_len(0).and_then(|()| self.file.seek(SeekFrom::Start(0)));
        written.and_then(|_| write!(self.file, "{bytes}")).map_err(failed)
    }
}

/// Waits until no other process has the lock that `take` takes; looks every `pause`.
pub(super) fn wait_for(
    name: &str,
    pause: Duration,
    take: impl Fn() -> Result<WriterLock, DataError>,
) -> Result<WriterLock, RemoteError> {
    loop {
        match take() {
            Ok(lock) => return Ok(lock),
            Err(DataError::Busy { .. }) => thread::sleep(pause),
            Err(error) => {
                let fix = "set SWM_CACHE to a folder that can be written to";
                return Err(RemoteError::new(Kind::Cache, name, error.to_string(), fix));
            }
        }
    }
}

/// All copies.
fn kept(copies: &Path) -> io::Result<Vec<Kept>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(copies)?.flatten() {
        let mark = entry.path();
        if mark.extension().is_none_or(|extension| extension != USED) {
            continue;
        }
        let Ok(file) = File::open(&mark) else { continue };
        let used = file.metadata().and_then(|about| about.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
        let mut text = String::new();
        // Whose size is not written yet is about to be reserved, after this.
        let bytes = file.take(MAX_DIGITS).read_to_string(&mut text).ok().and_then(|_| text.parse().ok());
        found.push(Kept { used, bytes: bytes.unwrap_or(0), mark });
    }
    Ok(found)
}

/// Removes a copy, unless it is in use; whether it was removed.
fn remove(mark: &Path) -> io::Result<bool> {
    let file = match OpenOptions::new().read(true).write(true).open(mark) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(true),
        opened => opened?,
    };
    match file.try_lock() {
        Ok(()) => {}
        // Where nothing can be locked, nothing shows what is in use.
        Err(TryLockError::WouldBlock) => return Ok(false),
        Err(TryLockError::Error(error)) if has_no_locks(&error) => return Ok(false),
        Err(TryLockError::Error(error)) => return Err(error),
    }
    let folder = mark.with_extension("");
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    fs::remove_file(mark)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn copy(copies: &Path, key: &str, bytes: u64, limit: u64) -> Result<Used, RemoteError> {
        let mut used = Used::of(copies, key).unwrap();
        used.reserve("s3://b/x", copies, bytes, limit)?;
        fs::create_dir_all(copies.join(key)).unwrap();
        fs::write(copies.join(key).join("x.h5"), vec![0; bytes as usize]).unwrap();
        Ok(used)
    }

    #[test]
    fn the_oldest_copies_go_unless_they_are_in_use() {
        let folder = tempfile::tempdir().unwrap();
        let copies = folder.path().join("copies");
        let has = |key: &str| copies.join(key).join("x.h5").is_file();
        for (key, age) in [("a", 300), ("b", 200), ("c", 100)] {
            let used = copy(&copies, key, 300, 1000).unwrap();
            used.file.set_modified(crate::remote::now() - Duration::from_secs(age)).unwrap();
        }
        assert!(has("a") && has("b") && has("c"));
        // A reader of the oldest keeps it, and makes it the newest.
        let reader = Used::of(&copies, "a").unwrap();
        drop(copy(&copies, "d", 300, 1000).unwrap());
        assert!(has("a") && !has("b") && has("c") && has("d"));
        let message = copy(&copies, "e", 800, 1000).unwrap_err().to_string();
        assert!(message.contains("SWM_CACHE_GB") && message.contains("in use"), "{message}");
        assert!(has("a"), "it is in use");
        drop(reader);
        drop(copy(&copies, "e", 1000, 1000).unwrap());
        assert!(has("e") && !has("a") && !has("c") && !has("d"));
        assert_eq!(kept(&copies).unwrap().len(), 1);
        let message = copy(&copies, "f", 1001, 1000).unwrap_err().to_string();
        assert!(message.contains("whole copy"), "{message}");
    }
}
