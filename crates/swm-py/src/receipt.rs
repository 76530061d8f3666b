//! What follows a result: receipts compared and verified.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::bundle::receipt_to_repeat as open_receipt;
use swm::core::Cancel;
use swm::evaluation::{Receipt, RunOptions, Side, compare, read_receipt, result_differences};
use swm::tasks::request::verify_foreign;

use crate::errors::{OrRaise as _, SwmError};
use crate::evaluate::Progress;
use crate::integers;
use crate::interrupt::interruptible_with;
use crate::manifest::{from_json, to_json};
use crate::runs::{Given, foreign};
use crate::world::registry;

/// A receipt file, or that of a folder, as JSON.
#[pyfunction]
fn receipt_json(path: PathBuf) -> PyResult<String> {
    to_json(&read_receipt(&path).or_raise()?)
}

/// The receipt of a file or folder as JSON, as it can be run again; of a bundle, after a comparison of the hashes of its files, with paths
/// that can be opened from here.
#[pyfunction]
fn receipt_to_repeat(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let (receipt, _) = py.detach(|| open_receipt(&path)).or_raise()?;
    to_json(&receipt)
}

/// In what two receipts differ, wall times apart, as JSON: objects with `what`, `first` and `this`.
#[pyfunction]
fn receipt_differences(first: &str, this: &str) -> PyResult<String> {
    let read = |text| from_json::<Receipt>("the receipt", text);
    to_json(&result_differences(&read(first)?, &read(this)?))
}

/// Compares sides of receipts, pair by pair, with the first side. A side is its name, and the JSON of each of its runs.
#[pyfunction]
fn compare_receipts(sides: Vec<(String, Vec<String>)>) -> PyResult<String> {
    if sides.is_empty() {
        return Err(SwmError::new_err("nothing to compare; give two results or more"));
    }
    let side = |(name, texts): &(String, Vec<String>)| {
        let runs = texts.iter().map(|text| from_json("a receipt", text)).collect::<PyResult<_>>()?;
        Side::new(name, runs).or_raise()
    };
    let sides: Vec<Side> = sides.iter().map(side).collect::<PyResult<_>>()?;
    to_json(&compare(&sides).or_raise()?)
}

/// Runs a receipt's policy and its reference policies again and compares; gives a JSON object. `oracle`: the oracle too. `policy`, of
/// a receipt of a policy in Python: what that is called and the policy itself; `plan_steps` as of `evaluate_manifest`.
#[pyfunction]
#[pyo3(signature = (receipt, policy=None, plan_steps=None, num_envs=8, threads=None, oracle=false, tick=None))]
#[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
fn verify_receipt(
    py: Python<'_>,
    receipt: &str,
    policy: Option<(String, Given<'_>)>,
    #[pyo3(from_py_with = integers::plan_steps)] plan_steps: Option<u64>,
    #[pyo3(from_py_with = integers::num_envs)] num_envs: usize,
    #[pyo3(from_py_with = integers::threads)] threads: Option<usize>,
    oracle: bool,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let receipt: Receipt = from_json("the receipt", receipt)?;
    let (cancel, progress) = (Cancel::new(), Progress::default());
    let options = RunOptions { num_envs, threads, cancel: Some(cancel.clone()), ..RunOptions::default() };
    let count = || progress.count(false);
    let Some((name, given)) = policy else {
        let run = || swm::evaluation::verify(registry(), &receipt, &options, oracle, count);
        return to_json(&interruptible_with(py, &cancel, || progress.tell(tick), run)?.or_raise()?);
    };
    let mut policy = foreign(py, &given, &progress, tick)?;
    let policy = (name.as_str(), &mut policy);
    let verified =
        verify_foreign(registry(), &receipt, policy, plan_steps, &options, oracle, count).or_raise()?;
    progress.tell(tick)?;
    to_json(&verified)
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(receipt_json, m)?)?;
    m.add_function(wrap_pyfunction!(receipt_to_repeat, m)?)?;
    m.add_function(wrap_pyfunction!(receipt_differences, m)?)?;
    m.add_function(wrap_pyfunction!(compare_receipts, m)?)?;
    m.add_function(wrap_pyfunction!(verify_receipt, m)?)
}
