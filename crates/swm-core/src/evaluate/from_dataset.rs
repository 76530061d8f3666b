//! Goals from a dataset: start at a recorded row, reach what was recorded `goal_offset` rows later.
//!
//! Start, goal and factors are restored in the environment and rendered by it. The goal's image is the recorded frame, where that
//! shows what the environment would: see [`GoalImages`].

use std::collections::BTreeMap;

use rand::seq::index;

use super::fit::check_fit;
use super::goal_images::recorded_frame;
use super::{DatasetProtocol, Evaluation, GoalImages};
use crate::batch::Value;
use crate::dataset::{Dataset, Metadata, recorded_goal, recorded_state};
use crate::env::{EnvSpec, ResetOptions};
use crate::error::{BoxError, WorldError};
use crate::recorder::Recorder;
use crate::run::{Cancel, Rollout};
use crate::seed::{EpisodeSeed, keyed};
use crate::world::World;

/// The protocol of an evaluation from a dataset.
#[derive(Clone, Debug)]
pub struct EvalOptions {
    /// How many start rows are sampled, uniformly over all valid rows, without repetition.
    pub episodes: usize,
    /// The goal is this many rows after the start.
    pub goal_offset: usize,
    /// Actions allowed.
    pub budget: u64,
    /// Seed of the choice of rows and of the run.
    pub seed: u64,
    /// Factors to sample anew instead of restoring the recorded ones: names, groups or `all`.
    pub variation: Vec<String>,
    /// Factors to set instead.
    pub variation_values: BTreeMap<String, Value>,
    /// What ends the run early; see [`Rollout::cancel`].
    pub cancel: Option<Cancel>,
}

impl Default for EvalOptions {
    /// The reference's protocol: 50 pairs, goals 25 rows ahead, 50 actions, seed 42.
    fn default() -> Self {
        Self {
            episodes: 50,
            goal_offset: 25,
            budget: 50,
            seed: 42,
            variation: Vec::new(),
            variation_values: BTreeMap::new(),
            cancel: None,
        }
    }
}

impl World {
    /// Evaluates the attached policy from start and goal rows of a dataset: rows sampled uniformly, the goal
    /// [`EvalOptions::goal_offset`] rows after the start. The reference's protocol; a [`crate::Manifest`] makes a better one.
    ///
    /// # Errors
    ///
    /// A budget of 0, a dataset without an episode that is long enough or without the columns that starts and goals take, one that
    /// [`check_fit`] refuses, and all of [`World::run`].
    pub fn evaluate_from_dataset(
        &mut self,
        source: &mut dyn Dataset,
        options: &EvalOptions,
    ) -> Result<Evaluation, WorldError> {
        self.evaluate_from_dataset_with(source, options, &mut ())
    }

    /// As [`World::evaluate_from_dataset`], watched by another recorder too.
    ///
    /// # Errors
    ///
    /// As [`World::evaluate_from_dataset`].
    pub fn evaluate_from_dataset_with(
        &mut self,
        source: &mut dyn Dataset,
        options: &EvalOptions,
        recorder: &mut dyn Recorder,
    ) -> Result<Evaluation, WorldError> {
        if options.budget == 0 {
            return Err(WorldError::Option {
                option: "budget",
                reason: "0 actions; use 1 or more".to_owned(),
            });
        }
        // What other programs recorded, and its copies, may fit.
        let known = source.metadata().and_then(Metadata::of_known_env);
        if let Some(Metadata { env, .. }) = known
            && *env != self.spec.id
        {
            let reason = format!("was recorded in `{env}`, this world is `{}`", self.spec.id);
            return Err(WorldError::Dataset(reason.into()));
        }
        if let Some(metadata) = known
            && metadata.frame_skip != self.options().frame_skip
        {
            let reason = format!(
                "was recorded with frame skip {}, this world has {}: its rows are another time apart",
                metadata.frame_skip,
                self.options().frame_skip
            );
            return Err(WorldError::Dataset(reason.into()));
        }
        check_fit(source, &self.spec).map_err(WorldError::Dataset)?;
        let starts =
            choose_starts(&source.info().lengths, options.episodes, options.goal_offset, options.seed)
                .map_err(WorldError::Dataset)?;
        let goal_images = GoalImages::of(self, source, options);
        let resets = starts
            .iter()
            .map(|&start| reset_options(&self.spec, source, start, options, goal_images.as_ref()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(WorldError::Dataset)?;
        let mut rollout = Rollout::new(0..starts.len() as u64).seed(options.seed).each(resets);
        if let Some(cancel) = &options.cancel {
            rollout = rollout.cancel(cancel);
        }
        let limit = self.set_max_episode_steps(Some(options.budget));
        let result = self.evaluate_with(&rollout, recorder);
        self.set_max_episode_steps(limit);
        let mut evaluation = result?;
        evaluation.setup.variation = Some(options.variation.clone());
        evaluation.setup.variation_values =
            options.variation_values.iter().map(|(name, value)| (name.clone(), value.to_json())).collect();
        evaluation.protocol = Some(DatasetProtocol {
            goal_offset: options.goal_offset,
            budget: options.budget,
            starts,
            dataset: source.metadata().cloned(),
            goal_images,
        });
        Ok(evaluation)
    }
}

/// Rows `[episode, row]` that have a goal row `goal_offset` later in episodes of these lengths, sampled uniformly over rows,
/// sorted: the rows of an evaluation from a dataset with this seed.
///
/// # Errors
/// Fewer rows than `count` have a goal, or none is asked for.
pub fn choose_starts(
    lengths: &[usize],
    count: usize,
    goal_offset: usize,
    seed: u64,
) -> Result<Vec<[usize; 2]>, BoxError> {
    let valid = |episode: usize| lengths[episode].saturating_sub(goal_offset);
    let mut total = 0;
    let count_up = |episode| {
        total += valid(episode);
        total
    };
    let ends: Vec<usize> = (0..lengths.len()).map(count_up).collect();
    if total < count || count == 0 {
        return Err(format!(
            "{} start row(s) asked for, but only {total} row(s) of {} episode(s) have a goal {} rows later; ask for \
             fewer episodes, a smaller goal offset, or record more",
            count,
            lengths.len(),
            goal_offset,
        )
        .into());
    }
    let mut rng = keyed(seed, "evaluation starts", [0, 0]);
    let mut rows = index::sample(&mut rng, total, count).into_vec();
    rows.sort_unstable();
    Ok(rows
        .into_iter()
        .map(|row| {
            let episode = ends.partition_point(|&end| end <= row);
            [episode, row + valid(episode) - ends[episode]]
        })
        .collect())
}

/// What a reset needs to stand at a recorded row with a recorded goal.
fn reset_options(
    spec: &EnvSpec,
    source: &mut dyn Dataset,
    [episode, row]: [usize; 2],
    options: &EvalOptions,
    goal_images: Option<&GoalImages>,
) -> Result<ResetOptions, BoxError> {
    let mut reset = recorded_state(spec, source, episode, row)?;
    let goal = [episode, row + options.goal_offset];
    reset.goal = Some(recorded_goal(spec, source, goal, goal_images.is_some())?);
    if goal_images == Some(&GoalImages::Recorded) {
        reset.goal_image = Some(recorded_frame(source, goal)?);
    }
    reset.seed = Some(EpisodeSeed::of(options.seed, (episode as u64) << 32 | row as u64));
    reset.variation_values.retain(|name, _| !spec.samples(&options.variation, name));
    reset.variation_values.extend(options.variation_values.clone());
    reset.variation = Some(options.variation.clone());
    Ok(reset)
}
