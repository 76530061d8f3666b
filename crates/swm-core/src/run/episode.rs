//! One episode of a run: where it stands, and how it ended.

use serde::{Deserialize, Serialize};

use crate::seed::EpisodeSeed;

/// The episode that an environment is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct LiveEpisode {
    /// Its index in the run.
    pub index: u64,
    /// Its seed.
    pub seed: EpisodeSeed,
    /// Steps taken so far: 0 at the first action.
    pub step: u64,
}

impl LiveEpisode {
    /// Episode `index` of the run with seed `run_seed`, at its start.
    pub fn of(run_seed: u64, index: u64) -> Self {
        Self { index, seed: EpisodeSeed::of(run_seed, index), step: 0 }
    }
}

/// How an episode went.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct EpisodeEnd {
    /// Its index in the run.
    pub index: u64,
    /// Its seed.
    pub seed: EpisodeSeed,
    /// Actions taken; the episode has one step more, which has no action.
    pub steps: u64,
    /// Sum of rewards.
    pub total_reward: f64,
    /// Whether the goal was reached at any step; `None` where the task has no success.
    pub success: Option<bool>,
    /// Whether it was reached before the first action.
    pub success_at_start: Option<bool>,
    /// The first step at which it was reached (0: at the start).
    pub first_success_step: Option<u64>,
    /// Under a [`Judge`](crate::success::Judge): how near the goal was.
    pub margins: Option<Margins>,
    /// The task ended it.
    pub terminated: bool,
    /// The time limit ended it.
    pub truncated: bool,
}

/// How near a goal was, as a part of what is allowed: below 1 is reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Margins {
    /// At its nearest.
    pub best: f64,
    /// At the end.
    pub last: f64,
}
