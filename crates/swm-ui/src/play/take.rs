//! An episode that was played, as what repeats it: for recordings and for videos.

use std::sync::Arc;

use serde::Serialize;
use swm_core::env::PIXELS;
use swm_core::error::BoxError;
use swm_core::view::Transform;
use swm_core::{
    Column, EnvConfig, EnvEntry, EpisodeEnd, EpisodeSeed, ImageSize, LiveStep, Recorder, ResetOptions,
    Rollout, RunInfo, SuccessRule, World, WorldOptions, policy,
};
use swm_media::{Clip, Format};
use swm_tasks::request::TaskError;

use crate::data::{MAX_VIDEO, encode};

/// An episode that was played: everything that repeats it.
#[derive(Clone)]
pub(super) struct Take {
    pub entry: &'static EnvEntry,
    pub config: EnvConfig,
    /// Steps after which it is truncated.
    pub limit: Option<u64>,
    pub frame_skip: u32,
    /// The manifest's test; else that of the environment.
    pub success: SuccessRule,
    /// What changed the images.
    pub transform: Option<Arc<dyn Transform>>,
    pub run_seed: u64,
    pub seed: EpisodeSeed,
    pub options: ResetOptions,
    /// Of every step, `[A]` each.
    pub actions: Vec<Column>,
    /// Who acted.
    pub actors: String,
    pub end: Ending,
}

/// How an episode went, for the page and for the comparison with its repetition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Ending {
    pub steps: u64,
    pub success: Option<bool>,
    pub total_reward: f64,
}

impl From<&EpisodeEnd> for Ending {
    fn from(end: &EpisodeEnd) -> Self {
        Self { steps: end.steps, success: end.success, total_reward: end.total_reward }
    }
}

impl Take {
    /// Runs the episode again before a recorder, as episode `number` of its run.
    ///
    /// # Errors
    ///
    /// What the recorder meets; an environment that does not repeat what it did.
    pub(super) fn repeat(
        &self,
        number: u64,
        image: ImageSize,
        transform: Option<Arc<dyn Transform>>,
        recorder: &mut dyn Recorder,
    ) -> Result<(), TaskError> {
        let config = EnvConfig { image: Some(image), ..self.config.clone() };
        let options = WorldOptions::new(1)
            .env(config)
            .max_episode_steps(self.limit)
            .frame_skip(self.frame_skip)
            .threads(1);
        let mut world = World::new(self.entry, options)?;
        world.set_success(&self.success)?;
        world.set_transform(transform);
        world.set_policy(policy::scripted(self.actors.clone(), |_, _| Ok(())))?;
        let options = ResetOptions { seed: Some(self.seed), ..self.options.clone() };
        let rollout = Rollout::new(number..number + 1).seed(self.run_seed).options(options);
        let mut end = End::default();
        let mut watch = (recorder, &mut end);
        let mut run = world.begin(&rollout, &mut watch)?;
        for action in &self.actions {
            if run.needs_actions().is_none() {
                break;
            }
            run.set_actions(action.as_slice())?;
            run.advance()?;
        }
        match end.0 {
            Some(end) if end.steps == self.end.steps && end.success == self.end.success => Ok(()),
            end => Err(format!(
                "the episode was not repeated as it was played ({end:?}, not {:?}); the environment is not deterministic",
                self.end
            )
            .into()),
        }
    }

    /// The episode as a video: MP4, or GIF where the program was built without MP4.
    ///
    /// # Errors
    ///
    /// As [`Take::repeat`]; more frames than fit into memory.
    pub(super) fn video(&self, image: ImageSize) -> Result<(Format, Vec<u8>), TaskError> {
        if (self.actions.len() + 1) * image.height * image.width * 3 > MAX_VIDEO {
            return Err(format!(
                "the video has more than {} MB of frames; show smaller images, or a shorter episode",
                MAX_VIDEO >> 20
            )
            .into());
        }
        let mut frames = Frames(Clip::new(image.height, image.width, 10.0));
        self.repeat(0, image, self.transform.clone(), &mut frames)?;
        Ok(encode(&frames.0)?)
    }
}

/// How the repetition ended.
#[derive(Default)]
struct End(Option<Ending>);

impl Recorder for End {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.0 = Some(end.into());
        Ok(())
    }
}

/// Collects images.
struct Frames(Clip);

impl Recorder for Frames {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        let (height, width) = (self.0.height(), self.0.width());
        // In real time, as videos of `swm collect --videos` are.
        let step_s = run.spec.time_step_s * f64::from(run.options.frame_skip);
        self.0 = Clip::new(height, width, (1.0 / step_s).clamp(5.0, 30.0));
        Ok(())
    }

    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(self.0.push(row.values.get::<u8>(PIXELS)?)?)
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}
