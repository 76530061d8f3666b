//! Hashes of files and folders.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::evaluate::{sha256, sha256_of};

use crate::error::{FileError, TaskError, cannot};

/// SHA-256 of a file; of a folder, that of its files' names and hashes in order; of a dataset that lies elsewhere, that of its version.
///
/// # Errors
///
/// A file or folder cannot be read.
pub fn file_hash(path: &Path) -> Result<String, TaskError> {
    let failed = cannot("read", path);
    if swm_files::remote::is_remote(path) {
        return Ok(swm_files::remote::digest(path)?);
    }
    if !path.is_dir() {
        if !fs::metadata(path).map_err(failed)?.is_file() {
            return Err(format!("cannot read {}: it is no regular file", path.display()).into());
        }
        return Ok(fs::File::open(path).and_then(sha256_of).map_err(failed)?);
    }
    let mut files: Vec<PathBuf> = fs::read_dir(path)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect())
        .map_err(failed)?;
    files.sort();
    let mut all = String::new();
    for file in files {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        all += &format!("{name} {}\n", file_hash(&file)?);
    }
    Ok(sha256(all.as_bytes()))
}

/// The size of a file in bytes; of a folder, that of all files below it, where links are not followed.
///
/// # Errors
///
/// It is not there, or cannot be read.
pub fn file_bytes(path: &Path) -> Result<u64, FileError> {
    swm_files::size(path).map_err(cannot("read", path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_a_folder_is_that_of_its_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("below")).unwrap();
        fs::write(at("a"), "1").unwrap();
        fs::write(at("below/b"), "four").unwrap();
        assert_eq!((file_bytes(&at("a")).unwrap(), file_bytes(folder.path()).unwrap()), (1, 5));
        let error = file_bytes(&at("none")).unwrap_err();
        assert_eq!((error.action, &error.path), ("read", &at("none")));
    }

    #[test]
    fn what_has_no_end_is_refused() {
        if cfg!(target_os = "linux") {
            assert!(file_hash(Path::new("/dev/zero")).unwrap_err().to_string().contains("no regular file"));
        }
    }
}
