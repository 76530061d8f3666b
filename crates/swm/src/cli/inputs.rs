//! Datasets that a command reads. One that is not there is a wrong request, as any other file that is named and not there;
//! one that is there and cannot be read is a failure of the work.

use std::io::ErrorKind;
use std::path::Path;

use swm_core::Registry;
use swm_data::{DataError, Dataset};

use super::{Failure, usage};

/// Opens a dataset that the user named.
pub(super) fn open(registry: &Registry, path: &Path) -> Result<Box<dyn Dataset>, Failure> {
    check_exists(path)?;
    Ok(swm_data::open_in(registry, path)?)
}

/// Refuses a path where nothing is.
pub(super) fn check_exists(path: &Path) -> Result<(), Failure> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => Err(usage(DataError::io(path, "open", error))),
        // What else stands in the way is told when it is opened.
        _ => Ok(()),
    }
}
