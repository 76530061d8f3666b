//! Blocks of objects on disk: a file each, with a checksum. The ones that were not read for longest go first.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use crate::atomic_write::draft;

/// Bytes of a block; the last of an object is shorter.
pub(super) const BLOCK: u64 = 1 << 20;
/// The checksum behind the bytes of a block.
const TAIL: usize = 4;
/// A block that is read is marked as new once in so long a time.
const MARK: Duration = Duration::from_secs(600);
/// Blocks are counted again when so great a part of the most was written: other processes write there, too.
const COUNT_EVERY: u64 = 16;
/// What is not known yet.
const UNKNOWN: u64 = u64::MAX;

/// Blocks in a folder.
#[derive(Debug)]
pub(super) struct Blocks {
    /// `None`: nothing is kept.
    folder: Option<PathBuf>,
    limit: u64,
    /// About so many bytes are there, of this process and of others.
    held: AtomicU64,
    /// So many of them were written since all were counted.
    since: AtomicU64,
    /// Who removes blocks.
    cleaner: Mutex<()>,
}

impl Blocks {
    pub(super) fn new(cache: Option<&Path>, limit: u64) -> Self {
        let folder = cache.map(|cache| cache.join("blocks"));
        let (held, since) = (AtomicU64::new(UNKNOWN), AtomicU64::new(0));
        Self { folder, limit, held, since, cleaner: Mutex::new(()) }
    }

    fn path(&self, key: &str, index: u64) -> Option<PathBuf> {
        let start = key.get(..2)?;
        Some(self.folder.as_ref()?.join(start).join(key).join(format!("{index}.block")))
    }

    /// A block of so many bytes, if it is there and whole.
    pub(super) fn get(&self, key: &str, index: u64, length: usize) -> Option<Vec<u8>> {
        let path = self.path(key, index)?;
        let mut file = File::open(&path).ok()?;
        let mut bytes = Vec::with_capacity(length + TAIL);
        file.by_ref().take((length + TAIL + 1) as u64).read_to_end(&mut bytes).ok()?;
        let checksum =
            bytes.len().checked_sub(TAIL).filter(|&found| found == length).map(|at| bytes.split_off(at));
        if checksum? != crc32fast::hash(&bytes).to_le_bytes() {
            let _ = fs::remove_file(&path);
            return None;
        }
        let age =
            file.metadata().and_then(|about| about.modified()).map(|time| time.elapsed().unwrap_or_default());
        if age.is_ok_and(|age| age > MARK) {
            let _ = file.set_modified(super::now());
        }
        Some(bytes)
    }

    /// Whether a block is there.
    pub(super) fn has(&self, key: &str, index: u64) -> bool {
        self.path(key, index).is_some_and(|path| path.is_file())
    }

    /// Keeps a block. Where that fails, it is fetched again the next time.
    pub(super) fn put(&self, key: &str, index: u64, bytes: &[u8]) {
        let size = (bytes.len() + TAIL) as u64;
        let Some(path) = self.path(key, index).filter(|_| size <= self.limit) else { return };
        if self.write(&path, bytes).is_err() {
            return;
        }
        let since = self.since.fetch_add(size, Ordering::Relaxed) + size;
        if self.held.load(Ordering::Relaxed) == UNKNOWN || since > self.limit / COUNT_EVERY {
            let found = self.files().iter().map(|(_, size, _)| size).sum::<u64>();
            self.held.store(found, Ordering::Relaxed);
            self.since.store(0, Ordering::Relaxed);
        } else {
            self.held.fetch_add(size, Ordering::Relaxed);
        }
        if self.held.load(Ordering::Relaxed) > self.limit {
            self.clean();
        }
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        fs::create_dir_all(path.parent().unwrap_or(path))?;
        // Renamed into place, so that nobody reads half of it. After a loss of power, its checksum shows whether it is whole.
        let draft = draft(path);
        let whole = [bytes, &crc32fast::hash(bytes).to_le_bytes()].concat();
        let written = fs::write(&draft, whole).and_then(|()| fs::rename(&draft, path));
        written.inspect_err(|_| drop(fs::remove_file(&draft)))
    }

    /// All blocks: when they were read, their bytes, where they are.
    fn files(&self) -> Vec<(SystemTime, u64, PathBuf)> {
        let below = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
        let folder = self.folder.as_deref().unwrap_or(Path::new(""));
        let mut found = Vec::new();
        for file in
            below(folder).flat_map(|start| below(&start.path())).flat_map(|object| below(&object.path()))
        {
            if let Ok(about) = file.metadata() {
                found.push((about.modified().unwrap_or(SystemTime::UNIX_EPOCH), about.len(), file.path()));
            }
        }
        found
    }

    /// Removes the oldest blocks, until a fifth is free.
    fn clean(&self) {
        let Ok(_one) = self.cleaner.try_lock() else { return };
        let mut files = self.files();
        files.sort();
        let mut held: u64 = files.iter().map(|(_, size, _)| size).sum();
        for (_, size, path) in files {
            if held <= self.limit / 5 * 4 {
                break;
            }
            if fs::remove_file(&path).is_ok() {
                held = held.saturating_sub(size);
                // Only where nothing else is in it.
                let _ = path.parent().map(fs::remove_dir);
            }
        }
        self.held.store(held, Ordering::Relaxed);
        self.since.store(0, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_kept_checked_and_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let blocks = Blocks::new(Some(folder.path()), 10_000);
        let bytes = |index: u64| vec![index as u8; 996];
        blocks.put("abcd", 0, &bytes(0));
        assert_eq!(blocks.get("abcd", 0, 996), Some(bytes(0)));
        assert_eq!(blocks.get("abcd", 0, 995), None, "it has another length");
        assert_eq!(blocks.get("abcd", 1, 996), None);
        let path = blocks.path("abcd", 0).unwrap();
        let mut stored = fs::read(&path).unwrap();
        stored[5] ^= 1;
        fs::write(&path, stored).unwrap();
        assert_eq!(blocks.get("abcd", 0, 996), None, "a block that was changed on disk is not read");
        assert!(!blocks.has("abcd", 0));
        for index in 0..30 {
            blocks.put("abcd", index, &bytes(index));
            let _ = File::open(blocks.path("abcd", index).unwrap())
                .and_then(|file| file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(index)));
            let held: u64 = blocks.files().iter().map(|(_, size, _)| size).sum();
            assert!(held <= 11_000, "{held}");
        }
        assert!(blocks.has("abcd", 29) && !blocks.has("abcd", 0), "the oldest went");
    }

    #[test]
    fn processes_share_one_limit() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = [0, 1].map(|_| Blocks::new(Some(folder.path()), 100_000));
        for index in 0..400 {
            let blocks = if index % 2 == 0 { &one } else { &other };
            blocks.put("abcd", index, &vec![7; 996]);
            let held: u64 = one.files().iter().map(|(_, size, _)| size).sum();
            assert!(held <= 115_000, "{held} bytes after {index} blocks");
        }
        let kept = (0..400).filter(|&index| other.get("abcd", index, 996) == Some(vec![7; 996])).count();
        assert!(kept > 60, "{kept} blocks are kept, whoever wrote them");
    }
}
