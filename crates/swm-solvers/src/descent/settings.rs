//! What all solvers that follow gradients can be told.

use serde::{Deserialize, Serialize};

use super::rules::{not_negative, positive};
use crate::error::PlanError;
use crate::settings::Validate;
use crate::solver::at_least_one;

swm_core::settings! {
    /// Settings of gradient descent from several starts, whatever the optimizer.
    ///
    /// The reference has 1 start and no default for the number of steps; its published runs use 100 and 30, which are the
    /// defaults here.
    pub struct Descent {
        /// Starts: the initial plan and random ones around it.
        samples: usize = 100,
        /// Gradient steps; 0 evaluates the starts and returns the best.
        iterations: usize = 30,
        /// Standard deviation of the other starts around the initial plan.
        sigma: f64 = 1.0,
        /// Standard deviation of the noise added after every step.
        action_noise: f64 = 0.0,
        /// Largest gradient norm; longer gradients are scaled down. 0: no limit.
        grad_clip: f64 = 0.0,
        /// Whose norm: that of each sequence, or global (all together).
        grad_clip_mode: GradClip = GradClip::Sequence => "sequence",
        /// Return the cheapest plan of all steps, not of the last.
        track_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

/// Which gradients are measured together when they are clipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradClip {
    /// Every candidate's own: plans stay independent of each other.
    #[default]
    Sequence,
    /// That of all candidates of all episodes as one vector, as the reference does; plans then depend on which others
    /// are made with them.
    Global,
}

/// More samples or iterations are a typing error (and would not fit the keys of the noise).
const MAX_COUNT: usize = 10_000_000;

impl Validate for Descent {
    fn validate(&self) -> Result<(), PlanError> {
        at_least_one("samples", self.samples)?;
        for (name, value) in [("samples", self.samples), ("iterations", self.iterations)] {
            if value > MAX_COUNT {
                return Err(PlanError::setting(name, format!("{value} is more than {MAX_COUNT}")));
            }
        }
        if self.samples > 1 {
            positive("sigma", self.sigma)?;
        }
        not_negative("sigma", self.sigma)?;
        not_negative("action_noise", self.action_noise)?;
        not_negative("grad_clip", self.grad_clip)
    }
}
