//! What can be set about planning on the true simulator.

use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;

use crate::descent::positive;
use crate::error::PlanError;
use crate::settings::Settings;
use crate::solver::at_least_one;

/// What of a roll-out counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aggregate {
    /// The task cost at the end.
    #[default]
    Last,
    /// The mean over all steps: rewards being near the goal early.
    Mean,
    /// The lowest of all steps.
    Best,
}

/// Settings of [`crate::SimulatorCost`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulatorOptions {
    /// What of a roll-out counts.
    pub aggregate: Aggregate,
    /// A roll-out that succeeds at its step t (1 is the first) ends there and costs t minus this: where task costs are
    /// not negative, 1000 lets any success beat any failure, and an early one a late one. 0: success has no part in
    /// the cost. Gradients leave it out: it is a cliff.
    pub success_bonus: f64,
    /// Whether a roll-out ends where the environment says that its task is done. If not, success has no part in the cost
    /// (no bonus either), and roll-outs go on: for tasks that are judged by another test than the environment's own. An
    /// end without success, such as a fall, stays an end.
    pub stop_at_success: bool,
    /// How far an action is moved, back and forth, to find the slope of the cost. Integer actions have none: there the
    /// cost of every other category is compared.
    pub gradient_step: f64,
    /// Environment steps per action: the `frame_skip` of the world that is planned for.
    pub frame_skip: u32,
}

impl SimulatorOptions {
    /// Whether success lowers the cost.
    pub(super) fn gives_bonus(&self) -> bool {
        self.stop_at_success && self.success_bonus > 0.0
    }
}

impl Default for SimulatorOptions {
    fn default() -> Self {
        Self {
            aggregate: Aggregate::Last,
            success_bonus: 1000.0,
            stop_at_success: true,
            gradient_step: 0.01,
            frame_skip: 1,
        }
    }
}

impl Settings for SimulatorOptions {
    const SETTINGS: &'static [Setting] = &[
        Setting {
            name: "aggregate",
            doc: "what of a roll-out counts: last, mean or best task cost",
            default: "last",
        },
        Setting {
            name: "success_bonus",
            doc: "success at step t of a roll-out costs t minus this; 0: no bonus",
            default: "1000",
        },
        Setting {
            name: "stop_at_success",
            doc: "end roll-outs at the environment's own success; false: roll on, without a bonus",
            default: "true",
        },
        Setting {
            name: "gradient_step",
            doc: "how far actions are moved to find slopes, for solvers that need them",
            default: "0.01",
        },
        Setting {
            name: "frame_skip",
            doc: "environment steps per action; the world's unless given",
            default: "1",
        },
    ];

    fn validate(&self) -> Result<(), PlanError> {
        if !(self.success_bonus.is_finite() && self.success_bonus >= 0.0) {
            let reason = format!("{} is not a number from 0 on", self.success_bonus);
            return Err(PlanError::setting("success_bonus", reason));
        }
        positive("gradient_step", self.gradient_step)?;
        at_least_one("frame_skip", self.frame_skip as usize)
    }
}
