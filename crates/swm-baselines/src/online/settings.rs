//! How an agent collects and how long it learns: what does not depend on the agent.

use serde::{Deserialize, Serialize};

use crate::error::BaselineError;

/// How an agent collects: part of its presets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CollectConfig {
    /// Environments that collect side by side. Each begins its episode when all are over.
    pub num_envs: usize,
    /// Steps at the beginning with uniformly random actions, from which nothing is learned yet.
    pub random_steps: u64,
    /// Updates per step of an environment.
    pub updates_per_step: f64,
    /// Steps that the replay buffer holds; the oldest episodes leave.
    pub capacity: usize,
    /// Steps after which an episode that is collected is truncated, if that is before [`OnlineSettings::max_episode_steps`]: more
    /// starts and goals for as many steps. Evaluations have whole episodes.
    pub max_episode_steps: Option<u64>,
}

impl Default for CollectConfig {
    /// One environment, 1,000 random steps, an update per step, a million steps in the buffer.
    fn default() -> Self {
        Self {
            num_envs: 1,
            random_steps: 1_000,
            updates_per_step: 1.0,
            capacity: 1_000_000,
            max_episode_steps: None,
        }
    }
}

impl CollectConfig {
    /// What is wrong with it, if anything is.
    pub(crate) fn check(&self) -> Result<(), String> {
        let Self { num_envs, random_steps: _, updates_per_step, capacity, max_episode_steps } = *self;
        if num_envs == 0 || capacity == 0 {
            return Err("`collect.num_envs` and `collect.capacity` must be at least 1".to_owned());
        }
        if max_episode_steps == Some(0) {
            return Err("`collect.max_episode_steps` must be at least 1".to_owned());
        }
        match updates_per_step > 0.0 && updates_per_step <= MOST_UPDATES {
            true => Ok(()),
            false => Err(format!(
                "`collect.updates_per_step` is {updates_per_step}; it must be above 0 and at most {MOST_UPDATES}"
            )),
        }
    }

    /// Steps after which an episode that is collected is truncated.
    pub(crate) fn episode_steps(&self, fit: &OnlineSettings) -> u64 {
        self.max_episode_steps.unwrap_or(u64::MAX).min(fit.max_episode_steps)
    }

    /// Updates that are due once `step` steps have been taken.
    pub(crate) fn updates_at(&self, step: u64) -> u64 {
        (step.saturating_sub(self.random_steps) as f64 * self.updates_per_step) as u64
    }
}

/// More are a typing error.
const MOST_UPDATES: f64 = 1000.0;

/// How long an agent learns, and how often it is looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OnlineSettings {
    /// Steps of the environment, over all of those that collect.
    pub steps: u64,
    /// Seed of everything: episodes, weights, noise.
    pub seed: u64,
    /// Steps after which an episode is truncated.
    pub max_episode_steps: u64,
    /// Steps from one record to the next.
    pub log_every: u64,
    /// Steps from one evaluation and checkpoint to the next.
    pub eval_every: u64,
    /// Episodes of an evaluation, always the same ones, none of which is learned from.
    pub eval_episodes: u64,
    /// Checkpoints that are kept; the best one is kept besides.
    pub keep: usize,
}

impl Default for OnlineSettings {
    /// 100,000 steps in episodes of 500, a record every 500 steps, an evaluation of 5 episodes every 5,000.
    fn default() -> Self {
        Self {
            steps: 100_000,
            seed: 42,
            max_episode_steps: 500,
            log_every: 500,
            eval_every: 5_000,
            eval_episodes: 5,
            keep: 3,
        }
    }
}

impl OnlineSettings {
    /// Refuses what cannot be learned with.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Training`], which names the setting.
    pub fn check(&self) -> Result<(), BaselineError> {
        let Self { steps, seed: _, max_episode_steps, log_every, eval_every, eval_episodes, keep } = *self;
        let all = [
            ("steps", steps),
            ("max_episode_steps", max_episode_steps),
            ("log_every", log_every),
            ("eval_every", eval_every),
            ("eval_episodes", eval_episodes),
            ("keep", keep as u64),
        ];
        match all.iter().find(|(_, value)| *value == 0) {
            Some((setting, _)) => Err(BaselineError::Training {
                setting: (*setting).to_owned(),
                reason: "0; use 1 or more".to_owned(),
            }),
            None => Ok(()),
        }
    }
}
