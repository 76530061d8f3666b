//! Rows as they are stored: which columns have them, and writing them so that the file is the one that the library would
//! write from their values.

use std::mem;

use hdf5_metno::Dataset;
use hdf5_metno::filters::{Blosc, Filter};
use swm_core::{Dtype, Field, Slice};

use super::handles::library_error;
use super::{blosc, checksum, ffi, library};
use crate::dataset::EncodedRows;
use crate::error::{Result, invalid};

/// The encoding of a column of bytes whose rows are compressed each on its own, with a checksum, as ours are.
pub(super) fn encoding(dataset: &Dataset, field: &Field) -> hdf5_metno::Result<Option<String>> {
    let is_by_row = dataset.chunk().is_some_and(|chunk| chunk[0] == 1 && chunk[1..] == field.shape);
    if !is_by_row || field.dtype != Dtype::U8 {
        return Ok(None);
    }
    let filters = dataset.dcpl()?.get_filters()?;
    let is_ours = matches!(filters[..], [Filter::Blosc(Blosc::LZ4, ..), Filter::Fletcher32]);
    Ok(is_ours.then(|| format!("hdf5 {filters:?}")))
}

/// The last row of a column that came as it is stored. The library keeps a row that it is given until the next one comes
/// or the file is flushed, and only then finds a place for it in the file. So does this: the copy of a file is equal to the
/// file that was recorded in one go in every byte.
#[derive(Debug, Default)]
pub(super) struct LastRow {
    row: usize,
    stored: Vec<u8>,
}

impl LastRow {
    /// Writes rows from `first` on, but for the last.
    pub(super) fn append(&mut self, dataset: &Dataset, first: usize, rows: &EncodedRows) -> Result<()> {
        for (index, stored) in rows.iter().enumerate() {
            self.write(dataset)?;
            self.row = first + index;
            self.stored.extend_from_slice(stored);
        }
        Ok(())
    }

    /// Writes the row, as it is, if there is one.
    pub(super) fn write(&mut self, dataset: &Dataset) -> Result<()> {
        if !self.stored.is_empty() {
            ffi::write_row(dataset, self.row, &self.stored).map_err(library_error)?;
            self.stored.clear();
        }
        Ok(())
    }

    /// Gives the library the values of the row, if there is one.
    pub(super) fn hand_over(&mut self, dataset: &Dataset, field: &Field) -> Result<()> {
        let mut stored = mem::take(&mut self.stored);
        if let Some((bytes, _)) = stored.split_last_chunk::<{ checksum::BYTES }>() {
            let mut values = vec![0; field.dim()];
            let decoded = blosc::decode(
                bytes,
                values.len(),
                0..values.len(),
                &mut values,
                &mut blosc::Scratch::default(),
            );
            decoded.map_err(|reason| invalid(format!("its chunk is {reason}")))?;
            library::write(dataset, field, self.row, 1, Slice::U8(&values))?;
        }
        stored.clear();
        self.stored = stored;
        Ok(())
    }
}
