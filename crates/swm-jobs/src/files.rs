//! Small files of a job, and lists of shards.

use std::fs;
use std::io;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;
use serde::de::DeserializeOwned;
use swm_tasks::request::cannot;

use crate::error::JobError;
use swm_tasks::text_file::{read_text, replace_text};

/// Writes a file as a whole: readers see the old one or the new one.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), JobError> {
    let text = serde_json::to_string_pretty(value)? + "\n";
    Ok(replace_text(path, &text).map_err(cannot("write", path))?)
}

/// Reads a file that [`write_json`] wrote; `None` if it is not there, or empty, as a loss of power or a full disk leaves it.
///
/// # Errors
///
/// It cannot be read, or is not such a file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, JobError> {
    match read_text(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(cannot("read", path)(error).into()),
        Ok(text) if text.trim().is_empty() => Ok(None),
        Ok(text) => {
            Ok(Some(serde_json::from_str(&text).map_err(|error| cannot("read", path)(error.into()))?))
        }
    }
}

/// Whether a file that [`write_json`] writes is there, and not emptied by a loss of power.
pub fn is_written(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|there| there.is_file() && there.len() > 0)
}

/// Ascending numbers as `1-3,7`.
pub fn ranges<'a>(numbers: impl IntoIterator<Item = &'a u64>) -> String {
    let mut runs: Vec<(u64, u64)> = Vec::new();
    for &number in numbers {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == number => *last = number,
            _ => runs.push((number, number)),
        }
    }
    let text = |(first, last): (u64, u64)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    runs.into_iter().map(text).collect::<Vec<_>>().join(",")
}

/// Seconds since 1970.
#[expect(clippy::disallowed_methods, reason = "it says when a job was submitted, and is in no result")]
pub(crate) fn now() -> u64 {
    seconds(SystemTime::now())
}

/// A point in time as seconds since 1970.
pub(crate) fn seconds(time: SystemTime) -> u64 {
    time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// The name of this machine, as the system gives it.
pub fn node() -> String {
    let named = std::env::var("SLURMD_NODENAME").ok();
    let named = named.or_else(|| fs::read_to_string("/proc/sys/kernel/hostname").ok());
    named.or_else(|| std::env::var("HOSTNAME").ok()).map_or_else(String::new, |name| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_are_one_range() {
        assert_eq!(ranges([]), "");
        assert_eq!(ranges(&[3]), "3");
        assert_eq!(ranges(&[1, 2, 3, 7, 9, 10]), "1-3,7,9-10");
    }

    #[test]
    fn files_are_written_as_a_whole_and_their_sizes_are_known() {
        let folder = tempfile_folder();
        let path = folder.join("a.json");
        assert_eq!(read_json::<u64>(&path).unwrap(), None);
        write_json(&path, &7).unwrap();
        assert_eq!(read_json::<u64>(&path).unwrap(), Some(7));
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        let message = write_json(&folder.join("none/a.json"), &7).unwrap_err().to_string();
        assert!(message.contains("cannot write") && message.contains("none"), "{message}");
        fs::write(&path, "").unwrap();
        assert_eq!(read_json::<u64>(&path).unwrap(), None);
        fs::write(&path, "{").unwrap();
        assert!(read_json::<u64>(&path).unwrap_err().to_string().contains("cannot read"));
        fs::remove_dir_all(folder).unwrap();
    }

    fn tempfile_folder() -> std::path::PathBuf {
        let folder = std::env::temp_dir().join(format!("swm-files-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }
}
