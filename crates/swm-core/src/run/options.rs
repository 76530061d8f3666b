//! How a world is built, and the limits of that.

use crate::env::{EnvConfig, ImageSize};
use crate::error::WorldError;

/// How a [`World`](crate::World) is built.
///
/// ```
/// use swm_core::WorldOptions;
///
/// let options = WorldOptions::new(8).max_episode_steps(200).image(64, 64).threads(2);
/// assert_eq!((options.num_envs, options.max_episode_steps, options.threads), (8, Some(200), Some(2)));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
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
    /// Fields that datasets do without, by name: `goal`, say, an image per step. They stay in the infos.
    pub unrecorded: Vec<String>,
    /// Save the environments' states every so many steps, in the field `checkpoint`: then images need not be recorded,
    /// since they can be rendered from any step on. `None`: do not.
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
    /// This many environments, and else the defaults.
    pub fn new(num_envs: usize) -> Self {
        Self { num_envs, ..Self::default() }
    }

    /// Sets image size and environment settings together.
    #[must_use]
    pub fn env(mut self, env: EnvConfig) -> Self {
        self.env = env;
        self
    }

    /// Renders images of this size.
    #[must_use]
    pub fn image(mut self, height: usize, width: usize) -> Self {
        self.env.image = Some(ImageSize { height, width });
        self
    }

    /// Sets one setting of the environment.
    #[must_use]
    pub fn setting(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.env.settings.insert(name.to_owned(), value.into());
        self
    }

    /// Truncates episodes after this many steps; `None`: never.
    #[must_use]
    pub fn max_episode_steps(mut self, limit: impl Into<Option<u64>>) -> Self {
        self.max_episode_steps = limit.into();
        self
    }

    /// Applies each action this many times.
    #[must_use]
    pub fn frame_skip(mut self, times: u32) -> Self {
        self.frame_skip = times;
        self
    }

    /// Steps on this many threads; `None`: one per core. With 1, everything happens on the caller's thread.
    #[must_use]
    pub fn threads(mut self, threads: impl Into<Option<usize>>) -> Self {
        self.threads = threads.into();
        self
    }

    /// Leaves these fields out of datasets.
    #[must_use]
    pub fn unrecorded<S: Into<String>>(mut self, names: impl IntoIterator<Item = S>) -> Self {
        self.unrecorded = names.into_iter().map(Into::into).collect();
        self
    }

    /// Saves the environments' states every so many steps; `None`: never.
    #[must_use]
    pub fn checkpoints(mut self, every: impl Into<Option<u32>>) -> Self {
        self.checkpoints = every.into();
        self
    }

    /// Refuses what is out of range, before anything is made.
    pub(crate) fn check(&self) -> Result<(), WorldError> {
        let wrong = |option, reason: String| Err(WorldError::Option { option, reason });
        if !(1..=MAX_ENVS).contains(&self.num_envs) {
            return wrong("num_envs", format!("{} is not in 1 to {MAX_ENVS}", self.num_envs));
        }
        if !(1..=MAX_FRAME_SKIP).contains(&self.frame_skip) {
            return wrong("frame_skip", format!("{} is not in 1 to {MAX_FRAME_SKIP}", self.frame_skip));
        }
        if let Some(every) = self.checkpoints
            && !(1..=MAX_CHECKPOINT_STEPS).contains(&every)
        {
            return wrong(
                "checkpoints",
                format!("every {every} steps is not in 1 to {MAX_CHECKPOINT_STEPS}"),
            );
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
const MAX_CHECKPOINT_STEPS: u32 = 1_000_000;
/// All images of the infos together: 4 GB.
const MAX_FRAME_BYTES: usize = 4_000_000_000;
