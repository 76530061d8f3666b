//! How long plans are and how much of each is carried out.

use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;

use super::report::Report;
use crate::error::PlanError;
use crate::settings::Settings;
use crate::solver::at_least_one;

/// Settings of [`crate::MpcPolicy`]; names and meanings are the reference's `PlanConfig`.
///
/// The reference requires `horizon` and `receding_horizon` and defaults `action_block` to 1; its published runs use
/// 5 blocks of 5 actions, all carried out, with one frame of history. That set is the default here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanConfig {
    /// H: blocks per plan; a plan spans H × `action_block` environment steps.
    pub horizon: usize,
    /// R: blocks of each plan that are carried out before the next is made.
    pub receding_horizon: usize,
    /// Frames that the cost is shown, the present one included, `action_block` steps apart.
    pub history_len: usize,
    /// k: consecutive, different actions per block.
    pub action_block: usize,
    /// Whether a plan begins with what is left of the last one (its H - R last blocks); the rest is zeros.
    pub warm_start: bool,
    /// Whether actions are clipped to the action space. The reference does not.
    pub clip_actions: bool,
    /// What of its plans the policy writes into the infos.
    pub report: Report,
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            horizon: 5,
            receding_horizon: 5,
            history_len: 1,
            action_block: 5,
            warm_start: true,
            clip_actions: true,
            report: Report::Off,
        }
    }
}

/// Longer horizons, blocks or histories are typing errors.
const MAX_LENGTH: usize = 100_000;

impl Settings for PlanConfig {
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "horizon", doc: "blocks per plan", default: "5" },
        Setting {
            name: "receding_horizon",
            doc: "blocks carried out before planning again (at most horizon)",
            default: "5",
        },
        Setting { name: "history_len", doc: "frames that a model is shown", default: "1" },
        Setting { name: "action_block", doc: "consecutive actions per block", default: "5" },
        Setting { name: "warm_start", doc: "begin with what is left of the last plan", default: "true" },
        Setting { name: "clip_actions", doc: "clip actions to the action space", default: "true" },
        Setting { name: "report", doc: "columns about the plans: off, plan, or timed", default: "off" },
    ];

    fn validate(&self) -> Result<(), PlanError> {
        for (name, value) in [
            ("horizon", self.horizon),
            ("receding_horizon", self.receding_horizon),
            ("history_len", self.history_len),
            ("action_block", self.action_block),
        ] {
            at_least_one(name, value)?;
            if value > MAX_LENGTH {
                return Err(PlanError::setting(name, format!("{value} is more than {MAX_LENGTH}")));
            }
        }
        if self.receding_horizon > self.horizon {
            let reason = format!(
                "{} blocks of a plan of {} cannot be carried out; lower it or raise horizon",
                self.receding_horizon, self.horizon
            );
            return Err(PlanError::setting("receding_horizon", reason));
        }
        Ok(())
    }
}
