//! What learns online, on slices of values: no tensors, no environment.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_core::LiveEpisode;

use super::settings::CollectConfig;
use crate::baseline::Losses;
use crate::error::BaselineError;
use crate::images::Images;

/// An agent: acts on observations, and learns from clips of what came of it.
///
/// Learning is a function of settings, seed and batches: the noise of an update is keyed by the seed and its index, that of an
/// action by the episode and its step. So an agent that is saved and resumed gives the bits of one that never stopped.
pub trait OnlineAgent: Send {
    /// What makes it again, except its weights.
    fn config(&self) -> &AgentConfig;

    /// How it collects.
    fn collect(&self) -> &CollectConfig;

    /// T: steps of the clips that it learns from. The action of the last one is not used.
    fn clip_steps(&self) -> usize;

    /// B: clips of an update.
    fn batch(&self) -> usize;

    /// Number of trainable parameters.
    fn parameters(&self) -> usize;

    /// Takes the vectors of a collected episode, `[N, O]`, into the statistics that it normalizes with.
    fn observe(&mut self, observations: &[f32]);

    /// Writes the action, `[A]` in [-1, 1], for an observation in the environment of this slot: with the noise of exploration, or
    /// the one that it thinks best.
    ///
    /// # Errors
    ///
    /// The observation or the action has another form than the agent was made for.
    fn act(
        &mut self,
        slot: usize,
        episode: &LiveEpisode,
        explore: bool,
        observation: &Observation<'_>,
        action: &mut [f32],
    ) -> Result<(), BaselineError>;

    /// One update: losses, gradients, optimizers, target networks. `index` counts updates from 0.
    ///
    /// # Errors
    ///
    /// The clips have another form, or a loss or gradient is not finite.
    fn update(&mut self, clips: &Transitions<'_>, index: u64) -> Result<Losses, BaselineError>;

    /// Writes the weights, and the statistics of observations, as safetensors.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    fn save_weights(&self, path: &Path) -> Result<(), BaselineError>;

    /// Takes what [`OnlineAgent::save_weights`] wrote.
    ///
    /// # Errors
    ///
    /// The file cannot be read, lacks a weight or holds one of another shape.
    fn load_weights(&mut self, path: &Path) -> Result<(), BaselineError>;

    /// Writes what resuming needs in addition to the weights: the state of the optimizers.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    fn save_training(&self, path: &Path) -> Result<(), BaselineError>;

    /// Takes what [`OnlineAgent::save_training`] wrote.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or is of another agent.
    fn load_training(&mut self, path: &Path) -> Result<(), BaselineError>;
}

/// What an agent is made for: presets may depend on it.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The environment's id.
    pub env: &'a str,
    /// Steps after which an episode is truncated.
    pub max_episode_steps: u64,
    /// Whether it learns from a dataset.
    pub from_dataset: bool,
}

impl<'a> Task<'a> {
    /// Learning online.
    pub const fn online(env: &'a str, max_episode_steps: u64) -> Self {
        Self { env, max_episode_steps, from_dataset: false }
    }
}

/// What is observed at a step.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    /// `[O]`: the values of vectors.
    pub vector: &'a [f32],
    /// The image, one row of one step, where images are observed. Of another size than the agent's, it is resized.
    pub image: Option<Images<'a>>,
}

/// B clips of T consecutive steps.
#[derive(Clone, Copy, Debug)]
pub struct Transitions<'a> {
    /// B.
    pub rows: usize,
    /// T.
    pub steps: usize,
    /// `[B, T, O]`: vectors.
    pub observation: &'a [f32],
    /// B rows of T images, where images are observed.
    pub images: Option<Images<'a>>,
    /// `[B, T, A]`, in [-1, 1]: the actions taken from the observations.
    pub action: &'a [f32],
    /// `[B, T]`: the reward that came with each observation, of the action before it.
    pub reward: &'a [f32],
    /// `[B, T]`: 1 where the task ended with the observation, else 0. A time limit is no end.
    pub terminated: &'a [f32],
}

/// What makes an agent again, except its weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentConfig {
    /// Its line in [`super::AGENTS`].
    pub agent: String,
    /// The preset that the settings began with.
    pub preset: String,
    /// All settings.
    pub settings: Json,
    /// O: values of the vectors that it observes.
    pub observation_dim: usize,
    /// S: the side of the images that it observes; `None`: vectors alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<usize>,
    /// A: values of an action.
    pub action_dim: usize,
    /// The seed of its first weights and of its noise.
    pub seed: u64,
}
