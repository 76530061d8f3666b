//! The replay buffer.

use pyo3::prelude::*;

/// Adds this file's classes and functions to the module.
pub(crate) fn add(_m: &Bound<'_, PyModule>) -> PyResult<()> {
    Ok(())
}
