//! Folders that are either whole or absent: they are filled under another name and moved to their place.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use super::wheel::create_folder;

/// Fills a fresh folder, then moves it to its place, over what is there. An interrupted run leaves the old state.
///
/// Other processes that share `home` wait meanwhile. Returns whether the folder was filled: false if it `is_whole` by now,
/// because another process has done it.
pub(super) fn install(
    home: &Path,
    folder: &Path,
    is_whole: impl FnOnce() -> bool,
    fill: impl FnOnce(&Path) -> Result<()>,
) -> Result<bool> {
    let lock = Lock::take(home)?;
    if is_whole() {
        return Ok(false);
    }
    if lock.is_some() {
        sweep(folder);
    }
    let partial = partial_name(folder);
    let filled =
        create_folder(&partial).and_then(|()| fill(&partial)).and_then(|()| replace(folder, &partial));
    if filled.is_err() {
        // What counts is the error that led here; the next run sweeps.
        let _ = fs::remove_dir_all(&partial);
    }
    filled.map(|()| true)
}

fn replace(folder: &Path, partial: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| format!("failed to remove {}", folder.display()))?;
    }
    fs::rename(partial, folder).with_context(|| format!("failed to create {}", folder.display()))
}

/// A name next to the folder that no other running process uses.
fn partial_name(folder: &Path) -> PathBuf {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    folder.with_file_name(format!("{name}.partial-{}", std::process::id()))
}

/// Removes what interrupted runs left next to a whole folder, unless another process is at work.
pub(super) fn tidy(home: &Path, folder: &Path) {
    if left_overs(folder).next().is_some()
        && let Ok(file) = File::open(home.join(LOCK))
        && file.try_lock().is_ok()
    {
        sweep(folder);
    }
}

/// Only under a [`Lock`]: no other run may be at work.
fn sweep(folder: &Path) {
    for path in left_overs(folder) {
        // They waste space and do no other harm.
        let _ = fs::remove_dir_all(path);
    }
}

/// Folders under the names that [`partial_name`] gives.
fn left_overs(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let start = format!("{}.partial-", folder.file_name().unwrap_or_default().to_string_lossy());
    let entries =
        folder.parent().and_then(|parent| fs::read_dir(parent).ok()).into_iter().flatten().flatten();
    entries
        .filter(move |entry| entry.file_name().to_string_lossy().starts_with(&start))
        .map(|entry| entry.path())
}

/// The file whose lock stands for the folder that it lies in.
const LOCK: &str = ".setup.lock";

/// Held while this process alone changes the folder; released when dropped.
struct Lock {
    _file: File,
}

impl Lock {
    /// Waits for other processes; none where the file system has no locks (some network ones).
    fn take(folder: &Path) -> Result<Option<Self>> {
        create_folder(folder)?;
        let path = folder.join(LOCK);
        let file = File::options().create(true).append(true).open(&path);
        let file = file.with_context(|| format!("failed to create {}", path.display()))?;
        match file.try_lock() {
            Ok(()) => return Ok(Some(Self { _file: file })),
            Err(TryLockError::Error(_)) => return Ok(None),
            Err(TryLockError::WouldBlock) => {}
        }
        eprintln!("setup: waiting for another set-up of {}", folder.display());
        Ok(file.lock().is_ok().then_some(Self { _file: file }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::bail;

    fn fill(folder: &Path, name: &str) -> Result<bool> {
        let home = folder.parent().unwrap();
        install(home, folder, || folder.join(name).exists(), |place| Ok(fs::write(place.join(name), name)?))
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_failed_fill_leaves_the_old_folder_and_nothing_else() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("1.0");
        assert!(fill(&folder, "old").unwrap());
        let error = install(
            home.path(),
            &folder,
            || false,
            |place| {
                fs::write(place.join("new"), "new")?;
                bail!("the network is gone")
            },
        );
        assert_eq!(error.unwrap_err().to_string(), "the network is gone");
        assert_eq!(names(&folder), ["old"]);
        assert_eq!(names(home.path()), [".setup.lock", "1.0"]);
    }

    #[test]
    fn the_new_folder_takes_the_place_of_the_old_one() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("1.0");
        assert!(fill(&folder, "old").unwrap());
        assert!(fill(&folder, "new").unwrap());
        assert_eq!(names(&folder), ["new"]);
    }

    #[test]
    fn a_whole_folder_is_left_alone() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("1.0");
        assert!(fill(&folder, "old").unwrap());
        assert!(!fill(&folder, "old").unwrap());
    }

    #[test]
    fn left_overs_of_interrupted_runs_are_removed() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("1.0");
        let left_over = home.path().join("1.0.partial-17");
        for path in [&left_over, &home.path().join("1.0.1")] {
            fs::create_dir(path).unwrap();
        }
        assert!(fill(&folder, "new").unwrap());
        assert_eq!(names(home.path()), [".setup.lock", "1.0", "1.0.1"]);
        fs::create_dir(&left_over).unwrap();
        let lock = Lock::take(home.path()).unwrap();
        tidy(home.path(), &folder);
        assert_eq!(left_over.exists(), lock.is_some(), "another run may be at work there");
        drop(lock);
        tidy(home.path(), &folder);
        assert!(!left_over.exists());
    }

    #[test]
    fn a_lock_is_released_when_dropped() {
        let home = tempfile::tempdir().unwrap();
        let lock = Lock::take(home.path()).unwrap();
        let file = File::open(home.path().join(LOCK)).unwrap();
        assert!(lock.is_none() || file.try_lock().is_err());
        drop(lock);
        file.try_lock().unwrap();
    }
}
