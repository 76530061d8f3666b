//! HDF5 in the layout of the reference, which reads our files and whose files (both generations) are read here.
//! For the layout see `layout`; how a recording survives a crash, see `writer` and `superblock`.

mod attributes;
mod blosc;
mod checksum;
mod coverage;
mod create;
mod deflate;
mod encoding;
mod fetch;
mod ffi;
mod handles;
mod heap;
mod layout;
mod library;
pub(crate) mod lz4;
mod members;
mod reader;
mod repair;
mod storage;
mod superblock;
mod tiles;
mod torn;
mod tree;
mod writer;

use std::path::Path;

use crate::entry::Format;
use crate::recording::BackendWriter;

pub use blosc::unshuffle;
pub use storage::Scratch;
pub use tree::{Bytes, Table, Tree};

/// Whether a file begins as those of HDF5 do, perhaps behind a block of its user.
#[must_use]
pub fn is_hdf5(path: &Path) -> bool {
    superblock::detect(path)
}

/// Names in a file, as [`members::Members::names`] has them. What is no HDF5 file, or cannot be opened, has none.
pub(crate) fn names(path: &Path) -> Vec<String> {
    let tree = superblock::detect(path).then(|| Tree::open(path).ok()).flatten();
    tree.map(|tree| tree.names()).unwrap_or_default()
}

/// The entry in the table of formats.
pub(crate) const FORMAT: Format = Format::new(
    "hdf5",
    "one file, compressed frame by frame; random access, crash-safe, readable by the Python package",
    superblock::detect,
    |path| Ok(Box::new(reader::Hdf5Dataset::open(path)?)),
)
.extensions(&["h5", "hdf5"])
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, writer::Hdf5Backend)?)))
.repairer(repair::repair);
