//! SAC's settings, and those that the reference has for each domain of the DeepMind Control Suite.

use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use super::NAME;
use crate::error::BaselineError;
use crate::models::settings::with_changes;
use crate::online::agent::Task;
use crate::online::settings::CollectConfig;

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SacConfig {
    /// Hidden dims of policy and critics.
    pub hidden: [usize; 2],
    /// The learning rate of Adam, for policy, critics and temperature.
    pub lr: f64,
    /// Discount per step.
    pub discount: f64,
    /// Share of the critics that their target networks take over per update.
    pub tau: f64,
    /// Transitions of an update.
    pub batch: usize,
    /// Entropy that the temperature is adapted to, per value of an action.
    pub entropy_per_action: f64,
    /// How it collects.
    pub collect: CollectConfig,
}

impl SacConfig {
    /// The reference's: defaults of Stable-Baselines3 with four environments, one update for every step of all four.
    pub fn paper() -> Self {
        Self {
            hidden: [256, 256],
            lr: 3e-4,
            discount: 0.99,
            tau: 0.005,
            batch: 256,
            entropy_per_action: -1.0,
            collect: CollectConfig {
                num_envs: 4,
                random_steps: 10_000,
                updates_per_step: 0.25,
                ..CollectConfig::default()
            },
        }
    }

    /// For few steps on a CPU: one environment, an update per step, a tenth of the random steps, a larger learning rate.
    pub fn small() -> Self {
        Self { lr: 1e-3, collect: CollectConfig::default(), ..Self::paper() }
    }

    /// The settings of a stored run, checked.
    pub(super) fn parse(settings: &Json) -> Result<Self, BaselineError> {
        let wrong = |reason| BaselineError::Settings { baseline: NAME, reason };
        let config = Self::deserialize(settings).map_err(|error| wrong(error.to_string()))?;
        config.check().map_err(wrong)?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        let Self { hidden, lr, discount, tau, batch, entropy_per_action, collect } = self;
        if hidden.contains(&0) || *batch == 0 {
            return Err("`hidden` and `batch` must be at least 1".to_owned());
        }
        if !(*lr > 0.0 && lr.is_finite()) {
            return Err(format!("`lr` is {lr}; it must be above 0"));
        }
        for (name, value) in [("discount", *discount), ("tau", *tau)] {
            if !(0.0..=1.0).contains(&value) {
                return Err(format!("`{name}` is {value}; it must be in [0, 1]"));
            }
        }
        if !entropy_per_action.is_finite() {
            return Err(format!("`entropy_per_action` is {entropy_per_action}; it must be finite"));
        }
        collect.check()
    }

    /// The entropy that the temperature is adapted to, for actions of so many values.
    pub(super) fn target_entropy(&self, action_dim: usize) -> f32 {
        (self.entropy_per_action * action_dim as f64) as f32
    }
}

/// The reference's settings that differ from its defaults in an environment. Updates are per step of one of four environments.
/// Source: `scripts/expert/sac_online.py` of the reference, August 2026.
fn of_domain(env: &str) -> Json {
    let half = json!({ "updates_per_step": 0.5 });
    let late = json!({ "updates_per_step": 0.5, "random_steps": 25_000 });
    match env {
        "swm/HopperDMControl-v0" => json!({ "batch": 1024, "collect": half }),
        "swm/HumanoidDMControl-v0" => json!({ "batch": 1024, "hidden": [1024, 1024], "collect": late }),
        "swm/PendulumDMControl-v0" => json!({ "batch": 1024, "hidden": [400, 300], "collect": late }),
        "swm/QuadrupedDMControl-v0" => json!({ "batch": 1024, "hidden": [400, 300] }),
        "swm/ReacherDMControl-v0" => json!({ "collect": { "random_steps": 5_000 } }),
        "swm/WalkerDMControl-v0" => json!({ "batch": 1024, "hidden": [400, 300], "collect": half }),
        _ => Json::Null,
    }
}

/// All settings: the preset's, those of the environment's domain where the preset is the reference's, and changes.
pub(in crate::online) fn settings(
    preset: &str,
    task: &Task<'_>,
    changes: &Json,
) -> Result<Json, BaselineError> {
    let config = match preset {
        "small" => SacConfig::small(),
        _ => with_changes(NAME, &SacConfig::paper(), &of_domain(task.env))?,
    };
    let config = with_changes(NAME, &config, changes)?;
    config.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    serde_json::to_value(config)
        .map_err(|error| BaselineError::Settings { baseline: NAME, reason: error.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn of(env: &str) -> Task<'_> {
        Task::online(env, 500)
    }

    #[test]
    fn domains_have_the_references_settings() {
        let paper = |env: &str| SacConfig::parse(&settings("paper", &of(env), &Json::Null).unwrap()).unwrap();
        assert_eq!(paper("swm/CheetahDMControl-v0"), SacConfig::paper());
        let walker = paper("swm/WalkerDMControl-v0");
        assert_eq!((walker.batch, walker.hidden, walker.collect.updates_per_step), (1024, [400, 300], 0.5));
        assert_eq!(paper("swm/ReacherDMControl-v0").collect.random_steps, 5_000);
        let small = settings("small", &of("swm/WalkerDMControl-v0"), &Json::Null).unwrap();
        assert_eq!(SacConfig::parse(&small).unwrap(), SacConfig::small());
    }

    #[test]
    fn wrong_settings_are_refused_by_name() {
        for (changes, reason) in [
            (json!({ "lr": 0.0 }), "`lr` is 0"),
            (json!({ "tau": 2.0 }), "`tau` is 2"),
            (json!({ "hidden": [256, 0] }), "`hidden`"),
            (json!({ "collect": { "updates_per_step": -1.0 } }), "`collect.updates_per_step` is -1"),
            (json!({ "collect": { "max_episode_steps": 0 } }), "`collect.max_episode_steps`"),
            (json!({ "collect": { "num_env": 3 } }), "did you mean `collect.num_envs`?"),
        ] {
            let message = settings("small", &of("x"), &changes).unwrap_err().to_string();
            assert!(message.starts_with("settings of `sac`: ") && message.contains(reason), "{message}");
        }
    }
}
