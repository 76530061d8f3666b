//! The one call of the HDF5 library that its Rust interface lacks: a chunk as it is stored.
#![expect(unsafe_code, reason = "a call of the C library")]

use hdf5_metno::{Dataset, h5check, sync};
use hdf5_metno_sys::h5::hsize_t;
use hdf5_metno_sys::h5d::H5Dwrite_chunk;
use hdf5_metno_sys::h5p::H5P_DEFAULT;

/// No dataset has more (`H5S_MAX_RANK`).
const MAX_DIMENSIONS: usize = 32;

/// Writes the stored form of row `row` of a dataset whose chunks hold a row each, with all of its filters applied.
pub(super) fn write_row(dataset: &Dataset, row: usize, stored: &[u8]) -> hdf5_metno::Result<()> {
    let mut offset: [hsize_t; MAX_DIMENSIONS] = [0; MAX_DIMENSIONS];
    offset[0] = row as hsize_t;
    // SAFETY: the dataset is open, `offset` has a value for each dimension that there can be, `stored` has as many bytes as
    // are told, and `sync` holds the lock under which every call of the library stands.
    let written = sync::sync(|| unsafe {
        let (offset, bytes) = (offset.as_ptr(), stored.as_ptr());
        H5Dwrite_chunk(dataset.id(), H5P_DEFAULT, 0, offset, stored.len(), bytes.cast())
    });
    h5check(written).map(|_| ())
}
