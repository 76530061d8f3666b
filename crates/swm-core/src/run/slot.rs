//! One environment of a `World` and the episode it is in: what a view of a policy borrows.

use serde::{Deserialize, Serialize};

use super::{EpisodeEnd, LiveEpisode, Margins};
use crate::env::{Env, EnvState};
use crate::view::Scratch;

/// An environment and where it is in the run.
pub(crate) struct Slot {
    pub(crate) env: Box<dyn Env>,
    /// The episode to begin at the next reset phase.
    pub(crate) next: Option<LiveEpisode>,
    pub(crate) progress: Option<Progress>,
    /// The episode's goal image was given, and is not the environment's.
    pub(crate) goal_image_is_given: bool,
    /// The last checkpoint.
    pub(crate) saved: EnvState,
    pub(crate) scratch: Scratch,
}

impl Slot {
    pub(crate) fn new(env: Box<dyn Env>) -> Self {
        let (saved, scratch) = (EnvState::new(), Scratch::default());
        Self { env, next: None, progress: None, goal_image_is_given: false, saved, scratch }
    }

    pub(crate) fn env(&self) -> &dyn Env {
        self.env.as_ref()
    }

    /// The episode that needs an action, if any.
    pub(crate) fn live_episode(&self) -> Option<LiveEpisode> {
        self.progress.as_ref().filter(|progress| !progress.is_over()).map(|progress| progress.episode)
    }

    pub(crate) fn is_live(&self) -> bool {
        self.live_episode().is_some()
    }

    /// The finished episode, if it has not been collected yet.
    pub(crate) fn finished(&self) -> Option<&Progress> {
        self.progress.as_ref().filter(|progress| progress.is_over())
    }
}

/// What is known of a running episode.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Progress {
    pub episode: LiveEpisode,
    pub total_reward: f64,
    pub success_at_start: Option<bool>,
    pub first_success_step: Option<u64>,
    pub success_now: Option<bool>,
    pub terminated: bool,
    pub truncated: bool,
    /// Under a judge: how near the goal was, and in how many steps on end it was reached.
    pub margins: Option<Margins>,
    pub streak: u64,
}

impl Progress {
    /// An episode just begun, with the success that its environment reported.
    pub(crate) fn start(episode: LiveEpisode, success: Option<bool>) -> Self {
        Self {
            episode,
            total_reward: 0.0,
            success_at_start: success,
            first_success_step: success.unwrap_or(false).then_some(0),
            success_now: success,
            terminated: false,
            truncated: false,
            margins: None,
            streak: 0,
        }
    }

    fn is_over(&self) -> bool {
        self.terminated || self.truncated
    }

    /// The episode so far.
    pub(crate) fn summary(&self) -> EpisodeEnd {
        EpisodeEnd {
            index: self.episode.index,
            seed: self.episode.seed,
            steps: self.episode.step,
            total_reward: self.total_reward,
            success: self.success_now.map(|_| self.first_success_step.is_some()),
            success_at_start: self.success_at_start,
            first_success_step: self.first_success_step,
            margins: self.margins,
            terminated: self.terminated,
            truncated: self.truncated,
        }
    }
}
