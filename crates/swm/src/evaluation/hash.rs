//! Hashes of files and folders.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::error::BoxError;
use swm_core::evaluate::sha256;

/// SHA-256 of a file; of a folder, that of its files' names and hashes in order.
///
/// # Errors
///
/// A file or folder cannot be read.
pub fn file_hash(path: &Path) -> Result<String, BoxError> {
    let failed = |error: std::io::Error| format!("cannot read {}: {error}", path.display());
    if !path.is_dir() {
        return Ok(sha256(&fs::read(path).map_err(failed)?));
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
