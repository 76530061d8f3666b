//! Datasets that a command reads. One that is not there is a wrong request, as any other file that is named and not there;
//! one that is there and cannot be read is a failure of the work.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use swm_core::Registry;
use swm_data::remote::is_remote;
use swm_data::tools::alike::rate_doubt;
use swm_data::tools::copy::{Piece, is_same};
use swm_data::{DataError, Dataset, OpenOptions};
use swm_tasks::request;

pub(super) use request::check_recorded_in as check_env;

use super::{Failure, Output, usage};

/// Opens a dataset that the user named.
pub(super) fn open(registry: &Registry, path: &Path) -> Result<Box<dyn Dataset>, Failure> {
    Ok(request::open_dataset(registry, path)?)
}

/// Opens a dataset that the user named, as the options describe it.
pub(super) fn open_with(
    registry: &Registry,
    path: &Path,
    how: &OpenOptions,
) -> Result<Box<dyn Dataset>, Failure> {
    Ok(request::open_dataset_with(registry, path, how)?)
}

/// Refuses a path where nothing is.
pub(super) fn check_exists(path: &Path) -> Result<(), Failure> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound && !is_remote(path) => {
            Err(usage(DataError::io(path, "open", error)))
        }
        // What else stands in the way is told when it is opened.
        _ => Ok(()),
    }
}

/// Refuses to write to one of the datasets that are read.
pub(super) fn check_target(sources: &[Box<dyn Dataset>], to: &Path) -> Result<(), Failure> {
    match sources.iter().find(|source| is_same(source.path(), to)) {
        Some(_) => {
            let to = to.display();
            Err(usage(format!(
                "{to} is the dataset to read and the one to write; write to another file or folder"
            )))
        }
        None => Ok(()),
    }
}

/// Refuses to read a dataset twice, by whatever paths and links it is named.
pub(super) fn check_distinct(paths: &[PathBuf]) -> Result<(), Failure> {
    for (index, path) in paths.iter().enumerate() {
        if let Some(other) = paths[..index].iter().find(|other| is_same(other, path)) {
            let named = match other == path {
                true => format!("{} is named twice", path.display()),
                false => format!("{} and {} are the same dataset", other.display(), path.display()),
            };
            return Err(usage(format!(
                "{named}; every episode of it would be in the result twice: name it once"
            )));
        }
    }
    Ok(())
}

/// Refuses a copy whose rate is in doubt, before anything is written; with `--fps`, says that this decides.
pub(super) fn check_rate(
    sources: &mut [Box<dyn Dataset>],
    pieces: &[Piece],
    fps: Option<f64>,
    output: &Output,
) -> Result<(), Failure> {
    match (rate_doubt(sources, pieces), fps) {
        (None, _) => {}
        (Some(doubt), None) => return Err(usage(DataError::from(doubt))),
        (Some(doubt), Some(rate)) => output.note(format!("note: {doubt}; the copy has {rate}, by --fps")),
    }
    Ok(())
}
