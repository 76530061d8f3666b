//! Datasets that a command reads. One that is not there is a wrong request, as any other file that is named and not there;
//! one that is there and cannot be read is a failure of the work.

use std::path::Path;

use swm_core::Registry;
use swm_data::{Dataset, OpenOptions};
use swm_tasks::request;

use super::Failure;

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
