//! HDF5 files of other programs, read-only: groups, arrays of numbers, marks and texts, and lists of bytes.

pub use crate::formats::hdf5::{Bytes, Scratch, Table, Tree, is_hdf5};
