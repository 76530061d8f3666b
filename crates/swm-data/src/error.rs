//! The error of datasets, which is the core's.

pub use swm_core::dataset::DataError;
