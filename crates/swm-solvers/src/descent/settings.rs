//! Settings that all gradient solvers share.

use serde::{Deserialize, Serialize};

use crate::error::PlanError;
use crate::ranges::{check_counts, check_not_negative, check_positive};
use crate::settings::Validate;

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
#[non_exhaustive]
pub enum GradClip {
    /// Every candidate's own: plans stay independent of each other.
    #[default]
    Sequence,
    /// That of all candidates of all episodes as one vector, as the reference does; plans then depend on which others
    /// are made with them.
    Global,
}

impl Validate for Descent {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        if self.samples > 1 {
            check_positive("sigma", self.sigma)?;
        }
        check_not_negative("sigma", self.sigma)?;
        check_not_negative("action_noise", self.action_noise)?;
        check_not_negative("grad_clip", self.grad_clip)
    }
}
