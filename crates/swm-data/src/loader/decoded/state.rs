//! Whether a dataset is still the one whose images were decoded.

use std::fs;
use std::io;
use std::path::Path;
use std::time::UNIX_EPOCH;

use swm_core::evaluate::sha256;
use swm_files::remote::is_remote;

use crate::dataset::{DatasetInfo, Origin};
use crate::error::DataError;

/// A digest of what may change in a dataset: its files by length and time of change, its episodes and runs.
pub(super) fn state(info: &DatasetInfo, origin: &Origin) -> Result<String, DataError> {
    let mut text = format!("{:?}\n", info.lengths);
    let runs = serde_json::to_string(&*info.runs).map_err(|error| DataError::record(&info.path, error))?;
    text.push_str(&runs);
    for path in &origin.paths {
        if is_remote(path) {
            text.push_str(&swm_files::remote::digest(path)?);
        } else {
            add_files(path, &mut text).map_err(|error| DataError::io(path, "read", error))?;
        }
    }
    Ok(sha256(text.as_bytes()))
}

/// A line for each file of a dataset.
fn add_files(path: &Path, text: &mut String) -> io::Result<()> {
    let there = fs::metadata(path)?;
    if there.is_dir() {
        let mut names = fs::read_dir(path)?
            .map(|entry| entry.map(|entry| entry.file_name()))
            .collect::<io::Result<Vec<_>>>()?;
        names.sort_unstable();
        text.push_str(&format!("\nfolder of {}", names.len()));
        return names.iter().try_for_each(|name| {
            text.push_str(&format!("\n{name:?} "));
            add_files(&path.join(name), text)
        });
    }
    let changed = there.modified()?.duration_since(UNIX_EPOCH).unwrap_or_default();
    text.push_str(&format!("{} {}", there.len(), changed.as_nanos()));
    Ok(())
}
