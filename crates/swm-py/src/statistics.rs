//! Statistics of rows in memory, for the scalers of Python, which have none of their own.

use numpy::{PyArray1, PyReadonlyArray1, ToPyArray as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use swm::core::Slice;
use swm::core::moments::divisor_with;
use swm::data::stats::of_rows;

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(row_statistics, m)?)?;
    m.add_function(wrap_pyfunction!(divisors, m)?)
}

/// Means, stds, and each of the quantiles (shares from 0 to 1) of rows `[N, dim]`, end to end; empty where no row counts.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "what Python hands over")]
fn row_statistics(
    py: Python<'_>,
    rows: PyReadonlyArray1<'_, f64>,
    dim: usize,
    quantiles: Vec<f64>,
) -> PyResult<Vec<Vec<f64>>> {
    if let Some(bad) = quantiles.iter().find(|level| !(0.0..=1.0).contains(*level)) {
        return Err(PyValueError::new_err(format!("the quantile {bad} is not between 0 and 1")));
    }
    let rows = rows.as_slice()?;
    let found = py.detach(|| of_rows(Slice::F64(rows), dim, &quantiles));
    Ok([found.mean, found.std]
        .into_iter()
        .chain(found.quantiles.into_iter().map(|(_, values)| values))
        .collect())
}

/// The core's divisors of components with these centers and scales; `absolute` is the part of the rule for constants that does not depend on
/// the center.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "what Python hands over")]
fn divisors<'py>(
    py: Python<'py>,
    centers: PyReadonlyArray1<'py, f64>,
    scales: PyReadonlyArray1<'py, f64>,
    absolute: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let pairs = centers.as_slice()?.iter().zip(scales.as_slice()?);
    let all: Vec<f64> = pairs.map(|(&center, &scale)| divisor_with(center, scale, absolute)).collect();
    Ok(all.to_pyarray(py))
}
