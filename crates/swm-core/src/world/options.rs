//! How a world is built, and the limits of that.

use crate::env::{EnvConfig, ImageSize};
use crate::error::WorldError;

/// How a [`World`](super::World) is built.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldOptions {
    /// Environments stepped side by side. Results do not depend on it.
    pub num_envs: usize,
    /// Image size and environment settings.
    pub env: EnvConfig,
    /// Steps after which an episode is truncated; `None`: never.
    pub max_episode_steps: Option<u64>,
    /// How often each action is applied per step.
    pub frame_skip: u32,
    /// Threads; `None`: one per core. Results do not depend on it.
    pub threads: Option<usize>,
    /// Fields that datasets do without, by name: `goal`, say, an image per row. They stay in the infos.
    pub unrecorded: Vec<String>,
    /// Save the environments' states every so many rows, in the field `checkpoint`: then images need not be recorded,
    /// since they can be drawn from any row on. `None`: do not.
    pub checkpoints: Option<u32>,
}

impl Default for WorldOptions {
    /// One environment, no images, 100 steps (the reference's default), every thread.
    fn default() -> Self {
        Self {
            num_envs: 1,
            env: EnvConfig::default(),
            max_episode_steps: Some(100),
            frame_skip: 1,
            threads: None,
            unrecorded: Vec::new(),
            checkpoints: None,
        }
    }
}

impl WorldOptions {
    /// Refuses what is out of range, before anything is made.
    pub(super) fn check(&self) -> Result<(), WorldError> {
        let wrong = |option, reason: String| Err(WorldError::Option { option, reason });
        if !(1..=MAX_ENVS).contains(&self.num_envs) {
            return wrong("num_envs", format!("{} is not in 1 to {MAX_ENVS}", self.num_envs));
        }
        if !(1..=MAX_FRAME_SKIP).contains(&self.frame_skip) {
            return wrong("frame_skip", format!("{} is not in 1 to {MAX_FRAME_SKIP}", self.frame_skip));
        }
        if let Some(every) = self.checkpoints
            && !(1..=MAX_CHECKPOINT_ROWS).contains(&every)
        {
            return wrong("checkpoints", format!("every {every} rows is not in 1 to {MAX_CHECKPOINT_ROWS}"));
        }
        if self.max_episode_steps == Some(0) {
            return wrong("max_episode_steps", "0 steps; use 1 or more, or none".to_owned());
        }
        if let Some(ImageSize { height, width }) = self.env.image
            && let Err(reason) = ImageSize::new(height, width)
        {
            return wrong("image", reason);
        }
        let frame_bytes = self.env.image.map_or(0, |image| image.shape().iter().product::<usize>());
        if frame_bytes * self.num_envs > MAX_FRAME_BYTES {
            let gigabytes = (frame_bytes * self.num_envs) as f64 / 1e9;
            let reason = format!(
                "{} images of this size take {gigabytes:.0} GB; use fewer environments or smaller images",
                self.num_envs
            );
            return wrong("image", reason);
        }
        if let Some(threads) = self.threads
            && !(1..=MAX_THREADS).contains(&threads)
        {
            return wrong("threads", format!("{threads} is not in 1 to {MAX_THREADS}"));
        }
        Ok(())
    }
}

/// Steps of the environment per action; more are a typing error, or damage where they are read.
pub const MAX_FRAME_SKIP: u32 = 1000;
// More than these in one process are typing errors.
const MAX_ENVS: usize = 65_536;
const MAX_THREADS: usize = 1024;
const MAX_CHECKPOINT_ROWS: u32 = 1_000_000;
/// All images of the infos together: 4 GB.
const MAX_FRAME_BYTES: usize = 4_000_000_000;
