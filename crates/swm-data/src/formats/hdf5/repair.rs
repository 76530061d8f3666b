//! Putting a file right whose recording was interrupted: its mark of being written is taken away, so that any program
//! opens it, and rows behind the last finished episode are cut.

use std::path::Path;

use swm_files::WriterLock;

use super::create::{self, EndOfData};
use super::reader::Hdf5Dataset;
use super::superblock;
use crate::dataset::Dataset as _;
use crate::error::DataError;
use crate::recording;
use crate::recording::EP_IDX;

/// Says what is to be done; does it if `apply`.
pub(super) fn repair(path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
    let path = recording::resolve(path)?;
    let _lock = WriterLock::take(&path)?;
    if !superblock::ensure_readable(&path)?.is_unclean() {
        return Ok(Vec::new());
    }
    let old = Hdf5Dataset::open_locked(&path)?;
    let episodes = old.num_episodes();
    let steps = vec![
        "clear the flag that HDF5 sets while a file is open for writing, so that h5py opens it without `swmr=True`"
            .to_owned(),
        format!("cut what lies behind the {episodes} finished episodes"),
    ];
    let (Some((columns, _)), Some((_, metadata))) = (old.ours(), old.attributes().runs.last()) else {
        return Err(recording::foreign(&path));
    };
    if apply {
        let fields: Vec<_> = columns.iter().filter(|field| field.name != EP_IDX).cloned().collect();
        let end = EndOfData {
            episodes,
            rows: old.total_rows(),
            chunks_end: old.chunks_end(),
            attributes: old.attributes().clone(),
        };
        let metadata = metadata.clone();
        drop(old);
        let handles = create::reopen(&path, &fields, &end, &metadata)?;
        handles.close().map_err(|error| DataError::write(&path, episodes as u64, error))?;
    }
    Ok(steps)
}
