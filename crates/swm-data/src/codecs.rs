//! Decoders of blocks that filters of HDF5 and codecs of Zarr share.

pub use crate::formats::hdf5::lz4::decode as lz4;
pub use crate::formats::hdf5::unshuffle;
