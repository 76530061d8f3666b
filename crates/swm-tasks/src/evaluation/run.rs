//! Running a policy on a manifest.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::error::BoxError;
use swm_core::evaluate::{EpisodeResult, OutcomeRecorder};
use swm_core::{
    Cancel, EnvConfig, EnvEntry, Manifest, Policy, PolicyArgs, PolicyContext, Recorder, Registry,
    ResetOptions, Rollout, World,
};

use super::files::env_of;
use super::hash::file_hash;
use crate::distractors;
use crate::error::TaskError;
use crate::request::NUM_ENVS;

/// A policy, and the seed of its noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Candidate {
    /// The policy's name and arguments.
    pub policy: PolicyArgs,
    /// Seed of its noise; 0: noise comes from the pairs' seeds.
    #[serde(default)]
    pub seed: u64,
}

impl Candidate {
    /// The policy as it is asked for, without a seed.
    pub fn new(policy: PolicyArgs) -> Self {
        Self { policy, seed: 0 }
    }

    /// The same, with noise of this seed.
    #[must_use]
    pub fn seeded(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// The policy as it is run on `manifest`. A planner on the true dynamics is told to look past the environment's own
    /// success where the manifest judges by another test: a plan must neither stop at the easier success nor be paid for it.
    /// Settings that are given stay.
    #[must_use]
    pub fn on(mut self, registry: &Registry, entry: &EnvEntry, manifest: &Manifest) -> Self {
        let known = registry.policy_entry(entry, &self.policy.name);
        let given = |name: &str| self.policy.named.contains_key(name);
        // Planners have names for all of their settings; a value without one asks for something else (`expert:learned`).
        if known.is_ok_and(|policy| policy.on_true_dynamics)
            && self.policy.positional.is_empty()
            && !manifest.success.is_environment()
            && !given("success_bonus")
        {
            self.policy.named.entry("stop_at_success".to_owned()).or_insert(false.into());
        }
        self
    }

    /// Makes the policy for the environments of `manifest`.
    ///
    /// # Errors
    ///
    /// No such policy, or one that does not go with the environment or its arguments.
    pub fn make(
        &self,
        registry: &Registry,
        entry: &EnvEntry,
        manifest: &Manifest,
    ) -> Result<Box<dyn Policy>, TaskError> {
        let config = manifest_config(manifest);
        let context = PolicyContext::new(entry, &config).frame_skip(manifest.frame_skip);
        Ok(registry.policy_from(&self.policy, context)?)
    }

    /// The planner on the true dynamics that it is compared with, with the candidate's seed: the same planner where the
    /// policy is one, else `cem`. A planner on the true dynamics is its own oracle.
    #[must_use]
    pub fn oracle(&self, registry: &Registry, entry: &EnvEntry, manifest: &Manifest) -> Self {
        let policy = self.own_oracle(registry, entry, manifest);
        let policy = policy.unwrap_or_else(|| PolicyArgs::new("cem", Map::new()));
        Self { policy, seed: self.seed }.on(registry, entry, manifest)
    }

    fn own_oracle(&self, registry: &Registry, entry: &EnvEntry, manifest: &Manifest) -> Option<PolicyArgs> {
        let config = manifest_config(manifest);
        let context = PolicyContext::new(entry, &config).frame_skip(manifest.frame_skip).within(registry);
        registry.policy_entry(entry, &self.policy.name).ok()?.oracle_args(&context, &self.policy)
    }

    /// Actions of one plan: blocks carried out × actions per block, by the settings of its own planner.
    pub fn plan_steps(&self, registry: &Registry, entry: &EnvEntry, manifest: &Manifest) -> u64 {
        let policy = self.own_oracle(registry, entry, manifest).unwrap_or_else(|| self.policy.clone());
        let number = |name: &str| policy.named.get(name).and_then(Json::as_u64).unwrap_or(5);
        number("receding_horizon") * number("action_block")
    }

    /// SHA-256 of every file that the policy depends on: models and normalizers.
    ///
    /// # Errors
    ///
    /// No such policy, or a file cannot be read.
    pub fn files(
        &self,
        registry: &Registry,
        entry: &EnvEntry,
    ) -> Result<BTreeMap<String, String>, TaskError> {
        let files = registry.policy_entry(entry, &self.policy.name)?.model_files(&self.policy)?;
        files.iter().map(|path| Ok((path.display().to_string(), file_hash(path)?))).collect()
    }
}

/// How policies on a manifest make environments: without images.
fn manifest_config(manifest: &Manifest) -> EnvConfig {
    EnvConfig { image: None, settings: manifest.settings.clone() }
}

/// How a run is spread, and which part of it is run. Results do not depend on it.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Environments side by side.
    pub num_envs: usize,
    /// Threads; `None`: one per core.
    pub threads: Option<usize>,
    /// What ends the run early; results that were handed on stay.
    pub cancel: Option<Cancel>,
    /// The pairs to run, in ascending order; `None`: all.
    pub pairs: Option<Vec<u64>>,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self { num_envs: NUM_ENVS, threads: None, cancel: None, pairs: None }
    }
}

/// Runs the pairs of `options` that are not in `known`, from `resets` (the manifest's own or changed ones), and calls
/// `each(pair, result)` as they end. `checked`: the first row of each must be the manifest's.
///
/// # Errors
///
/// The policy or the environment cannot be made, a distractor is unknown, a reset or step fails, or `each` fails.
#[expect(
    clippy::too_many_arguments,
    reason = "every one is a part of the protocol, and the callers differ in all"
)]
pub fn run_pairs(
    registry: &Registry,
    manifest: &Manifest,
    resets: &[ResetOptions],
    candidate: &Candidate,
    steps_per_plan: u64,
    options: &RunOptions,
    known: &BTreeMap<u64, EpisodeResult>,
    checked: bool,
    mut each: impl FnMut(u64, &EpisodeResult) -> Result<(), TaskError> + Send,
) -> Result<Vec<EpisodeResult>, TaskError> {
    let entry = env_of(registry, manifest)?;
    let missing = missing_of(manifest, options, known);
    let mut results = known.clone();
    if !missing.is_empty() {
        let most = missing.iter().map(|range| range.end - range.start).max().unwrap_or(1);
        let num_envs = options.num_envs.min(usize::try_from(most)?).max(1);
        let mut world = World::new(entry, manifest.world(num_envs, options.threads))?;
        world.set_policy(candidate.make(registry, entry, manifest)?)?;
        world.set_policy_seed(candidate.seed);
        world.set_transform(distractors::parse_all(&manifest.distractors)?);
        let mut rollout = Rollout::new(0..0).seed(manifest.seed).each(resets);
        if let Some(cancel) = &options.cancel {
            rollout = rollout.cancel(cancel);
        }
        for range in missing {
            rollout.episodes = range;
            let mut recorder =
                OutcomeRecorder::new(steps_per_plan, checked.then_some(manifest), |pair, result| {
                    each(pair, &result)?;
                    results.insert(pair, result);
                    Ok(())
                });
            world.run_pairs(manifest, &rollout, &mut recorder)?;
        }
    }
    Ok(results.into_values().collect())
}

/// A policy that no registry has, such as an object of Python: what a result holds of it, and how its episodes are run.
pub struct ForeignPolicy<'a> {
    /// The policy with its settings.
    pub description: String,
    /// SHA-256 of every file that it depends on, by name.
    pub files: BTreeMap<String, String>,
    /// Actions of one plan.
    pub plan_steps: u64,
    /// Runs the episodes of a rollout in environments of the manifest, under its budget and its test of success.
    pub run: Box<RunEpisodes<'a>>,
}

/// See [`ForeignPolicy::run`].
pub type RunEpisodes<'a> = dyn FnMut(Rollout, &mut dyn Recorder) -> Result<(), BoxError> + 'a;

impl ForeignPolicy<'_> {
    /// As [`run_pairs`], by this policy. Of `options`, only the pairs count.
    ///
    /// # Errors
    ///
    /// A reset, a step or the policy fails, or `each` fails.
    pub fn run_pairs(
        &mut self,
        manifest: &Manifest,
        resets: &[ResetOptions],
        options: &RunOptions,
        known: &BTreeMap<u64, EpisodeResult>,
        checked: bool,
        mut each: impl FnMut(u64, &EpisodeResult) -> Result<(), TaskError> + Send,
    ) -> Result<Vec<EpisodeResult>, TaskError> {
        let mut results = known.clone();
        for range in missing_of(manifest, options, known) {
            let rollout = Rollout::new(range).seed(manifest.seed).each(resets);
            let mut recorder =
                OutcomeRecorder::new(self.plan_steps, checked.then_some(manifest), |pair, result| {
                    each(pair, &result)?;
                    results.insert(pair, result);
                    Ok(())
                });
            (self.run)(rollout, &mut recorder)?;
        }
        Ok(results.into_values().collect())
    }
}

/// The stretches of pairs that are to be run and are not known.
fn missing_of(
    manifest: &Manifest,
    options: &RunOptions,
    known: &BTreeMap<u64, EpisodeResult>,
) -> Vec<Range<u64>> {
    match &options.pairs {
        Some(pairs) => missing(pairs.iter().copied(), known),
        None => missing(0..manifest.pairs.len() as u64, known),
    }
}

/// The stretches of ascending `pairs` that are not known.
fn missing(pairs: impl Iterator<Item = u64>, known: &BTreeMap<u64, EpisodeResult>) -> Vec<Range<u64>> {
    let mut ranges: Vec<Range<u64>> = Vec::new();
    for pair in pairs.filter(|pair| !known.contains_key(pair)) {
        match ranges.last_mut() {
            Some(range) if range.end == pair => range.end += 1,
            _ => ranges.push(pair..pair + 1),
        }
    }
    ranges
}
