//! Whether episodes can continue a dataset of this program, and what its record of runs becomes. What all formats agree
//! on, apart from how they store it.

use std::path::{Path, PathBuf};

use swm_core::env::VARIATION_PREFIX;
use swm_core::settings::assignments;
use swm_core::{Field, Metadata};

use crate::error::DataError;

/// Whether episodes with these columns and settings continue a dataset with those of `columns` and its `first` run.
///
/// # Errors
///
/// [`DataError::Mismatch`], which names the first difference.
pub fn check_fit(
    path: &Path,
    columns: &[Field],
    first: &Metadata,
    fields: &[Field],
    metadata: &Metadata,
) -> Result<(), DataError> {
    let mismatch = |reason| Err(DataError::mismatch(path, reason));
    // Another environment has other columns, but that is not what is wrong.
    if let Some([there, here]) = difference(first, metadata) {
        return mismatch(format!("it {there}, what is added {here}"));
    }
    if first.image != metadata.image {
        let [there, here] = [first, metadata].map(|run| match run.image {
            Some(size) => format!("images of {size}"),
            None => "no images".to_owned(),
        });
        return mismatch(format!(
            "it was recorded with {there}, what is added with {here}; record it with {there}, too"
        ));
    }
    for field in fields {
        match columns.iter().find(|there| there.name == field.name) {
            None if field.name.starts_with(VARIATION_PREFIX) => {
                return mismatch(format!(
                    "it has no column `{}`, as its episodes were recorded without varying it; record to another file, and join \
                     the two by `swm merge`, which fills in the constant",
                    field.name
                ));
            }
            None => return mismatch(format!("it has no column `{}`", field.name)),
            Some(there) if there != field => {
                return mismatch(format!(
                    "its column `{}` holds {} {:?} per {:?}, not {} {:?} per {:?}",
                    field.name, there.dtype, there.shape, there.kind, field.dtype, field.shape, field.kind
                ));
            }
            Some(_) => {}
        }
    }
    if let Some(missing) = columns.iter().find(|there| fields.iter().all(|field| field.name != there.name)) {
        return mismatch(format!("the new episodes have no column `{}`", missing.name));
    }
    Ok(())
}

/// How two runs differ in what all episodes of a dataset share (environment, settings, frame skip), as a sentence goes on about each.
pub(crate) fn difference(here: &Metadata, there: &Metadata) -> Option<[String; 2]> {
    let runs = [here, there];
    if here.env != there.env {
        return Some(runs.map(|run| match run.known_env() {
            Some(env) => format!("was recorded in {env}"),
            None => "does not say how it was recorded".to_owned(),
        }));
    }
    if here.settings != there.settings {
        return Some(runs.map(|run| format!("was recorded with {}", settings_text(&run.settings))));
    }
    let skips = || runs.map(|run| format!("was recorded with frame skip {}", run.frame_skip));
    (here.frame_skip != there.frame_skip).then(skips)
}

/// Settings as people write them: `damping=0.5, friction=2`.
fn settings_text(settings: &serde_json::Map<String, serde_json::Value>) -> String {
    match settings.is_empty() {
        true => "the default settings".to_owned(),
        false => assignments(settings).collect::<Vec<_>>().join(", "),
    }
}

/// The error for a dataset of another program.
pub fn foreign(path: &Path) -> DataError {
    DataError::mismatch(path, "it was made by another program, whose layout is not crash-safe")
}

/// The record of runs when a run goes on at episode `first`: one that was killed before its first episode is
/// forgotten, and one that equals the run before it needs no record of its own.
pub fn with_run(runs: &[(u64, Metadata)], first: u64, metadata: &Metadata) -> Vec<(u64, Metadata)> {
    let mut runs: Vec<_> = runs.iter().filter(|&&(at, _)| at < first).cloned().collect();
    if runs.last().is_none_or(|(_, last)| last != metadata) {
        runs.push((first, metadata.clone()));
    }
    runs
}

/// Refuses to change a dataset parts of which may belong to another: a folder with symbolic links below it, a file with
/// a second name, under which another writer would not be seen.
///
/// # Errors
///
/// [`DataError::Record`], which names the link; or the dataset cannot be looked at.
pub(crate) fn check_own(path: &Path) -> Result<(), DataError> {
    let failed = |source| DataError::io(path, "open", source);
    let there = std::fs::metadata(path).map_err(failed)?;
    let names = swm_files::link_count(&there);
    if there.is_dir() {
        let Some(link) = swm_files::first_link(path).map_err(failed)? else { return Ok(()) };
        let reason = format!(
            "`{}` is a symbolic link, and what it leads to may not be the dataset's; such datasets are read, not changed: \
             copy it without links, as by `cp -rL`",
            link.strip_prefix(path).unwrap_or(&link).display()
        );
        return Err(DataError::record(path, reason));
    }
    if names > 1 {
        let reason = format!(
            "the file has {names} names (hard links), and a writer by another of them would not be seen; copy the file, \
             and use the copy"
        );
        return Err(DataError::record(path, reason));
    }
    Ok(())
}

/// The dataset itself, if `path` is a link to it, so that the lock is on it and not on one of its names.
///
/// # Errors
///
/// A link leads nowhere, or to itself.
pub fn resolve(path: &Path) -> Result<PathBuf, DataError> {
    if path.exists() {
        return std::fs::canonicalize(path).map_err(|source| DataError::io(path, "open", source));
    }
    Ok(path.to_owned())
}
