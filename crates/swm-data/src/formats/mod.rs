//! The formats, one file or folder each, and what they share. Each exports one entry of the table in `format.rs`.

pub(crate) mod element;
pub(crate) mod folder;
pub(crate) mod hdf5;
mod labels;
pub(crate) mod mcap;
pub(crate) mod npz;
