//! What can be set about planning on the true simulator.

use serde::{Deserialize, Serialize};

use crate::descent::positive;
use crate::error::PlanError;
use crate::settings::Validate;
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

swm_core::settings! {
    /// Settings of [`crate::SimulatorCost`].
    pub struct SimulatorOptions {
        /// Cost of a rollout: last, mean or best task cost.
        aggregate: Aggregate = Aggregate::Last => "last",
        /// A rollout that succeeds at its step t costs t minus this; 0: no bonus.
        ///
        /// It ends there. Where task costs are not negative, 1000 lets any success beat any failure, and an early one a late
        /// one. Finite-difference gradients leave the bonus out: it is a discontinuity.
        success_bonus: f64 = 1000.0,
        /// End rollouts at the environment's own success; false: continue, without a bonus.
        ///
        /// For tasks that are judged by another test than the environment's own. An end without success, such as a fall,
        /// stays an end.
        stop_at_success: bool = true,
        /// Step of finite-difference gradients, for solvers that need them.
        ///
        /// For integer actions, the costs of all other categories are compared instead.
        gradient_step: f64 = 0.01,
        /// Environment steps per action; the world's unless given.
        frame_skip: u32 = 1,
    }
}

impl SimulatorOptions {
    /// Whether success lowers the cost.
    pub(super) fn gives_bonus(&self) -> bool {
        self.stop_at_success && self.success_bonus > 0.0
    }
}

impl Validate for SimulatorOptions {
    fn validate(&self) -> Result<(), PlanError> {
        if !(self.success_bonus.is_finite() && self.success_bonus >= 0.0) {
            let reason = format!("{} is not a number from 0 on", self.success_bonus);
            return Err(PlanError::setting("success_bonus", reason));
        }
        positive("gradient_step", self.gradient_step)?;
        at_least_one("frame_skip", self.frame_skip as usize)
    }
}
