//! What follows a result: receipts compared and verified, datasets replayed.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::prelude::*;
use serde_json::json;
use swm::core::{Cancel, EnvConfig};
use swm::evaluation::{Receipt, RunOptions, Side, compare, read_receipt, result_differences};
use swm::tasks::request::{TaskError, verify_foreign};

use crate::dataset::open_options;
use crate::errors::{OrRaise as _, SwmError};
use crate::evaluate::Progress;
use crate::infos;
use crate::interrupt::interruptible_with;
use crate::manifest::{from_json, to_json};
use crate::runs::{Given, foreign};
use crate::whole;
use crate::world::registry;

/// A receipt file, or that of a folder, as JSON.
#[pyfunction]
fn receipt_json(path: PathBuf) -> PyResult<String> {
    to_json(&read_receipt(&path).or_raise()?)
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
    #[pyo3(from_py_with = whole::plan_steps)] plan_steps: Option<u64>,
    #[pyo3(from_py_with = whole::num_envs)] num_envs: usize,
    #[pyo3(from_py_with = whole::threads)] threads: Option<usize>,
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

/// Replays episodes of a dataset on the simulator and compares; gives a JSON object.
#[pyfunction]
#[pyo3(signature = (path, episodes=None, set=None, tolerance=0.0, env=None, tick=None, options=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
fn replay(
    py: Python<'_>,
    path: PathBuf,
    episodes: Option<Vec<usize>>,
    set: Option<&Bound<'_, PyAny>>,
    tolerance: f64,
    env: Option<&str>,
    tick: Option<&Bound<'_, PyAny>>,
    options: Option<&str>,
) -> PyResult<String> {
    if tolerance.is_nan() || tolerance < 0.0 {
        return Err(SwmError::new_err(format!("tolerance={tolerance}: use a number of 0 or more")));
    }
    let options = open_options(options)?;
    let mut dataset = swm::data::open_with(registry(), &path, &options).or_raise()?;
    let entry = match env {
        Some(id) => registry().env(id).or_raise()?,
        None => swm::replay::recorded_env(registry(), &dataset, &path).or_raise()?,
    };
    let spec = entry.make(&EnvConfig::default()).or_raise()?.spec().clone();
    let overrides = set.map(|set| infos::factors(&spec, set)).transpose()?.unwrap_or_default();
    let count = dataset.num_episodes();
    let episodes = episodes.unwrap_or_else(|| (0..count).collect());
    if let Some(episode) = episodes.iter().find(|&&episode| episode >= count) {
        return Err(SwmError::new_err(format!("no episode {episode}: {} holds {count}", path.display())));
    }
    let (progress, cancel) = (Progress::default(), Cancel::new());
    let mut reports = Vec::new();
    // One by one, so that Ctrl-C is heard.
    let run = || {
        for episode in episodes {
            if cancel.is_cancelled() {
                return Err("cancelled".into());
            }
            let report = swm::replay::replay(entry, &mut dataset, &[episode], &overrides, tolerance, |_| ())?;
            progress.count(false);
            reports.push(report);
        }
        Ok::<_, TaskError>(())
    };
    interruptible_with(py, &cancel, || progress.tell(tick), run)?.or_raise()?;
    let mut columns: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    for (name, difference) in reports.iter().flat_map(|report| &report.columns) {
        let largest = columns.entry(name.clone()).or_default();
        *largest = [largest[0].max(difference.max_abs), largest[1].max(difference.final_abs)];
    }
    let largest: BTreeMap<_, _> = columns
        .into_iter()
        .map(|(name, [max_abs, final_abs])| (name, json!({ "max_abs": max_abs, "final_abs": final_abs })))
        .collect();
    to_json(&json!({
        "ok": reports.iter().all(|report| report.ok),
        "tolerance": tolerance,
        "episodes": reports.len(),
        "rows": reports.iter().map(|report| report.rows).sum::<usize>(),
        "columns": largest,
        "checkpoints": reports.iter().map(|report| report.checkpoints).sum::<usize>(),
        "checkpoints_differ": reports.iter().map(|report| report.checkpoints_differ).sum::<usize>(),
    }))
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(receipt_json, m)?)?;
    m.add_function(wrap_pyfunction!(receipt_differences, m)?)?;
    m.add_function(wrap_pyfunction!(compare_receipts, m)?)?;
    m.add_function(wrap_pyfunction!(verify_receipt, m)?)?;
    m.add_function(wrap_pyfunction!(replay, m)?)
}
