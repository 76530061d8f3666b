//! Settings of planning on the true simulator.

use serde::{Deserialize, Serialize};

use crate::error::PlanError;
use crate::ranges::{at_least_one, check_not_negative, check_positive};
use crate::settings::Validate;

/// How the task costs of a rollout become its cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aggregate {
    /// The task cost at the end.
    #[default]
    Last,
    /// The mean over all steps: it rewards reaching the goal early.
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
        check_not_negative("success_bonus", self.success_bonus)?;
        check_positive("gradient_step", self.gradient_step)?;
        at_least_one("frame_skip", self.frame_skip as usize)
    }
}
