//! What all solvers that follow gradients can be told.

use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;

use super::rules::{not_negative, positive};
use crate::error::PlanError;
use crate::settings::Settings;
use crate::solver::at_least_one;

/// Settings of gradient descent from several starts, whatever its rule.
///
/// The reference has 1 start and no default for the number of steps; its published runs use 100 and 30, which are the
/// defaults here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Descent {
    /// S: starts. The first is the initial plan itself, the others scatter around it.
    pub samples: usize,
    /// Steps; 0 evaluates the starts and returns the best.
    pub iterations: usize,
    /// Standard deviation of the other starts around the initial plan.
    pub sigma: f64,
    /// Standard deviation of what is added to every number after every step; 0: nothing.
    pub action_noise: f64,
    /// Longest gradient; a longer one is shortened. 0: any length.
    pub grad_clip: f64,
    /// Which gradients that length is of.
    pub grad_clip_mode: GradClip,
    /// Whether the cheapest plan of all steps is returned instead of the cheapest after the last.
    pub track_best: bool,
    /// Seed of the noise, beside that of the episode.
    pub seed: u32,
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

impl Default for Descent {
    fn default() -> Self {
        Self {
            samples: 100,
            iterations: 30,
            sigma: 1.0,
            action_noise: 0.0,
            grad_clip: 0.0,
            grad_clip_mode: GradClip::Sequence,
            track_best: false,
            seed: 0,
        }
    }
}

/// More samples or iterations are a typing error (and would not fit the keys of the noise).
const MAX_COUNT: usize = 10_000_000;

impl Settings for Descent {
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "samples", doc: "starts: the initial plan and others around it", default: "100" },
        Setting { name: "iterations", doc: "gradient steps", default: "30" },
        Setting { name: "sigma", doc: "standard deviation of the other starts", default: "1" },
        Setting { name: "action_noise", doc: "standard deviation of noise after every step", default: "0" },
        Setting { name: "grad_clip", doc: "longest gradient; 0: any", default: "0" },
        Setting {
            name: "grad_clip_mode",
            doc: "whose length: of each sequence, or global (all together)",
            default: "sequence",
        },
        Setting {
            name: "track_best",
            doc: "return the cheapest plan of all steps, not of the last",
            default: "false",
        },
        Setting { name: "seed", doc: "seed of the noise, beside the episode's", default: "0" },
    ];

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
