//! Datasets that are converted, merged, split or verified: requests of the tasks.

use pyo3::prelude::*;
use swm::tasks::request::{Convert, Merge, Request, Split, Verify};

use crate::manifest::from_json;
use crate::report::{Made, run};
use crate::writer::check_threads;

/// As [`run`], where datasets are written: not everything can be in a fork.
fn write<R: Request>(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made
where
    R::Outcome: serde::Serialize,
{
    let given: serde_json::Value = from_json("the request", request)?;
    check_threads(given["format"].as_str())?;
    run::<R>(py, request, begin, tick)
}

/// Copies a dataset into another format; see [`run`].
#[pyfunction]
#[pyo3(signature = (request, begin=None, tick=None))]
fn convert_dataset(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    write::<Convert>(py, request, begin, tick)
}

/// Joins datasets; see [`run`].
#[pyfunction]
#[pyo3(signature = (request, begin=None, tick=None))]
fn merge_datasets(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    write::<Merge>(py, request, begin, tick)
}

/// Divides a dataset; see [`run`].
#[pyfunction]
#[pyo3(signature = (request, begin=None, tick=None))]
fn split_dataset(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    write::<Split>(py, request, begin, tick)
}

/// Verifies a dataset; see [`run`].
#[pyfunction]
#[pyo3(signature = (request, begin=None, tick=None))]
fn verify_dataset(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    run::<Verify>(py, request, begin, tick)
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(convert_dataset, m)?)?;
    m.add_function(wrap_pyfunction!(merge_datasets, m)?)?;
    m.add_function(wrap_pyfunction!(split_dataset, m)?)?;
    m.add_function(wrap_pyfunction!(verify_dataset, m)?)
}
