//! Evaluation: run named episodes to their end, count successes, and say how sure one can be.
//!
//! A [`Manifest`] fixes what is evaluated: pairs of start and goal, budget, and a [`SuccessRule`] outside of the environment.
//! [`World::run_pairs`] runs it, [`OutcomeRecorder`] watches, [`stats`] compares. Files are not known here.

mod chosen;
mod fit;
mod from_dataset;
mod goal_images;
mod hash;
mod manifest;
mod model_entry;
mod outcome;
mod pairs;
pub mod quality;
mod ranking;
mod runs;
mod state_model;
pub mod stats;
mod transfer;
mod violation;

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::dataset::Metadata;
use crate::error::{BoxError, WorldError};
use crate::recorder::{LiveStep, Recorder};
use crate::run::{EpisodeEnd, Rollout, RunInfo};
use crate::world::World;

pub use crate::success::{Condition, Judge, Measure, SuccessRule, Symmetry};
pub use chosen::ChosenPair;
pub use fit::check_fit;
pub use from_dataset::{EvalOptions, choose_starts};
pub use goal_images::GoalImages;
pub use hash::{sha256, sha256_of, sorted, witness};
pub use manifest::{Excluded, MANIFEST_VERSION, Manifest, Pair, PairSource, Tier};
pub use model_entry::{MakeModel, ModelEntry};
pub use outcome::{EpisodeResult, OutcomeRecorder, Summary};
pub use pairs::{ManifestOptions, RecordedPairs, is_held_out, make_manifest};
pub use ranking::{Distances, RankingOptions, action_ranking};
pub use runs::{PairedRuns, sign_flip_exact};
pub use state_model::StateModel;
pub use stats::{PairedTest, wilson95};
pub use transfer::Transfer;
pub use violation::{Violation, ViolationOptions, random_episodes, violation_pairs};

/// The result of an evaluation, indexed by episode: independent of environments, threads and completion order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Evaluation {
    /// Whether the task says what success is. Where it does not, all episodes count as failed and only returns mean
    /// something.
    #[serde(default = "yes")]
    pub has_success: bool,
    /// Successful episodes in percent.
    pub success_rate: f64,
    /// The number of episodes.
    pub episodes: usize,
    /// 95 % Wilson interval of the success rate, in percent.
    pub ci95: [f64; 2],
    /// Whether each episode succeeded at any step (the start included).
    pub episode_successes: Vec<bool>,
    /// The seed of each episode.
    pub seeds: Vec<i64>,
    /// Actions taken in each episode.
    pub episode_lengths: Vec<u64>,
    /// Sum of rewards of each episode.
    pub episode_returns: Vec<f64>,
    /// The first successful step of each episode (0: at the start).
    pub first_success_steps: Vec<Option<u64>>,
    /// How many were solved before the first action.
    pub solved_at_start: usize,
    /// Mean length of the successful episodes; `None` without any.
    pub mean_success_steps: Option<f64>,
    /// Environment, factors, policy, versions: what it takes to repeat the evaluation.
    pub setup: Metadata,
    /// For evaluations from a dataset: the protocol and the pairs.
    pub protocol: Option<DatasetProtocol>,
    /// Wall time of the run, in seconds. The only entry that differs between repetitions.
    pub wall_time_s: f64,
}

/// Results from before the field say nothing of it.
fn yes() -> bool {
    true
}

/// How start and goal were taken from a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct DatasetProtocol {
    /// The goal is this many rows after the start.
    pub goal_offset: usize,
    /// Actions allowed.
    pub budget: u64,
    /// Where each evaluated episode starts: `[episode, row]` of the dataset.
    pub starts: Vec<[usize; 2]>,
    /// The description of the dataset.
    pub dataset: Option<Metadata>,
    /// Where the images of goals came from; `None`: there were none, or the result is older than this entry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal_images: Option<GoalImages>,
}

/// A recorder that builds an [`Evaluation`], whose time runs from when this is made: the first plan is made before a run is recorded.
pub struct EvaluationRecorder {
    setup: Option<Metadata>,
    ends: BTreeMap<u64, EpisodeEnd>,
    started: Instant,
}

impl Default for EvaluationRecorder {
    fn default() -> Self {
        Self { setup: None, ends: BTreeMap::new(), started: Instant::now() }
    }
}

impl EvaluationRecorder {
    /// The result, after the run.
    pub fn result(self) -> Evaluation {
        let ends: Vec<EpisodeEnd> = self.ends.into_values().collect();
        let successes: Vec<bool> = ends.iter().map(|end| end.success.unwrap_or(false)).collect();
        let won = successes.iter().filter(|&&success| success).count();
        let steps: Vec<f64> = ends
            .iter()
            .filter(|end| end.success == Some(true))
            .map(|end| end.first_success_step.unwrap_or(end.steps) as f64)
            .collect();
        Evaluation {
            has_success: ends.is_empty() || ends.iter().any(|end| end.success.is_some()),
            success_rate: if ends.is_empty() { 0.0 } else { 100.0 * won as f64 / ends.len() as f64 },
            episodes: ends.len(),
            ci95: wilson95(won, ends.len()),
            episode_successes: successes,
            seeds: ends.iter().map(|end| end.seed.value()).collect(),
            episode_lengths: ends.iter().map(|end| end.steps).collect(),
            episode_returns: ends.iter().map(|end| end.total_reward).collect(),
            first_success_steps: ends.iter().map(|end| end.first_success_step).collect(),
            solved_at_start: ends.iter().filter(|end| end.success_at_start == Some(true)).count(),
            mean_success_steps: (!steps.is_empty()).then(|| steps.iter().sum::<f64>() / steps.len() as f64),
            setup: self.setup.unwrap_or_default(),
            protocol: None,
            wall_time_s: self.started.elapsed().as_secs_f64(),
        }
    }
}

impl Recorder for EvaluationRecorder {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        self.setup = Some(Metadata::of(run));
        Ok(())
    }

    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.ends.insert(end.index, *end);
        Ok(())
    }
}

impl World {
    /// Runs the episodes of `rollout` under the attached policy and counts successes.
    ///
    /// # Errors
    ///
    /// As [`World::run`].
    pub fn evaluate(&mut self, rollout: &Rollout) -> Result<Evaluation, WorldError> {
        self.evaluate_with(rollout, &mut ())
    }

    /// As [`World::evaluate`], watched by another recorder too.
    ///
    /// # Errors
    ///
    /// As [`World::run`].
    pub fn evaluate_with(
        &mut self,
        rollout: &Rollout,
        recorder: &mut dyn Recorder,
    ) -> Result<Evaluation, WorldError> {
        let mut evaluation = EvaluationRecorder::default();
        self.run(rollout, &mut (&mut evaluation, recorder))?;
        Ok(evaluation.result())
    }
}
