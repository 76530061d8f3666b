//! Sweeps: a policy on a manifest under changed factors of variation, whole or in parts.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::core::{Cancel, EnvConfig};
use swm::evaluation::{
    CellLedger, Division, RunOptions, SweepRun, Values, changes, grid_points, held_sweep, read_sweep,
    write_sweep,
};
use swm::tasks::request::make_folder;

use crate::errors::{OrRaise as _, SwmError, in_words};
use crate::evaluate::Progress;
use crate::interrupt::interruptible_with;
use crate::manifest::{boxed, to_json};
use crate::runs::{Asked, Given};
use crate::world::registry;

/// As the command divides sweeps, whose parts can be joined here.
const DIVISION: Division = Division::ByCell;

/// A sweep's file, or that of a folder, as JSON.
#[pyfunction]
fn sweep_json(path: PathBuf) -> PyResult<String> {
    to_json(&read_sweep(&path).map_err(boxed)?)
}

/// Evaluates a policy under changes of the named factors; gives the sweep as JSON, which is also written to the folder `out`, and
/// whether that held it already. `values`: `sampled`, `extremes`, or `grid` with so many `points`. `begin` is called with the number of
/// evaluations, `tick` with how many are done. The others are those of `evaluate_manifest`.
#[pyfunction]
#[pyo3(signature = (manifest, policy, foreign=None, factors=Vec::new(), values="sampled", points=None, policy_seed=0, out=None, num_envs=8, threads=None, plan_steps=None, again=false, shard=None, join=false, begin=None, tick=None))]
#[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
fn sweep_manifest(
    py: Python<'_>,
    manifest: &str,
    policy: &str,
    foreign: Option<Given<'_>>,
    factors: Vec<String>,
    values: &str,
    points: Option<usize>,
    policy_seed: u64,
    out: Option<PathBuf>,
    num_envs: usize,
    threads: Option<usize>,
    plan_steps: Option<u64>,
    again: bool,
    shard: Option<(u64, u64)>,
    join: bool,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Option<String>, bool)> {
    let asked = Asked::new(manifest, policy, foreign, policy_seed, plan_steps)?;
    let Asked { manifest, entry, candidate, files, .. } = &asked;
    let config = EnvConfig { image: None, settings: manifest.settings.clone() };
    let known = entry.make(&config).or_raise()?.spec().factors.clone();
    let values = match (values, points) {
        ("grid", points) => Values::Grid(points.unwrap_or_else(|| grid_points(&known, &factors))),
        (_, Some(_)) => return Err(SwmError::new_err("points is for values=\"grid\"; give both")),
        ("sampled", None) => Values::Sampled,
        ("extremes", None) => Values::Extremes,
        (other, None) => {
            let all = "\"sampled\", \"extremes\" or \"grid\"";
            return Err(SwmError::new_err(format!("values={other:?}: it is {all}")));
        }
    };
    let changes = changes(&known, &factors, values).map_err(|reason| boxed(reason.into()))?;
    if let Some(dir) = &out {
        make_folder(dir).or_raise()?;
        let held = match again {
            true => None,
            false => held_sweep(dir, manifest, candidate, files, values, &changes)
                .map_err(|error| in_words(error, "evaluate"))?,
        };
        if let Some(held) = held {
            asked.check_identified(dir, "a sweep")?;
            return Ok((Some(to_json(&held)?), true));
        }
    }
    let (done, cancel) = (Progress::default(), Cancel::new());
    let options = RunOptions { num_envs, threads, cancel: Some(cancel.clone()), ..RunOptions::default() };
    let mut run = SweepRun::new(registry(), manifest, candidate, changes, values, options).map_err(boxed)?;
    let (cells, pairs) = (run.cells(), run.pairs());
    // Of a policy in Python, which is asked on this thread, the runs themselves show what is done.
    let mut foreign = asked.foreign(py, &done, tick)?;
    if let Some(foreign) = &foreign {
        run = run.by(foreign);
    }
    if let Some(begin) = begin {
        begin.call1((cells,))?;
    }
    let whole = run.identity().map_err(boxed)?;
    let mut ledger = match (&out, shard) {
        (Some(dir), Some(shard)) => CellLedger::open_part(dir, shard, DIVISION, &whole, cells, pairs),
        (Some(dir), None) if join => {
            CellLedger::join(dir, DIVISION, &whole, cells, pairs).map_err(Into::into)
        }
        (Some(dir), None) if asked.is_identified() => {
            let path = dir.join("sweep.jsonl");
            match again {
                true => CellLedger::open_again(&path, &whole, cells, pairs),
                false => CellLedger::open(&path, &whole, cells, pairs),
            }
        }
        _ => Ok(CellLedger::in_memory(cells, pairs)),
    }
    .map_err(boxed)?;
    let show = || done.tell(tick);
    if shard.is_some() {
        let ran = match &mut foreign {
            Some(foreign) => run.run_part(&mut ledger, Some(foreign), |_| done.count(false)),
            None => interruptible_with(py, &cancel, show, || {
                run.run_part(&mut ledger, None, |_| done.count(false))
            })?,
        };
        ran.and_then(|()| ledger.finish_part()).map_err(boxed)?;
        return Ok((None, false));
    }
    let sweep = match &mut foreign {
        Some(foreign) => run.run(&mut ledger, Some(foreign), |_| done.count(false)),
        None => interruptible_with(py, &cancel, show, || run.run(&mut ledger, None, |_| done.count(false)))?,
    };
    let sweep = sweep.map_err(boxed)?;
    done.tell(tick)?;
    if let Some(dir) = &out {
        write_sweep(dir, &sweep).map_err(boxed)?;
    }
    ledger.close().map_err(boxed)?;
    Ok((Some(to_json(&sweep)?), false))
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(sweep_json, m)?)?;
    m.add_function(wrap_pyfunction!(sweep_manifest, m)?)
}
