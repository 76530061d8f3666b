//! Results that are handed on: bundles, and boards of them.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::bundle::receipt_to_repeat as open_receipt;
use swm::tasks::request::{MakeBoard, MakeBundle, Request as _};

use crate::errors::in_words;
use crate::manifest::{boxed, from_json, to_json};
use crate::report::Reporter;
use crate::world::registry;

/// The receipt of a file or folder as JSON, as it can be run again; of a bundle, after a comparison of the hashes of its files, with paths
/// that can be opened from here.
#[pyfunction]
fn receipt_to_repeat(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let (receipt, _) = py.detach(|| open_receipt(&path)).map_err(boxed)?;
    to_json(&receipt)
}

/// Writes a bundle: `request` is a JSON object of the settings of `MakeBundle`. Gives what was written as JSON, and notes.
#[pyfunction]
fn make_bundle(py: Python<'_>, request: &str) -> PyResult<(String, Vec<String>)> {
    let wrong = |error| in_words(error, MakeBundle::NAME);
    let request = MakeBundle::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, MakeBundle::NAME, None, None);
    let made = request.run(registry(), &mut reporter).map_err(wrong)?;
    Ok((to_json(&made)?, reporter.notes))
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
) -> PyResult<(String, Vec<String>)> {
    let wrong = |error| in_words(error, MakeBoard::NAME);
    let request = MakeBoard::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, MakeBoard::NAME, begin, tick);
    let made = request.run(registry(), &mut reporter).map_err(wrong)?;
    Ok((to_json(&made)?, reporter.notes))
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(receipt_to_repeat, m)?)?;
    m.add_function(wrap_pyfunction!(make_bundle, m)?)?;
    m.add_function(wrap_pyfunction!(make_board, m)?)
}
