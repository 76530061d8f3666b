//! Manifests and receipts: made, read, and run under a native or a Python policy.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use pyo3::prelude::*;
use swm::core::error::BoxError;
use swm::core::evaluate::{EpisodeResult, OutcomeRecorder, is_held_out};
use swm::core::{
    Cancel, DataError, EnvEntry, EnvError, Manifest, PolicyArgs, PolicyError, Rollout, UnknownName,
    WorldError,
};
use swm::evaluation::{
    Candidate, Ledger, Receipt, Reference, Role, RunOptions, fingerprints, held_receipt, identity,
    read_manifest, read_receipt, roles, run_pairs, write_receipt,
};
use swm::tasks::request::{MakeManifest, Message, Request as _};

use crate::errors::{IntoPy, OrRaise as _, SwmError};
use crate::evaluate::Progress;
use crate::interrupt::interruptible_with;
use crate::policy::drive;
use crate::words::{Arguments, in_python};
use crate::world::{PyWorld, registry};

/// An error of any kind as the exception that it is.
pub(crate) fn boxed(error: BoxError) -> PyErr {
    fn of<E: IntoPy + std::error::Error + 'static>(error: BoxError) -> Result<PyErr, BoxError> {
        error.downcast::<E>().map(|error| (*error).into_py())
    }
    let known = of::<WorldError>(error)
        .or_else(of::<PolicyError>)
        .or_else(of::<EnvError>)
        .or_else(of::<DataError>)
        .or_else(of::<UnknownName>);
    let error = match known {
        Ok(error) => return error,
        Err(error) => error,
    };
    match error.downcast::<PyErr>() {
        Ok(error) => *error,
        Err(error) => SwmError::new_err(in_python(&error.to_string())),
    }
}

/// A value as JSON.
pub(crate) fn to_json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| SwmError::new_err(error.to_string()))
}

/// JSON as a value; `what` names it in errors.
pub(crate) fn from_json<T: serde::de::DeserializeOwned>(what: &str, text: &str) -> PyResult<T> {
    serde_json::from_str(text).map_err(|error| SwmError::new_err(format!("{what}: {error}")))
}

/// A manifest file as JSON, and its hash.
#[pyfunction]
fn manifest_json(path: PathBuf) -> PyResult<(String, String)> {
    let manifest = read_manifest(&path).map_err(boxed)?;
    Ok((to_json(&manifest)?, manifest.hash()))
}

/// A receipt file, or that of a folder, as JSON.
#[pyfunction]
fn receipt_json(path: PathBuf) -> PyResult<String> {
    to_json(&read_receipt(&path).map_err(boxed)?)
}

/// Makes a manifest and writes it. `request`: a JSON object of the settings of `MakeManifest`. Gives the manifest as JSON, its
/// hash, and notes.
#[pyfunction]
fn make_manifest(py: Python<'_>, request: &str) -> PyResult<(String, String, Vec<String>)> {
    let request = MakeManifest::from_json(&from_json("the request", request)?).or_raise()?;
    let mut notes: Vec<Message> = Vec::new();
    let manifest = py.detach(|| request.run(registry(), &mut notes)).or_raise()?;
    let notes = notes.iter().map(|note| note.in_words(&Arguments)).collect();
    Ok((to_json(&manifest)?, manifest.hash(), notes))
}

/// Of these episodes of a dataset, which are held out from training (see `swm_core::evaluate::is_held_out`).
#[pyfunction]
fn held_out(episodes: Vec<usize>, share: f64) -> Vec<bool> {
    episodes.into_iter().map(|episode| is_held_out(episode, share)).collect()
}

/// What every run on a manifest needs.
struct Run<'a> {
    manifest: &'a Manifest,
    out: Option<&'a Path>,
    num_envs: usize,
    threads: Option<usize>,
    /// Whether episodes of another evaluation are replaced.
    again: bool,
    /// Is told whose episodes come next.
    begin: Option<&'a Bound<'a, PyAny>>,
    tick: Option<&'a Bound<'a, PyAny>>,
}

impl Run<'_> {
    /// A progress bar of its own for a policy, which is called `label`.
    fn begin(&self, label: &str) -> PyResult<()> {
        self.begin.map_or(Ok(()), |begin| begin.call1((label,)).map(drop))
    }

    /// The episodes of one policy, those of an earlier try included.
    fn policy(
        &self,
        py: Python<'_>,
        name: &str,
        candidate: &Candidate,
        steps: u64,
        identity: &impl serde::Serialize,
    ) -> PyResult<Vec<EpisodeResult>> {
        let resets = self.manifest.resets().or_raise()?;
        let progress = Progress::default();
        let path = self.out.map(|dir| dir.join(format!("{name}.jsonl")));
        let open = |path: &Path| match self.again {
            true => Ledger::open_again(path, identity),
            false => Ledger::open(path, identity),
        };
        let mut ledger = path.as_deref().map(open).transpose().map_err(boxed)?;
        let known = ledger.as_ref().map(|ledger| ledger.known.clone()).unwrap_or_default();
        known.values().for_each(|episode| progress.count(episode.success));
        let each = |pair: u64, result: &EpisodeResult| {
            progress.count(result.success);
            ledger.as_mut().map_or(Ok(()), |ledger| ledger.push(pair, result))
        };
        let cancel = Cancel::new();
        let options = RunOptions {
            num_envs: self.num_envs,
            threads: self.threads,
            cancel: Some(cancel.clone()),
            ..RunOptions::default()
        };
        let run =
            || run_pairs(registry(), self.manifest, &resets, candidate, steps, &options, &known, true, each);
        let episodes = interruptible_with(py, &cancel, || progress.tell(self.tick), run)?.map_err(boxed)?;
        progress.tell(self.tick)?;
        if let Some(ledger) = ledger {
            ledger.close().map_err(boxed)?;
        }
        Ok(episodes)
    }

    /// The episodes of a Python policy. No ledger: a name says nothing of its code, which may have been changed when it is run
    /// again.
    fn foreign(
        &self,
        py: Python<'_>,
        world: &PyWorld,
        act: &Bound<'_, PyAny>,
        steps: u64,
    ) -> PyResult<Vec<EpisodeResult>> {
        let manifest = self.manifest;
        manifest.check().or_raise()?;
        let resets = manifest.resets().or_raise()?;
        let progress = Progress::default();
        {
            let mut core = world.shared.lock()?;
            let world = core.world()?;
            world.set_success(&manifest.success).or_raise()?;
            world.set_max_episode_steps(Some(manifest.budget));
        }
        let count = manifest.pairs.len() as u64;
        let rollout = Rollout::new(0..count).seed(manifest.seed).each(resets);
        let mut found = BTreeMap::new();
        let mut recorder = OutcomeRecorder::new(steps, Some(manifest), |pair, result: EpisodeResult| {
            progress.count(result.success);
            found.insert(pair, result);
            Ok(())
        });
        let driven = drive(py, &world.shared, rollout, &mut recorder, Some(act), || progress.tell(self.tick));
        drop(recorder);
        driven?;
        progress.tell(self.tick)?;
        Ok(found.into_values().collect())
    }
}

/// Evaluates a policy on a manifest, and the reference policies (`random`, `no_op`, `oracle`) that `references` names; gives
/// the receipt as JSON, which is also written to the folder `out`, and whether that held it already. The result of another
/// evaluation is replaced if `again`. `begin` is called with the name of each policy before it runs.
///
/// `policy`: a native policy, or what a Python one is called in the receipt; that one comes as `foreign`, a World for the
/// manifest and its `act`. `plan_steps`: actions of one plan, where they are not known by the policy's settings.
#[pyfunction]
#[pyo3(signature = (manifest, policy, foreign=None, policy_seed=0, references=Vec::new(), oracle=None, out=None, num_envs=16, threads=None, plan_steps=None, again=false, begin=None, tick=None))]
#[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
fn evaluate_manifest(
    py: Python<'_>,
    manifest: &str,
    policy: &str,
    foreign: Option<(Bound<'_, PyWorld>, Bound<'_, PyAny>)>,
    policy_seed: u64,
    references: Vec<String>,
    oracle: Option<&str>,
    out: Option<PathBuf>,
    num_envs: usize,
    threads: Option<usize>,
    plan_steps: Option<u64>,
    again: bool,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, bool)> {
    let manifest: Manifest = from_json("the manifest", manifest)?;
    manifest.check().or_raise()?;
    let entry = registry().env(&manifest.env).or_raise()?;
    let (candidate, description, files) = match &foreign {
        None => {
            let candidate = Candidate::new(PolicyArgs::parse(policy).or_raise()?).seeded(policy_seed);
            let candidate = candidate.on(registry(), entry, &manifest);
            let made = candidate.make(registry(), entry, &manifest).map_err(boxed)?;
            let files = candidate.files(registry(), entry).map_err(boxed)?;
            (candidate, made.describe(), files)
        }
        Some(_) => {
            let args = PolicyArgs::new(policy, serde_json::Map::new());
            (Candidate::new(args).seeded(policy_seed), policy.to_owned(), BTreeMap::new())
        }
    };
    let mut wanted = wanted(entry, &manifest, &candidate, &references, oracle)?;
    if let Some(dir) = &out {
        std::fs::create_dir_all(dir).map_err(|error| {
            SwmError::new_err(format!("cannot write to the folder {}: {error}", dir.display()))
        })?;
    }
    let fingerprints = py.detach(|| fingerprints(entry, &manifest, candidate.seed)).map_err(boxed)?;
    let steps = plan_steps.unwrap_or_else(|| candidate.plan_steps(registry(), entry, &manifest));
    let identity = |candidate: &Candidate| {
        identity(&(manifest.hash(), candidate, &fingerprints, steps), &files).map_err(boxed)
    };
    let asked = Receipt::new(
        manifest.clone(),
        candidate.clone(),
        description,
        files.clone(),
        fingerprints.clone(),
        steps,
    );
    let held = match &out {
        Some(dir) if !again => held_receipt(dir, &asked, &mut wanted).map_err(boxed)?,
        _ => None,
    };
    if let (Some(_), Some(dir), Some(_)) = (&held, &out, &foreign) {
        return Err(SwmError::new_err(format!(
            "{} holds a result of `{policy}`, a policy in Python, and its name does not tell whether its code or weights are the \
             same; give another folder, or again=True to replace it",
            dir.display()
        )));
    }
    if let (Some(held), []) = (&held, wanted.as_slice()) {
        return Ok((to_json(held)?, true));
    }
    let run = Run { manifest: &manifest, out: out.as_deref(), num_envs, threads, again, begin, tick };
    let started = Instant::now();
    let (episodes, wall_time_s, mut others) = match (held, &foreign) {
        (Some(held), _) => (held.episodes, held.wall_time_s, held.references),
        (None, foreign) => {
            run.begin(policy)?;
            let episodes = match foreign {
                Some((world, act)) => run.foreign(py, world.get(), act, steps)?,
                None => run.policy(py, "episodes", &candidate, steps, &identity(&candidate)?)?,
            };
            (episodes, started.elapsed().as_secs_f64(), Vec::new())
        }
    };
    for (role, other) in wanted {
        // A planner on the true dynamics is its own oracle: nothing to run again.
        let found = match other == candidate {
            true => episodes.clone(),
            false => {
                let name = format!("episodes-{}", role.name());
                run.begin(&format!("{} (reference)", role.name().replace('-', "_")))?;
                run.policy(py, &name, &other, steps, &identity(&other)?)?
            }
        };
        others.push(Reference::new(role, other, found, &episodes));
    }
    let receipt = asked.with_results(episodes, others, wall_time_s);
    if let Some(dir) = &out {
        write_receipt(dir, &receipt).map_err(boxed)?;
    }
    Ok((to_json(&receipt)?, false))
}

/// The reference policies to run.
fn wanted(
    entry: &EnvEntry,
    manifest: &Manifest,
    candidate: &Candidate,
    names: &[String],
    oracle: Option<&str>,
) -> PyResult<Vec<(Role, Candidate)>> {
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
    let mut all = roles(registry(), entry, manifest, candidate);
    if let Some(text) = oracle {
        all.retain(|(role, _)| *role != Role::Oracle);
        let oracle = Candidate::new(PolicyArgs::parse(text).or_raise()?).seeded(candidate.seed);
        all.push((Role::Oracle, oracle.on(registry(), entry, manifest)));
    }
    all.retain(|(role, _)| is_wanted(*role));
    Ok(all)
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(manifest_json, m)?)?;
    m.add_function(wrap_pyfunction!(receipt_json, m)?)?;
    m.add_function(wrap_pyfunction!(held_out, m)?)?;
    m.add_function(wrap_pyfunction!(make_manifest, m)?)?;
    m.add_function(wrap_pyfunction!(evaluate_manifest, m)?)
}
