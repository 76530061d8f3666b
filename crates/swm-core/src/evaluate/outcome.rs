//! What each episode of a manifest came to: a recorder, and the run that it watches.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::hash::{Fnv, witness};
use super::manifest::Manifest;
use super::wilson95;
use crate::batch::Dtype;
use crate::env::{EnvConfig, EnvSpec};
use crate::error::{BoxError, WorldError};
use crate::recorder::{LiveStep, Recorder};
use crate::run::{EpisodeEnd, Rollout, RunInfo, WorldOptions};
use crate::world::World;

/// What one episode came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct EpisodeResult {
    /// Whether the goal was reached, by the manifest's test.
    pub success: bool,
    /// Whether it was before the first action.
    pub solved_at_start: bool,
    /// The first row of the success (0: the start).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_success_step: Option<u64>,
    /// Actions taken.
    pub steps: u64,
    /// Sum of rewards; none if the environment gives none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total_reward: Option<f64>,
    /// How near the goal was at its nearest, as a part of what the test allows; below 1 is reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best_margin: Option<f64>,
    /// The same at the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_margin: Option<f64>,
    /// The true task cost when the first plan had been carried out, or at the end if that came first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan_cost: Option<f64>,
    /// The true task cost when each plan had been carried out, `[plans]`, the last one's at the end if that came first; none
    /// where it is no number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plan_costs: Vec<Option<f64>>,
    /// The true task cost at the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub final_cost: Option<f64>,
    /// Digest of the actions of the first plan: of what the policy wanted.
    pub decisions: String,
    /// Digest of every row, images apart, actions included: of what happened.
    pub digest: String,
}

impl EpisodeResult {
    /// Whether a repetition is the same, as far as this result goes: older ones say nothing of the later plans' costs.
    pub fn is_repeated_by(&self, again: &Self) -> bool {
        match self.plan_costs.is_empty() {
            true => *self == Self { plan_costs: Vec::new(), ..again.clone() },
            false => self == again,
        }
    }
}

/// What several episodes came to together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Summary {
    /// Episodes.
    pub episodes: usize,
    /// Successful ones.
    pub successes: usize,
    /// Successful ones in percent.
    pub success_rate: f64,
    /// 95 % Wilson interval of it, in percent.
    pub ci95: [f64; 2],
    /// Episodes that were solved before the first action.
    pub solved_at_start: usize,
    /// Mean step of success; none without any.
    pub mean_success_steps: Option<f64>,
}

impl Summary {
    /// Counts.
    pub fn of<'a>(episodes: impl IntoIterator<Item = &'a EpisodeResult>) -> Self {
        let episodes: Vec<&EpisodeResult> = episodes.into_iter().collect();
        let successes = episodes.iter().filter(|episode| episode.success).count();
        let steps: Vec<f64> = episodes
            .iter()
            .filter_map(|episode| episode.first_success_step)
            .map(|step| step as f64)
            .collect();
        Self {
            episodes: episodes.len(),
            successes,
            success_rate: 100.0 * successes as f64 / episodes.len().max(1) as f64,
            ci95: wilson95(successes, episodes.len()),
            solved_at_start: episodes.iter().filter(|episode| episode.solved_at_start).count(),
            mean_success_steps: (!steps.is_empty()).then(|| steps.iter().sum::<f64>() / steps.len() as f64),
        }
    }
}

/// Watches the episodes of a manifest, and hands each result on as soon as it is known.
pub struct OutcomeRecorder<'a> {
    /// Actions of a plan.
    plan_steps: u64,
    /// What the first row of each episode must be; nothing where starts are changed on purpose.
    manifest: Option<&'a Manifest>,
    spec: Option<EnvSpec>,
    /// Positions of what enters digests.
    digested: Vec<usize>,
    action: usize,
    ends: [usize; 2],
    open: BTreeMap<u64, Open>,
    each: Box<dyn FnMut(u64, EpisodeResult) -> Result<(), BoxError> + Send + 'a>,
}

#[derive(Default)]
struct Open {
    rows: Fnv,
    decisions: Fnv,
    plan_costs: Vec<Option<f64>>,
    final_cost: Option<f64>,
}

impl<'a> OutcomeRecorder<'a> {
    /// `each(episode, result)` is called for every episode as it ends. With `manifest`, the first row of every episode is
    /// compared with its witness.
    pub fn new(
        plan_steps: u64,
        manifest: Option<&'a Manifest>,
        each: impl FnMut(u64, EpisodeResult) -> Result<(), BoxError> + Send + 'a,
    ) -> Self {
        let (digested, open) = (Vec::new(), BTreeMap::new());
        let each = Box::new(each);
        Self { plan_steps, manifest, spec: None, digested, action: 0, ends: [0; 2], open, each }
    }

    fn check_witness(&self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let (Some(manifest), Some(spec)) = (self.manifest, &self.spec) else { return Ok(()) };
        let pair = manifest.pairs.get(row.episode.index as usize);
        let (Some(pair), found) = (pair, witness(spec, row.values)) else { return Ok(()) };
        if pair.witness == found {
            return Ok(());
        }
        Err(format!(
            "episode {}: {} no longer starts as the manifest says (first row {found}, manifest {}); the environment or its \
             factors have changed since: make the manifest again, or use the version it was made with",
            row.episode.index, spec.id, pair.witness
        )
        .into())
    }
}

impl Recorder for OutcomeRecorder<'_> {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        let image = |index: &usize| {
            let field = &run.spec.fields[*index];
            field.dtype == Dtype::U8 && field.shape.len() == 3
        };
        self.digested = (0..run.spec.fields.len()).filter(|index| !image(index)).collect();
        self.action = run.schema.require("action")?;
        self.ends = [run.schema.require("terminated")?, run.schema.require("truncated")?];
        self.spec = Some(run.spec.clone());
        Ok(())
    }

    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        if row.episode.step == 0 {
            self.check_witness(row)?;
        }
        let open = self.open.entry(row.episode.index).or_default();
        self.digested.iter().for_each(|&index| open.rows.slice(row.values.at(index)));
        open.rows.slice(row.values.at(self.action));
        let is_last = self.ends.iter().any(|&index| row.values.at(index).as_f64(0) == Some(1.0));
        if row.episode.step < self.plan_steps && !is_last {
            open.decisions.slice(row.values.at(self.action));
        }
        let planned = row.episode.step > 0 && row.episode.step.is_multiple_of(self.plan_steps.max(1));
        if planned || is_last {
            let cost = row.task_cost();
            // A row at which a plan ends and the episode too counts once.
            open.plan_costs.extend(cost.map(|cost| Some(cost).filter(|cost| cost.is_finite())));
            open.final_cost = cost.filter(|cost| cost.is_finite());
        }
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        let open = self.open.remove(&end.index).unwrap_or_default();
        let finite = |margin: f64| Some(margin).filter(|margin| margin.is_finite());
        let result = EpisodeResult {
            success: end.success == Some(true),
            solved_at_start: end.success_at_start == Some(true),
            first_success_step: end.first_success_step,
            steps: end.steps,
            total_reward: finite(end.total_reward),
            best_margin: end.margins.and_then(|margins| finite(margins.best)),
            last_margin: end.margins.and_then(|margins| finite(margins.last)),
            plan_cost: open.plan_costs.first().copied().flatten(),
            plan_costs: open.plan_costs,
            final_cost: open.final_cost,
            decisions: open.decisions.finish(),
            digest: open.rows.finish(),
        };
        (self.each)(end.index, result)
    }
}

impl Manifest {
    /// How a world for it is built.
    pub fn world(&self, num_envs: usize, threads: Option<usize>) -> WorldOptions {
        WorldOptions::new(num_envs)
            .env(EnvConfig { image: self.image, settings: self.settings.clone() })
            .max_episode_steps(self.budget)
            .frame_skip(self.frame_skip)
            .threads(threads)
    }
}

impl World {
    /// Runs pairs of a manifest under the attached policy, judged by its test and within its budget: the episodes of
    /// `rollout`, whose reset options are the manifest's own ([`Manifest::rollout`]) or changed ones.
    ///
    /// # Errors
    ///
    /// The manifest is for another environment or frame skip, or fails [`Manifest::check`]; whatever [`World::run`]
    /// may meet.
    pub fn run_pairs(
        &mut self,
        manifest: &Manifest,
        rollout: &Rollout,
        recorder: &mut dyn Recorder,
    ) -> Result<(), WorldError> {
        manifest.check()?;
        let refuse = |reason: String| Err(WorldError::Option { option: "manifest", reason });
        if manifest.env != self.spec.id {
            return refuse(format!("is for `{}`, this world is `{}`", manifest.env, self.spec.id));
        }
        if manifest.frame_skip != self.options().frame_skip {
            let found = self.options().frame_skip;
            return refuse(format!("has frame skip {}, this world {found}", manifest.frame_skip));
        }
        if rollout.seed != manifest.seed {
            return refuse(format!("has seed {}, this rollout {}", manifest.seed, rollout.seed));
        }
        self.set_success(&manifest.success)?;
        self.set_max_episode_steps(Some(manifest.budget));
        self.run(rollout, recorder)
    }
}
