//! Whole copies of objects and folders, for formats that are not read by position.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::thread;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use super::address::Address;
use super::copies::{Used, wait_for};
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::folder::Folder;
use super::found::Found;
use super::list::{Entry, check_names};
use super::object::Object;
use super::settings::Settings;
use super::sign::hex;
use crate::folders::{beside, is_plain_name};
use crate::lock::WriterLock;

/// Files that are fetched at a time.
const AT_ONCE: usize = 8;

/// What happens while something is fetched as a whole.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// It begins.
    Begin {
        /// What is fetched.
        name: &'a str,
        /// All of its bytes.
        bytes: u64,
        /// How many of them are here already.
        done: u64,
        /// Where it is put.
        to: &'a Path,
    },
    /// So many more bytes are here.
    More(u64),
    /// All is here, or it failed.
    End,
}

/// What gets the events of this process.
type Watcher = Arc<dyn Fn(&Event<'_>) + Send + Sync>;

static WATCHER: RwLock<Option<Watcher>> = RwLock::new(None);

/// Sets the function that gets the events of what is fetched as a whole: its size before it begins, and its progress. A program sets this once.
pub fn watch(watcher: impl Fn(&Event<'_>) + Send + Sync + 'static) {
    *WATCHER.write().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(watcher));
}

fn tell(event: &Event<'_>) {
    let watcher = WATCHER.read().unwrap_or_else(PoisonError::into_inner).clone();
    if let Some(watcher) = watcher {
        watcher(event);
    }
}

impl Found {
    /// The copy in the cache of what is at this path, which is made if it is not there. It stays while the other value does.
    ///
    /// # Errors
    ///
    /// There is no room for it, or it cannot be fetched.
    pub fn cached(&self, path: &Path) -> Result<(PathBuf, Used), RemoteError> {
        let address = Address::of(path)?;
        let (name, file_name) = (&address.name(), address.file_name());
        let settings = self.settings();
        let Some(cache) = &settings.cache else {
            let reason = "neither SWM_CACHE nor HOME is set, so there is no place for a copy";
            return Err(RemoteError::new(Kind::Cache, name, reason, "set SWM_CACHE to a folder"));
        };
        let nonce = || format!("{}-{:?}", std::process::id(), thread::current().id()).replace(['(', ')'], "");
        let key = self.key().unwrap_or_else(nonce);
        let file_name = if is_plain_name(file_name) { file_name } else { "dataset" };
        let copies = cache.join("copies");
        let mut used = Used::of(&copies, &key).map_err(|error| RemoteError::cache(name, &copies, &error))?;
        let to = copies.join(&key).join(file_name);
        if !to.exists() {
            used.reserve(name, &copies, self.bytes(), settings.cache_bytes)?;
            self.copy(name, &to, &key)?;
        }
        Ok((to, used))
    }

    /// What is set for its server, and for what is kept of it.
    pub(super) fn settings(&self) -> &Settings {
        match self {
            Self::Object(object) => &object.remote.client.settings,
            Self::Folder(folder) => &folder.remote.client.settings,
        }
    }

    /// All of its bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Object(object) => object.length(),
            Self::Folder(folder) => {
                folder.files().into_iter().flatten().map(|(_, entry)| entry.size).fold(0, u64::saturating_add)
            }
        }
    }

    /// Copies it to a place where nothing is; a copy of this version that was interrupted is continued.
    pub(super) fn copy(&self, name: &str, to: &Path, key: &str) -> Result<(), RemoteError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |error: io::Error| RemoteError::cache(name, &path, &error)
        };
        let parent = to.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(failed(parent))?;
        let draft = beside(to, &format!(".{}.part", key.get(..8).unwrap_or(key)));
        // Another process may make the same copy.
        let _lock = wait_for(name, Duration::from_millis(200), || WriterLock::take(&draft))?;
        if to.exists() {
            return Ok(());
        }
        let result = match self {
            Self::Object(object) => {
                let done = fs::metadata(&draft).map_or(0, |there| there.len());
                tell(&Event::Begin { name, bytes: object.length(), done, to });
                file(object, &draft)
            }
            Self::Folder(folder) => files(folder, name, &draft, to),
        };
        tell(&Event::End);
        result?;
        fs::rename(&draft, to).map_err(failed(to))
    }
}

/// A file whose growth is an event.
struct Watched(File);

impl Write for Watched {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.0.write(bytes)?;
        tell(&Event::More(count as u64));
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Fetches what is missing at the end of a file.
fn file(object: &Object, draft: &Path) -> Result<(), RemoteError> {
    let name = &object.link.name;
    let failed = |error: io::Error| RemoteError::cache(name, draft, &error);
    let mut out = OpenOptions::new().create(true).append(true).open(draft).map_err(failed)?;
    let mut there = out.metadata().map_err(failed)?.len();
    if there > object.length() || there > 0 && !object.is_ranged() {
        out.set_len(0).map_err(failed)?;
        there = 0;
    }
    if there < object.length() {
        out.flush().map_err(failed)?;
        let mut watched = Watched(out);
        object.remote.client.read(
            &object.link,
            there..object.length(),
            Some(&object.version),
            &mut watched,
        )?;
        out = watched.0;
    }
    out.sync_all().map_err(failed)?;
    let Some(expected) = &object.sha256 else { return Ok(()) };
    let mut hash = Sha256::new();
    File::open(draft).and_then(|mut file| io::copy(&mut file, &mut hash)).map_err(failed)?;
    if hex(&hash.finalize()) == *expected {
        return Ok(());
    }
    let _ = fs::remove_file(draft);
    let reason = "what arrived has another SHA-256 than its list says";
    Err(RemoteError::new(Kind::Answer, name, reason, "fetch it again"))
}

/// Fetches the missing files of a folder, several at a time.
fn files(folder: &Folder, name: &str, draft: &Path, to: &Path) -> Result<(), RemoteError> {
    let Some(all) = folder.files() else {
        let reason = "its server gives no list of files";
        let fix = "name one file, or use a store that gives lists: s3:// or hf://";
        return Err(RemoteError::new(Kind::Answer, name, reason, fix));
    };
    check_names(name, all)?;
    let failed = |path: &Path, error: &io::Error| RemoteError::cache(name, path, error);
    let place = |path: &str| path.split('/').fold(draft.to_owned(), |place, part| place.join(part));
    // A file that is whole has its name.
    let part = |path: &str| beside(&place(path), ".part");
    let size = |path: &Path| fs::metadata(path).map_or(0, |there| there.len());
    let missing: Vec<(&String, &Entry)> = all.iter().filter(|(path, _)| !place(path).is_file()).collect();
    let bytes = all.values().map(|entry| entry.size).fold(0, u64::saturating_add);
    let left = missing.iter().map(|(path, entry)| entry.size.saturating_sub(size(&part(path))));
    let done = bytes.saturating_sub(left.fold(0, u64::saturating_add));
    tell(&Event::Begin { name, bytes, done, to });
    fs::create_dir_all(draft).map_err(|error| failed(draft, &error))?;
    let one = |path: &str, entry: &Entry| -> Result<(), RemoteError> {
        let (whole, part) = (place(path), part(path));
        let parent = whole.parent().unwrap_or(draft);
        fs::create_dir_all(parent).map_err(|error| failed(parent, &error))?;
        file(&folder.entry(path, entry)?, &part)?;
        fs::rename(&part, &whole).map_err(|error| failed(&whole, &error))
    };
    let (next, is_over, first) = (AtomicUsize::new(0), AtomicBool::new(false), Mutex::new(None));
    thread::scope(|scope| {
        for _ in 0..AT_ONCE.min(missing.len()) {
            scope.spawn(|| {
                while let Some((path, entry)) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if is_over.load(Ordering::Relaxed) {
                        return;
                    }
                    if let Err(error) = one(path, entry) {
                        is_over.store(true, Ordering::Relaxed);
                        first.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                    }
                }
            });
        }
    });
    first.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
}
