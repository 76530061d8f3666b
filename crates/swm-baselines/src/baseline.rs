//! The boundary of this crate: models that train on slices of numbers and plan or act from them. No tensors.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_data::loader::GoalWeights;
use swm_solvers::Candidates;

use crate::data::{ClipBatch, Facts, Observations, Scenes};
use crate::error::BaselineError;
use crate::optim::OptimConfig;

/// A model that can be trained, saved, and asked for plans or actions.
///
/// Training is a function of settings, facts, seed and batches: the noise of a step is keyed by the seed and the number
/// of the step. So a training that is saved with [`Baseline::save_training`] and resumed gives the bits of one that
/// never stopped.
pub trait Baseline: Send {
    /// Its line in [`crate::BASELINES`].
    fn name(&self) -> &'static str;

    /// What makes it again: give it to [`crate::restore`].
    fn recipe(&self) -> &Recipe;

    /// What it must be fed with.
    fn needs(&self) -> &Needs;

    /// The parts of its training, one after another.
    fn phases(&self) -> &[Phase];

    /// How many numbers are trained.
    fn parameters(&self) -> usize;

    /// Whether it has an encoder that no phase trains: its weights are to be given ([`Baseline::load_encoder`]).
    fn has_frozen_encoder(&self) -> bool;

    /// One step of training: loss, gradients, clipping, optimizer, teachers. An error leaves the weights as they were.
    ///
    /// # Errors
    ///
    /// A loss or gradient is not finite, the batch is of another form, or there is no such phase.
    fn train_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Losses, BaselineError>;

    /// The loss of a phase as the trained model has it: without dropout, with running statistics.
    ///
    /// # Errors
    ///
    /// The batch is of another form, or there is no such phase. A loss that is not finite is none.
    fn validate(&self, batch: &ClipBatch<'_>, phase: usize) -> Result<Losses, BaselineError>;

    /// Writes the weights as safetensors, with PyTorch's names and layouts.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    fn save_weights(&self, path: &Path) -> Result<(), BaselineError>;

    /// Takes the weights of a `.safetensors`, `.pt`, `.pth` or `.ckpt` file: all of them, or none and an error.
    ///
    /// # Errors
    ///
    /// The file cannot be read, lacks a weight or holds one of another shape.
    fn load_weights(&mut self, path: &Path) -> Result<(), BaselineError>;

    /// Takes the weights of the encoder alone, from a file of that network: a published DINOv2.
    ///
    /// # Errors
    ///
    /// As of [`Baseline::load_weights`]; or the model has no encoder of that kind.
    fn load_encoder(&mut self, path: &Path) -> Result<(), BaselineError>;

    /// Writes what a training needs beside the weights to go on: the state of the optimizers.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    fn save_training(&self, path: &Path) -> Result<(), BaselineError>;

    /// Takes what [`Baseline::save_training`] wrote.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or is of another model.
    fn load_training(&mut self, path: &Path) -> Result<(), BaselineError>;

    /// A copy of the model as it is now that predicts what plans lead to; `None` if it is no world model.
    fn planner(&self) -> Option<Box<dyn PlanModel>>;

    /// A copy of the model as it is now that acts by itself; `None` if it is no policy.
    fn policy(&self) -> Option<Box<dyn GoalPolicy>>;
}

/// A world model at work: encodes observation and goal once per plan, then tells the costs of candidates.
///
/// The cost of a candidate depends on its own scene and numbers only. The same candidate costs the same bits whatever
/// stands beside it.
pub trait PlanModel: Send {
    /// D = F × A: numbers of a block of a plan, scaled as the model's actions.
    fn block_width(&self) -> usize;

    /// N: how many observations it can make use of.
    fn history(&self) -> usize;

    /// Z: numbers of the latent of an observation.
    fn latent_width(&self) -> usize;

    /// Fills `latents`, `[B, Z]`, with those of B observations by themselves.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn encode(&mut self, seen: &Observations<'_>, latents: &mut [f32]) -> Result<(), BaselineError>;

    /// Replaces `latents`, `[B, Z]`, by what follows them under `actions`, `[B, D]`, if nothing is known of what was before.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn predict(&mut self, latents: &mut [f32], actions: &[f32]) -> Result<(), BaselineError>;

    /// Once per plan: B scenes.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn prepare(&mut self, scenes: &Scenes<'_>) -> Result<(), BaselineError>;

    /// Fills `costs`, `[B, S]`: how far the predicted end of each candidate, `[B, S, H, D]`, is from the goal.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), BaselineError>;

    /// As [`PlanModel::evaluate`], and fills `gradient`, `[B, S, H, D]`, with the derivatives of each cost with respect
    /// to its own candidate.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), BaselineError>;
}

/// A goal-conditioned policy at work.
pub trait GoalPolicy: Send {
    /// D = F × A: numbers of a decision, scaled as the model's actions.
    fn block_width(&self) -> usize;

    /// N: how many observations it can make use of.
    fn history(&self) -> usize;

    /// Fills `actions`, `[B, D]`, with the mean action of each of B scenes.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn act(&mut self, scenes: &Scenes<'_>, actions: &mut [f32]) -> Result<(), BaselineError>;
}

/// Where a training is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// The seed of the training.
    pub seed: u64,
    /// Which of the phases.
    pub phase: usize,
    /// The step of the phase, from 0.
    pub step: u64,
    /// The steps of the phase: what schedules end with.
    pub total: u64,
}

/// What a model must be fed with: the loader's settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Needs {
    /// T: rows of a clip.
    pub num_steps: usize,
    /// F: distance of two rows in the dataset, and the actions of a row.
    pub frameskip: usize,
    /// The side of images. Others are resized; it is cheaper to let the loader do that.
    pub image: usize,
    /// Whether `proprio` is used.
    pub proprio: bool,
    /// Clips of a batch, as the recipe of the paper or the preset has it.
    pub batch: usize,
}

/// A part of a training: one loss, one optimizer.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Its name.
    pub name: &'static str,
    /// Its optimizer.
    pub optim: OptimConfig,
    /// The goals that clips get, for goal-conditioned models.
    pub goals: Option<PhaseGoals>,
    /// Tensors that it trains, by what their names begin with.
    pub(crate) trains: &'static [&'static str],
    /// Teachers that follow after each step: what they follow, and what follows.
    pub(crate) teachers: &'static [(&'static str, &'static str)],
    /// The share of the old in a teacher.
    pub(crate) momentum: f64,
}

/// Which goals clips get: see [`swm_data::loader::GoalOptions`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseGoals {
    /// Weights of the kinds.
    pub weights: GoalWeights,
    /// The discount of geometric goals.
    pub gamma: f64,
    /// Which row of the clip is the current one, counted from 1.
    pub offset: usize,
}

/// The losses of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Losses {
    /// What is minimized.
    pub total: f32,
    /// Its parts, before they are weighed, and other numbers worth watching: `lr`, `gradient_norm`.
    pub parts: Vec<(&'static str, f32)>,
}

/// What makes a model again, but for its weights: the JSON beside every checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Its line in [`crate::BASELINES`].
    pub baseline: String,
    /// The preset that the settings began with.
    pub preset: String,
    /// All settings.
    pub settings: Json,
    /// The data that it was made for.
    pub facts: Facts,
    /// The seed of its first weights.
    pub seed: u64,
}
