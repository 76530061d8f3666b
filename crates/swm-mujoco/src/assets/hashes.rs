//! SHA-256 of files, remembered by size and times between runs: hashing the library and the models takes 30 ms or more,
//! looking at them none.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};
use swm_core::evaluate::sha256_of;

/// A longer list is not ours.
const MAX_BYTES: u64 = 1 << 20;
/// More files are forgotten: paths of folders that are gone.
const MAX_FILES: usize = 2000;
/// A file that changed less than this ago may change again without another time.
const SETTLED: Duration = Duration::from_secs(2);

/// Hashes by path.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Hashes {
    files: BTreeMap<String, Known>,
    #[serde(skip)]
    has_news: bool,
}

#[derive(Debug, Serialize, Deserialize)]
struct Known {
    /// Size, times and number of the file when it was hashed.
    stamp: String,
    sha256: String,
}

/// Does something with the hashes that this user has; new ones are kept for the next run, where they can be.
pub(super) fn with_hashes<T>(work: impl FnOnce(&mut Hashes) -> T) -> T {
    static HASHES: Mutex<Option<Hashes>> = Mutex::new(None);
    let mut hashes = HASHES.lock().unwrap_or_else(PoisonError::into_inner);
    let place = list_from(|name| std::env::var_os(name), std::env::consts::OS);
    let hashes = hashes.get_or_insert_with(|| place.as_deref().map(Hashes::read).unwrap_or_default());
    let result = work(hashes);
    if let Some(place) = place.filter(|_| std::mem::take(&mut hashes.has_news)) {
        // Without it, the next run hashes again.
        let _ = hashes.write(&place);
    }
    result
}

/// Where the list is: in the folder that the system has for caches.
fn list_from(variable: impl Fn(&str) -> Option<OsString>, os: &str) -> Option<PathBuf> {
    let set = |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = match os {
        "macos" => set("HOME").map(|home| home.join("Library/Caches")),
        "windows" => set("LOCALAPPDATA"),
        _ => set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|home| home.join(".cache"))),
    };
    Some(folder?.join("stable-worldmodel").join("hashes.json"))
}

impl Hashes {
    fn read(list: &Path) -> Self {
        let is_ours =
            fs::symlink_metadata(list).is_ok_and(|there| there.is_file() && there.len() < MAX_BYTES);
        let text = if is_ours { fs::read(list).ok() } else { None };
        text.and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    }

    fn write(&mut self, list: &Path) -> io::Result<()> {
        if self.files.len() > MAX_FILES {
            self.files.retain(|path, _| Path::new(path).exists());
        }
        if let Some(folder) = list.parent() {
            fs::create_dir_all(folder)?;
        }
        let draft = list.with_extension(format!("{}.new", std::process::id()));
        fs::write(&draft, serde_json::to_vec(self)?)?;
        fs::rename(&draft, list).inspect_err(|_| drop(fs::remove_file(&draft)))
    }

    /// The SHA-256 of a regular file.
    ///
    /// # Errors
    ///
    /// The file cannot be read.
    pub(super) fn of(&mut self, path: &Path) -> io::Result<String> {
        let file = File::open(path)?;
        let there = file.metadata()?;
        if !there.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no regular file"));
        }
        let (key, stamp) = (path.to_string_lossy().into_owned(), stamp(&there));
        if let Some(known) = self.files.get(&key).filter(|known| known.stamp == stamp) {
            return Ok(known.sha256.clone());
        }
        let sha256 = sha256_of(file)?;
        #[expect(clippy::disallowed_methods, reason = "decides what is remembered, never a result")]
        let now = SystemTime::now();
        let is_settled = |time: SystemTime| now.duration_since(time).is_ok_and(|age| age > SETTLED);
        if times(&there).into_iter().all(is_settled) {
            self.files.insert(key, Known { stamp, sha256: sha256.clone() });
            self.has_news = true;
        }
        Ok(sha256)
    }
}

/// When the content changed; on Unix, also when anything about the file did, which no program can set back.
fn times(file: &Metadata) -> Vec<SystemTime> {
    #[cfg_attr(not(unix), expect(unused_mut, reason = "there is one time"))]
    let mut times: Vec<SystemTime> = file.modified().into_iter().collect();
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let since = Duration::new(file.ctime().unsigned_abs(), file.ctime_nsec() as u32);
        times.extend(SystemTime::UNIX_EPOCH.checked_add(since));
    }
    times
}

fn stamp(file: &Metadata) -> String {
    let nanoseconds = |time: SystemTime| {
        time.duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_nanos()).to_string()
    };
    let mut parts = vec![file.len().to_string()];
    parts.extend(times(file).into_iter().map(nanoseconds));
    #[cfg(unix)]
    parts.push(std::os::unix::fs::MetadataExt::ino(file).to_string());
    parts.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: &str = "ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb";
    const B: &str = "3e23e8160039594a33894f6564e1b1348bbd7a0088d42c4acb73eeaed59c009d";

    #[test]
    fn a_file_that_changed_is_hashed_again_whatever_its_time_says() {
        let folder = tempfile::tempdir().unwrap();
        let (path, list) = (folder.path().join("x"), folder.path().join("cache/list.json"));
        fs::write(&path, "a").unwrap();
        let old = fs::metadata(&path).unwrap().modified().unwrap() - Duration::from_secs(1000);
        let set_back = || File::options().write(true).open(&path).unwrap().set_modified(old).unwrap();
        set_back();
        let mut hashes = Hashes::default();
        assert_eq!(hashes.of(&path).unwrap(), A);
        // Once the file is settled, the hash is kept.
        std::thread::sleep(SETTLED + Duration::from_millis(200));
        assert_eq!(hashes.of(&path).unwrap(), A);
        assert!(hashes.has_news);
        hashes.write(&list).unwrap();
        let mut hashes = Hashes::read(&list);
        let key = path.to_str().unwrap();
        assert_eq!(hashes.files[key].sha256, A);
        hashes.files.get_mut(key).unwrap().sha256 = "kept".to_owned();
        assert_eq!(hashes.of(&path).unwrap(), "kept");
        if cfg!(unix) {
            fs::write(&path, "b").unwrap();
            set_back();
            assert_eq!(hashes.of(&path).unwrap(), B);
        }
    }

    #[test]
    fn lists_of_others_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("list.json");
        assert!(Hashes::read(&list).files.is_empty());
        for text in ["", "[]", r#"{"files": 3}"#] {
            fs::write(&list, text).unwrap();
            assert!(Hashes::read(&list).files.is_empty(), "{text}");
        }
        assert!(Hashes::default().of(folder.path()).is_err());
    }

    #[test]
    fn the_list_lies_where_the_system_has_caches() {
        let all = [("XDG_CACHE_HOME", "/x"), ("HOME", "/h"), ("LOCALAPPDATA", "/l")];
        let place = |os: &str, variables: &[(&str, &str)]| {
            let find =
                |name: &str| variables.iter().find(|(key, _)| *key == name).map(|(_, value)| value.into());
            list_from(find, os)
        };
        let expect = |os: &str, variables: &[(&str, &str)], path: &str| {
            assert_eq!(place(os, variables), Some(PathBuf::from(path).join("stable-worldmodel/hashes.json")));
        };
        expect("linux", &all, "/x");
        expect("linux", &[("XDG_CACHE_HOME", "relative"), ("HOME", "/h")], "/h/.cache");
        if cfg!(unix) {
            expect("macos", &all, "/h/Library/Caches");
        }
        assert_eq!(place("linux", &[]), None);
    }
}
