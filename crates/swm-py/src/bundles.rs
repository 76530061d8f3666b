//! Results that are handed on: bundles, and boards of them.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::bundle::receipt_to_repeat as open_receipt;
use swm::tasks::request::{MakeBoard, MakeBundle};

use crate::errors::OrRaise as _;
use crate::manifest::to_json;
use crate::report::{Made, run};

/// The receipt of a file or folder as JSON, as it can be run again; of a bundle, after a comparison of the hashes of its files, with paths
/// that can be opened from here.
#[pyfunction]
fn receipt_to_repeat(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let (receipt, _) = py.detach(|| open_receipt(&path)).or_raise()?;
    to_json(&receipt)
}

/// Writes a bundle: `request` is a JSON object of the settings of `MakeBundle`. Gives what was written as JSON, and notes.
#[pyfunction]
fn make_bundle(py: Python<'_>, request: &str) -> Made {
    run::<MakeBundle>(py, request, None, None)
}

/// Writes a board of bundles: `request` is a JSON object of the settings of `MakeBoard`. `begin` is called with what each progress bar is
/// called and its length. Gives the page and what is on it as JSON, and notes.
#[pyfunction]
#[pyo3(signature = (request, begin=None, tick=None))]
fn make_board(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    run::<MakeBoard>(py, request, begin, tick)
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(receipt_to_repeat, m)?)?;
    m.add_function(wrap_pyfunction!(make_bundle, m)?)?;
    m.add_function(wrap_pyfunction!(make_board, m)?)
}
