//! A folder of the parts of one recording, read as one dataset: the folder itself, or `parts` in it.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::{Metadata, Registry};

use super::parts::{part_of, sort};
use crate::adapt::Concat;
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::format;

/// Where the parts lie in the folder of a job.
const PARTS: &str = "parts";

/// The datasets in a folder that is no dataset itself, in the order of their names; empty if there are none. Only names with
/// the extension of a format count, so that unfinished files do not.
///
/// # Errors
///
/// The folder cannot be listed.
pub fn datasets_in(registry: &Registry, folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    if !folder.is_dir() || format::detect(registry, folder).is_some() {
        return Ok(Vec::new());
    }
    let parts = folder.join(PARTS);
    let folder = if parts.is_dir() { &parts } else { folder };
    let failed = |source| DataError::io(folder, "list", source);
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        if format::by_name(registry, extension).is_ok_and(|format| format.detect(&path)) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// Opens a folder of parts as one dataset: the episodes of the parts that are there, in the order of the recording. `None`: the
/// first dataset in it is no part, or there is none.
///
/// # Errors
///
/// A dataset in it cannot be opened, is no part, or is a part of another recording.
pub(crate) fn open(registry: &Registry, folder: &Path) -> Result<Option<Box<dyn Dataset>>, DataError> {
    let paths = datasets_in(registry, folder)?;
    let mut datasets = Vec::with_capacity(paths.len());
    for path in &paths {
        let dataset = format::open_in(registry, path)?;
        if part_of(dataset.as_ref()).is_none() {
            // The first says whether the folder is of parts, so that others are not read through.
            if datasets.is_empty() {
                return Ok(None);
            }
            let reason = "it lies among the parts of a recording, but is none; move it to another folder";
            return Err(DataError::request(path, reason));
        }
        datasets.push(dataset);
    }
    if datasets.is_empty() {
        return Ok(None);
    }
    let mut whole = Concat::new(sort(datasets)?)?;
    // The whole is no part, and its parts were one run.
    let mut runs: Vec<(u64, Metadata)> = Vec::new();
    for (first, run) in &*whole.info().runs {
        let run = Metadata { part: None, ..run.clone() };
        if runs.last().is_none_or(|(_, last)| *last != run) {
            runs.push((*first, run));
        }
    }
    whole.rename(folder, runs);
    Ok(Some(Box::new(whole)))
}
