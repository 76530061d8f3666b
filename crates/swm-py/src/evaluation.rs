//! Evaluations on manifests: a policy and the reference policies on the same pairs, whole or in parts, and the receipt.

use std::path::PathBuf;
use std::time::Instant;

use pyo3::prelude::*;
use swm::core::PolicyArgs;
use swm::evaluation::{
    Candidate, CellLedger, Division, Receipt, Reference, Role, fingerprints, held_receipt, identity, roles,
    write_receipt,
};

use crate::errors::{OrRaise as _, SwmError};
use crate::manifest::{boxed, to_json};
use crate::runs::{Asked, Given, Runs};
use crate::world::registry;

/// Planners take many times as long as the random and the no-op policy; the same as of the command, whose parts can be joined here.
const DIVISION: Division = Division::ByPair;

/// Makes the folder of results.
pub(crate) fn make_folder(dir: &std::path::Path) -> PyResult<()> {
    let made = std::fs::create_dir_all(dir);
    made.map_err(|error| SwmError::new_err(format!("cannot write to the folder {}: {error}", dir.display())))
}

/// Evaluates a policy on a manifest, and the reference policies (`random`, `no_op`, `oracle`) that `references` names; gives
/// the receipt as JSON, which is also written to the folder `out`, and whether that held it already. The result of another
/// evaluation is replaced if `again`. `begin` is called with the name of each policy before it runs.
///
/// `policy`: a native policy, or what a Python one is called in the receipt; that one comes as `foreign`. `plan_steps`: actions of
/// one plan, where they are not known by the policy's settings. `shard`: one of so many parts is run, and there is no receipt;
/// `join`: it is made of the parts.
#[pyfunction]
#[pyo3(signature = (manifest, policy, foreign=None, policy_seed=0, references=Vec::new(), oracle=None, out=None, num_envs=16, threads=None, plan_steps=None, again=false, shard=None, join=false, begin=None, tick=None))]
#[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
fn evaluate_manifest(
    py: Python<'_>,
    manifest: &str,
    policy: &str,
    foreign: Option<Given<'_>>,
    policy_seed: u64,
    references: Vec<String>,
    oracle: Option<&str>,
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
    let mut wanted = wanted(&asked, &references, oracle)?;
    if let Some(dir) = &out {
        make_folder(dir)?;
    }
    let Asked { manifest, entry, candidate, description, files, steps, .. } = &asked;
    let fingerprints = py.detach(|| fingerprints(entry, manifest, candidate.seed)).map_err(boxed)?;
    let receipt = Receipt::new(
        manifest.clone(),
        candidate.clone(),
        description.clone(),
        files.clone(),
        fingerprints.clone(),
        *steps,
    );
    let held = match &out {
        Some(dir) if !again => held_receipt(dir, &receipt, &mut wanted).map_err(boxed)?,
        _ => None,
    };
    if let (Some(_), Some(dir)) = (&held, &out) {
        asked.check_identified(dir, "a result")?;
    }
    if let (Some(held), []) = (&held, wanted.as_slice()) {
        return Ok((Some(to_json(held)?), true));
    }
    let is_divided = shard.is_some() || join;
    if let (Some(_), Some(dir), true) = (&held, &out, is_divided) {
        return Err(SwmError::new_err(format!(
            "{} holds a receipt with other reference policies; give another folder, or again=True to replace it",
            dir.display()
        )));
    }
    let runs = Runs { asked: &asked, num_envs, threads, begin, tick };
    let policies: Vec<&Candidate> = std::iter::once(candidate)
        .chain(wanted.iter().map(|(_, other)| other).filter(|other| *other != candidate))
        .collect();
    let whole = identity(&(manifest.hash(), &policies, &fingerprints, steps), files).map_err(boxed)?;
    let (cells, pairs) = (policies.len() as u64, manifest.pairs.len() as u64);
    if let (Some(shard), Some(dir)) = (shard, &out) {
        let ledger = CellLedger::open_part(dir, shard, DIVISION, &whole, cells, pairs);
        part(py, &runs, &policies, ledger.map_err(boxed)?)?;
        return Ok((None, false));
    }
    let joined = match &out {
        Some(dir) if join => Some(CellLedger::join(dir, DIVISION, &whole, cells, pairs).map_err(boxed)?),
        _ => None,
    };
    let run = |name: &str, candidate: &Candidate| {
        let own = identity(&(manifest.hash(), candidate, &fingerprints, steps), files).map_err(boxed)?;
        // Without its files, a policy in Python may be another one when it is run again.
        let keeps = asked.is_identified() || candidate != &asked.candidate;
        let path = out.as_deref().filter(|_| keeps).map(|dir| dir.join(format!("{name}.jsonl")));
        runs.all(py, candidate, path.as_deref(), &own, again)
    };
    let started = Instant::now();
    let (episodes, wall_time_s, mut others) = match (held, &joined) {
        (Some(held), _) => (held.episodes, held.wall_time_s, held.references),
        (None, Some(joined)) => (joined.known(0).into_values().collect(), joined.seconds(0), Vec::new()),
        (None, None) => {
            runs.begin(policy)?;
            (run("episodes", candidate)?, started.elapsed().as_secs_f64(), Vec::new())
        }
    };
    let mut cell = 0;
    for (role, other) in wanted {
        let found = match (other == *candidate, &joined) {
            // A planner on the true dynamics is its own oracle: nothing to run again.
            (true, _) => episodes.clone(),
            (false, Some(joined)) => {
                cell += 1;
                joined.known(cell).into_values().collect()
            }
            (false, None) => {
                runs.begin(&reference(role))?;
                run(&format!("episodes-{}", role.name()), &other)?
            }
        };
        others.push(Reference::new(role, other, found, &episodes));
    }
    let receipt = receipt.with_results(episodes, others, wall_time_s);
    if let Some(dir) = &out {
        write_receipt(dir, &receipt).map_err(boxed)?;
    }
    joined.map_or(Ok(()), CellLedger::close).map_err(boxed)?;
    Ok((Some(to_json(&receipt)?), false))
}

/// What the progress bar of a reference policy is called.
fn reference(role: Role) -> String {
    format!("{} (reference)", role.name().replace('-', "_"))
}

/// Runs the episodes of a part that are not in its ledger.
fn part(
    py: Python<'_>,
    runs: &Runs<'_, '_>,
    policies: &[&Candidate],
    mut ledger: CellLedger,
) -> PyResult<()> {
    for (cell, candidate) in (0..).zip(policies) {
        let (wanted, known) = (ledger.wanted(cell), ledger.known(cell));
        runs.begin(&candidate.policy.name)?;
        let each = |pair, result: &_| ledger.push(cell, pair, result);
        runs.pairs(py, candidate, Some(wanted.collect()), &known, each)?;
    }
    ledger.finish_part().map_err(boxed)
}

/// The reference policies to run.
fn wanted(asked: &Asked<'_>, names: &[String], oracle: Option<&str>) -> PyResult<Vec<(Role, Candidate)>> {
    let known = [(Role::Random, "random"), (Role::NoOp, "no_op"), (Role::Oracle, "oracle")];
    // As the command writes it, too.
    let names: Vec<String> = names.iter().map(|name| name.replace('-', "_")).collect();
    if let Some(name) = names.iter().find(|name| known.iter().all(|(_, known)| known != name)) {
        return Err(SwmError::new_err(format!(
            "`{name}` is no reference policy; there are random, no_op and oracle"
        )));
    }
    let is_wanted =
        |role: Role| known.iter().any(|(known, name)| *known == role && names.iter().any(|n| n == name));
    let Asked { manifest, entry, candidate, .. } = asked;
    let mut all = roles(registry(), entry, manifest, candidate);
    if let Some(text) = oracle {
        all.retain(|(role, _)| *role != Role::Oracle);
        let oracle = Candidate::new(PolicyArgs::parse(text).or_raise()?).seeded(candidate.seed);
        all.push((Role::Oracle, oracle.on(registry(), entry, manifest)));
    }
    all.retain(|(role, _)| is_wanted(*role));
    Ok(all)
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(evaluate_manifest, m)?)
}
