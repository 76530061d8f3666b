//! Putting a folder right whose recording was interrupted: arrays get their directories back, so that numpy opens
//! them, and what belongs to no committed episode is removed.

use std::path::Path;

use swm_files::WriterLock;

use super::images::Store;
use super::layout::{self, Manifest};
use super::reader::FolderDataset;
use super::writer::FolderSession;
use crate::dataset::{Dataset as _, WriteOptions};
use crate::error::DataError;
use crate::formats::npz::Array;
use crate::recording::{self, Session as _};

/// Says what is to be done; does it if `apply`.
pub(super) fn repair(
    path: &Path,
    format: &'static str,
    store: Store,
    apply: bool,
) -> Result<Vec<String>, DataError> {
    let path = &recording::resolve(path)?;
    let lock = WriterLock::take(path)?;
    let Some(manifest) = Manifest::read(path)? else { return Ok(Vec::new()) };
    let dataset = FolderDataset::open_to_repair(path, format, store)?;
    let known = dataset.known();
    let (episodes, rows) =
        (dataset.num_episodes(), (0..dataset.num_episodes()).map(|e| dataset.episode_len(e)).sum());
    let mut steps = Vec::new();
    let lost = known.entries.len() - known.indexed;
    if lost > 0 {
        steps.push(format!("restore the records of the last {lost} episodes, which the index lacks"));
    }
    let arrays =
        manifest.columns.iter().filter(|field| !store.takes(field)).map(|field| (field.name.as_str(), rows));
    for (name, rows) in arrays.chain([(layout::EP_LEN, episodes), (layout::EP_OFFSET, episodes)]) {
        let file = layout::array(path, name);
        match Array::open(&file) {
            Ok(array) if array.rows() == rows => {}
            Ok(array) => steps.push(format!("set `{name}.npz` from {} to {rows} rows", array.rows())),
            Err(error) => steps.push(format!("write the directory of `{name}.npz` anew ({error})")),
        }
    }
    for field in manifest.columns.iter().filter(|field| store.takes(field)) {
        let folder = path.join(&field.name);
        let count =
            store.leftovers(&folder, episodes as u64).map_err(|e| DataError::io(&folder, "read", e))?;
        if count > 0 {
            steps.push(format!(
                "remove {count} images or videos of unfinished episodes from `{}`",
                field.name
            ));
        }
    }
    if apply && !steps.is_empty() {
        let schema = dataset.schema().clone();
        drop(dataset);
        let options = WriteOptions::default();
        let mut session = FolderSession::open(path, store, &manifest, &schema, &known, &options)?;
        session.sync().map_err(|error| DataError::record(path, error))?;
    }
    drop(lock);
    Ok(steps)
}
