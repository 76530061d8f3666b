//! The interface of this crate: models that train, plan and act on slices of values. No tensors.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_data::loader::GoalWeights;
use swm_solvers::{Aggregate, Candidates, Outputs};

use crate::data::{ClipBatch, DataDims, Images, Observations, PlanningBatch};
use crate::error::BaselineError;
use crate::precision::Precision;
use swm_nn::optim::OptimConfig;

/// A model that can be trained, saved, and asked for plans or actions.
///
/// Training is a function of settings, data dimensions, seed and batches: the noise of a step is keyed by the seed and the
/// index of the step. So a training that is saved with [`Baseline::save_training`] and resumed gives the bits of one that
/// never stopped.
pub trait Baseline: Send {
    /// Its line in [`crate::BASELINES`].
    fn name(&self) -> &'static str;

    /// Its model config, from which [`crate::restore`] makes it again.
    fn model_config(&self) -> &ModelConfig;

    /// The input that it takes.
    fn input_spec(&self) -> &InputSpec;

    /// The parts of its training, one after another.
    fn phases(&self) -> &[Phase];

    /// Number of trainable parameters.
    fn parameters(&self) -> usize;

    /// Names and shapes of its tensors, as its weights have them.
    fn tensors(&self) -> Vec<(String, Vec<usize>)>;

    /// Whether it has an encoder that no phase trains: its weights are to be given ([`Baseline::load_encoder`]).
    fn has_frozen_encoder(&self) -> bool;

    /// Whether all that training takes from an image is the latent of its frozen encoder ([`PlanModel::encode`]), which clips may
    /// then hold in place of it: each image is encoded once, however often clips hold it.
    fn trains_on_latents(&self) -> bool {
        false
    }

    /// What encodes images for [`Baseline::trains_on_latents`]: the model itself, unless it has a world model for that.
    fn latent_encoder(&self) -> Option<Box<dyn PlanModel>> {
        self.planner()
    }

    /// Whether it learns from images in the canonical look ([`ClipBatch::canonical`]).
    fn learns_canonical(&self) -> bool {
        false
    }

    /// Whether vectors must be scaled as those of its frozen encoder were, and not by statistics of the data that it is trained on.
    fn has_scales_of_its_encoder(&self) -> bool {
        false
    }

    /// Sets the precision of linear layers and attention, in training and use; at first fp32. Weights stay in fp32.
    fn set_precision(&mut self, _precision: Precision) {}

    /// One step of training: loss, gradients, clipping, optimizer, target networks. An error leaves the weights as they were.
    ///
    /// # Errors
    ///
    /// A loss or gradient is not finite, the batch is of another form, or there is no such phase.
    fn train_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Losses, BaselineError>;

    /// As [`Baseline::train_step`], without waiting for a device other than the CPU: `None` where the losses are still to
    /// come, from [`Baseline::take_losses`]. On such a device, a loss or gradient that is not finite spoils the weights.
    ///
    /// # Errors
    ///
    /// As of [`Baseline::train_step`]; where it does not wait, the error of a loss comes with the losses.
    fn start_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Option<Losses>, BaselineError> {
        self.train_step(batch, at).map(Some)
    }

    /// The losses that [`Baseline::start_step`] did not wait for, of all steps since the last call, in order.
    ///
    /// # Errors
    ///
    /// A loss or gradient of one of the steps was not finite; the weights are of no use.
    fn take_losses(&mut self) -> Result<Vec<Losses>, BaselineError> {
        Ok(Vec::new())
    }

    /// The loss of a phase as the trained model has it: without dropout, with running statistics, and with the average of the
    /// weights where `optim.ema` is set.
    ///
    /// # Errors
    ///
    /// The batch is of another form, or there is no such phase. A loss that is not finite is none.
    fn validate(&self, batch: &ClipBatch<'_>, phase: usize) -> Result<Losses, BaselineError>;

    /// Takes a batch into the running statistics of batch normalization, with the weights that are saved and without dropout:
    /// the first, `before` it 0, replaces what training has gathered. A model without batch normalization does nothing.
    ///
    /// # Errors
    ///
    /// As of [`Baseline::validate`].
    fn estimate_statistics(
        &mut self,
        _batch: &ClipBatch<'_>,
        _phase: usize,
        _before: u64,
    ) -> Result<(), BaselineError> {
        Ok(())
    }

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

    /// As [`Baseline::load_weights`], where the file may lack what neither plans nor actions need, and the encoder if its weights are
    /// those of another file, `encoder`. What is in neither stays as it is; the names of that.
    ///
    /// # Errors
    ///
    /// As of [`Baseline::load_weights`].
    fn load_for_use(&mut self, path: &Path, _encoder: Option<&Path>) -> Result<Vec<String>, BaselineError> {
        self.load_weights(path).map(|()| Vec::new())
    }

    /// Takes the weights of the encoder alone, from a file of that network: a published DINOv2.
    ///
    /// # Errors
    ///
    /// As of [`Baseline::load_weights`]; or the model has no encoder of that kind.
    fn load_encoder(&mut self, path: &Path) -> Result<(), BaselineError>;

    /// Writes what resuming needs in addition to the weights: the state of the optimizers, and the weights themselves where
    /// their average is what is saved.
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

    /// Settings of the MPC policy with which the model plans, where its own defaults are for models of blocks of actions.
    fn plan_settings(&self) -> Map<String, Json> {
        Map::new()
    }

    /// A copy of the model as it is now that acts by itself; `None` if it is no policy.
    fn policy(&self) -> Option<Box<dyn GoalPolicy>>;

    /// A copy of the model as it is now that draws images in the canonical look; `None` if it does not.
    fn canonicalizer(&self) -> Option<Box<dyn Canonicalizer>> {
        None
    }

    /// A copy of the model as it is now that acts on latents of its world model; `None` if it does not.
    fn latent_policy(&self) -> Option<Box<dyn LatentPolicy>> {
        None
    }
}

/// A world model at work: encodes observation and goal once per plan, then computes the costs of candidates.
///
/// The cost of a candidate depends only on its own values and planning problem: its bits are the same in any batch.
pub trait PlanModel: Send {
    /// D = F × A: values of a block of a plan, scaled as the model's actions.
    fn block_dim(&self) -> usize;

    /// N: how many observations it can make use of.
    fn history(&self) -> usize;

    /// Sets how the distances of a plan's predicted states from the goal become its cost. At first the last one counts.
    fn set_aggregate(&mut self, aggregate: Aggregate);

    /// Z: values of the latent of an observation.
    fn latent_dim(&self) -> usize;

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

    /// Fills `next`, `[N, Z]`, with what follows `latents`, `[N, Z]`, under `actions`, `[N, D]`, as [`PlanModel::predict`] does, and
    /// `gradient`, `[N, D]`, with the derivative of Σ ‖next − target‖² with respect to the actions; `targets` are `[N, Z]`.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn step_toward(
        &mut self,
        latents: &[f32],
        actions: &[f32],
        targets: &[f32],
        next: &mut [f32],
        gradient: &mut [f32],
    ) -> Result<(), BaselineError>;

    /// Fills `states`, `[B, S, H, Z]`, with the latents that follow the prepared observations under candidates, `[B, S, H, D]`.
    ///
    /// # Errors
    ///
    /// The candidates are not for the prepared problems, or `states` is of another length.
    fn rollout(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), BaselineError>;

    /// Once per plan: takes the planning batch of B problems.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn prepare(&mut self, batch: &PlanningBatch<'_>) -> Result<(), BaselineError>;

    /// Fills the costs of `outputs`: how far the predicted end of each candidate, `[B, S, H, D]`, is from the goal, or what
    /// [`PlanModel::set_aggregate`] asks for; and the gradient, where it is requested. It has no constraints.
    ///
    /// # Errors
    ///
    /// The network fails.
    fn evaluate(
        &mut self,
        candidates: &Candidates<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), BaselineError>;
}

/// A goal-conditioned policy at work.
pub trait GoalPolicy: Send {
    /// D = F × A: values of a decision, scaled as the model's actions.
    fn block_dim(&self) -> usize;

    /// N: how many observations it can make use of.
    fn history(&self) -> usize;

    /// K: decisions to the farthest goals of a policy that takes how many are left; 0 of others.
    fn horizon(&self) -> usize {
        0
    }

    /// Fills `actions`, `[B, D]`, with the mean action of each of B problems, where `left`, `[B]`, decisions are left to reach each goal,
    /// 1 to K, this one included. A policy without a horizon ignores `left`.
    ///
    /// # Errors
    ///
    /// The network fails, or sizes differ.
    fn act_within(
        &mut self,
        batch: &PlanningBatch<'_>,
        left: &[usize],
        actions: &mut [f32],
    ) -> Result<(), BaselineError>;

    /// As [`GoalPolicy::act_within`], with all K decisions left.
    ///
    /// # Errors
    ///
    /// As of [`GoalPolicy::act_within`].
    fn act(&mut self, batch: &PlanningBatch<'_>, actions: &mut [f32]) -> Result<(), BaselineError> {
        let left = vec![self.horizon(); batch.pixels.rows];
        self.act_within(batch, &left, actions)
    }
}

/// A model at work that draws images of any look in one canonical look.
pub trait Canonicalizer: Send + Sync {
    /// The side of the images that it draws.
    fn side(&self) -> usize;

    /// Draws `[N, S, S, 3]`: the images in the canonical look, each beside another one of the same look, episode and step or not: what
    /// moved between the two is no part of the background. The bits of these N depend on nothing else.
    ///
    /// # Errors
    ///
    /// Images that are not square, or not equally many.
    fn draw(&self, images: &Images<'_>, others: &Images<'_>) -> Result<Vec<u8>, BaselineError>;

    /// Another one with the same weights.
    fn share(&self) -> Box<dyn Canonicalizer>;
}

/// A goal-conditioned policy over latents of a world model.
pub trait LatentPolicy: Send {
    /// Z: values of a latent.
    fn latent_dim(&self) -> usize;

    /// D = F × A: values of a decision, scaled as the model's actions.
    fn block_dim(&self) -> usize;

    /// K: decisions to the farthest goals.
    fn horizon(&self) -> usize;

    /// Fills `actions`, `[B, D]`, with what leads from each of `latents`, `[B, Z]`, to its goal in `goals`, `[B, Z]`, within `left`,
    /// `[B]`, decisions, 1 to K, this one included.
    ///
    /// # Errors
    ///
    /// The slices are of other lengths.
    fn act(
        &mut self,
        latents: &[f32],
        goals: &[f32],
        left: &[usize],
        actions: &mut [f32],
    ) -> Result<(), BaselineError>;
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

/// The input of a model: settings of the loader.
#[derive(Clone, Debug, PartialEq)]
pub struct InputSpec {
    /// T: steps of a clip.
    pub num_steps: usize,
    /// F: dataset steps between two steps of a clip, and actions per step of a clip.
    pub frameskip: usize,
    /// The side of images. Others are resized; it is cheaper to let the loader do that.
    pub image: usize,
    /// Whether `proprio` is used.
    pub proprio: bool,
    /// Clips of a batch, of the preset.
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
    /// Target networks, updated after each step: the name of the online network, and that of its target.
    pub(crate) targets: &'static [(&'static str, &'static str)],
    /// EMA decay of the target networks.
    pub(crate) momentum: f64,
}

impl Phase {
    /// The only phase of a training without goals and target networks.
    pub(crate) fn only(optim: &OptimConfig, trains: &'static [&'static str]) -> Self {
        Self { name: "train", optim: optim.clone(), goals: None, trains, targets: &[], momentum: 0.0 }
    }
}

/// Which goals clips get: see [`swm_data::loader::GoalOptions`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseGoals {
    /// Weights of the kinds.
    pub weights: GoalWeights,
    /// The discount of geometric goals.
    pub gamma: f64,
    /// Which step of the clip is the current one, counted from 1.
    pub offset: usize,
}

/// The losses of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Losses {
    /// What is minimized.
    pub total: f32,
    /// Its parts, before they are weighed, and other metrics: `lr`, `gradient_norm`.
    pub parts: Vec<(&'static str, f32)>,
}

/// What makes a model again, except its weights: the JSON of every run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Its line in [`crate::BASELINES`].
    pub baseline: String,
    /// The preset that the settings began with.
    pub preset: String,
    /// All settings.
    pub settings: Json,
    /// Dimensions of the data that it was made for.
    #[serde(alias = "facts")]
    pub dims: DataDims,
    /// The seed of its first weights.
    pub seed: u64,
}
