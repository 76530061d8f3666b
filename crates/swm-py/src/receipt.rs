//! What follows a result: receipts compared and verified, datasets replayed.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::prelude::*;
use serde_json::json;
use swm::core::error::BoxError;
use swm::core::evaluate::PairedRuns;
use swm::core::evaluate::stats::{bootstrap95, mean_and_std};
use swm::core::{Cancel, EnvConfig};
use swm::evaluation::{Receipt, RunOptions};

use crate::errors::{OrRaise as _, SwmError};
use crate::evaluate::Progress;
use crate::infos;
use crate::interrupt::interruptible_with;
use crate::manifest::{boxed, from_json, to_json};
use crate::world::registry;

/// Compares sides of receipts (JSON each; several runs of one policy are one side), pair by pair, with the first side.
#[pyfunction]
fn compare_receipts(sides: Vec<Vec<String>>) -> PyResult<String> {
    let sides: Vec<Vec<Receipt>> = sides
        .iter()
        .map(|side| side.iter().map(|text| from_json("a receipt", text)).collect())
        .collect::<PyResult<_>>()?;
    let Some(first) = sides.first().and_then(|side| side.first()) else {
        return Err(SwmError::new_err("nothing to compare; give two results or more"));
    };
    if sides.iter().flatten().any(|receipt| receipt.manifest_hash != first.manifest_hash) {
        return Err(SwmError::new_err(
            "the results are of different manifests: they cannot be compared pair by pair",
        ));
    }
    let successes: Vec<Vec<Vec<bool>>> =
        sides.iter().map(|side| side.iter().map(Receipt::successes).collect()).collect();
    let mut compared = Vec::new();
    for (index, (side, runs)) in sides.iter().zip(&successes).enumerate() {
        let Some(run) = side.first() else {
            return Err(SwmError::new_err("a side without a result; give one or more for each"));
        };
        if side.iter().any(|other| other.candidate.policy != run.candidate.policy) {
            return Err(SwmError::new_err(format!(
                "`{}` and others on its side are not runs of one policy",
                run.policy
            )));
        }
        let rates: Vec<f64> = side.iter().map(|run| run.summary.success_rate).collect();
        let (success_rate, deviation) = mean_and_std(&rates);
        let own: Vec<&[bool]> = runs.iter().map(Vec::as_slice).collect();
        let others: Vec<&[bool]> = successes[0].iter().map(Vec::as_slice).collect();
        let ci95 = if side.len() == 1 { run.summary.ci95 } else { bootstrap95(&own, 0) };
        compared.push(json!({
            "policy": run.policy,
            "runs": side.len(),
            "success_rate": success_rate,
            "ci95": ci95,
            "deviation": deviation,
            "test": (index > 0).then(|| PairedRuns::of(&others, &own, 0)).flatten(),
        }));
    }
    to_json(&compared)
}

/// Runs a receipt's policy again and compares; gives a JSON object. `oracle`: the oracle too.
#[pyfunction]
#[pyo3(signature = (receipt, num_envs=16, threads=None, oracle=false, tick=None))]
fn verify_receipt(
    py: Python<'_>,
    receipt: &str,
    num_envs: usize,
    threads: Option<usize>,
    oracle: bool,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let receipt: Receipt = from_json("the receipt", receipt)?;
    let cancel = Cancel::new();
    let options = RunOptions { num_envs, threads, cancel: Some(cancel.clone()), ..RunOptions::default() };
    let progress = Progress::default();
    let run = || swm::evaluation::verify(registry(), &receipt, &options, oracle, || progress.count(false));
    to_json(&interruptible_with(py, &cancel, || progress.tell(tick), run)?.map_err(boxed)?)
}

/// Replays episodes of a dataset on the simulator and compares; gives a JSON object.
#[pyfunction]
#[pyo3(signature = (path, episodes=None, set=None, tolerance=0.0, env=None, tick=None))]
fn replay(
    py: Python<'_>,
    path: PathBuf,
    episodes: Option<Vec<usize>>,
    set: Option<&Bound<'_, PyAny>>,
    tolerance: f64,
    env: Option<&str>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let mut dataset = swm::data::open_in(registry(), &path).or_raise()?;
    let recorded = dataset.metadata().map(|metadata| metadata.env.clone());
    let id = env.map(str::to_owned).or(recorded).ok_or_else(|| {
        SwmError::new_err(format!("{} does not say its environment; give env=", path.display()))
    })?;
    let entry = registry().env(&id).or_raise()?;
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
        Ok::<_, BoxError>(())
    };
    interruptible_with(py, &cancel, || progress.tell(tick), run)?.map_err(boxed)?;
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
    m.add_function(wrap_pyfunction!(compare_receipts, m)?)?;
    m.add_function(wrap_pyfunction!(verify_receipt, m)?)?;
    m.add_function(wrap_pyfunction!(replay, m)?)
}
