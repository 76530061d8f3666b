//! For tests of datasets that lie elsewhere.

use std::path::Path;

use swm_core::{Column, Registry};
use swm_files::remote::testing::Hosted;

use crate::dataset::{Dataset, Steps};
use crate::elsewhere::open_from;
use crate::error::DataError;
use crate::format::Opened;
use crate::open_options::OpenOptions;

/// Opens an address of a server of this machine, as [`open_with`](crate::open_with) opens others.
///
/// # Errors
///
/// As of [`open_with`](crate::open_with).
pub fn open_hosted(
    hosted: &Hosted,
    registry: &Registry,
    path: &Path,
    options: &OpenOptions,
) -> Opened<dyn Dataset> {
    open_from(&hosted.remote, registry, path, options)
}

/// All rows of all columns, one after the other.
///
/// # Errors
///
/// As of [`Dataset::rows`].
pub fn rows(dataset: &mut dyn Dataset) -> Result<Vec<Column>, DataError> {
    let mut all = Vec::new();
    for column in 0..dataset.schema().fields().len() {
        for episode in 0..dataset.num_episodes() {
            let (field, count) = (dataset.schema().fields()[column].clone(), dataset.episode_len(episode));
            let mut out = Column::zeros(field.dtype, count * field.dim());
            dataset.rows(column, episode, Steps { first: 0, count, stride: 1 }, out.as_slice_mut())?;
            all.push(out);
        }
    }
    Ok(all)
}

/// Whether rows are equal; NaN equals NaN.
#[must_use]
pub fn same(a: &[Column], b: &[Column]) -> bool {
    format!("{a:?}") == format!("{b:?}")
}
