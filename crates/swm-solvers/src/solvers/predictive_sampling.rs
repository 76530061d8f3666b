//! Predictive sampling: draw plans around the best one known, take the cheapest. Nothing is fitted.
//!
//! Source: Howell et al., *Predictive Sampling: Real-time Behavior Synthesis with MuJoCo* (2022), in the variant of the
//! reference's `PredictiveSamplingSolver`: noise on every block, no splines.

use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;

use crate::error::PlanError;
use crate::ranges::{check_counts, check_positive};
use crate::sampling::Noise;
use crate::search::{Episode, Sampler, Search};
use crate::settings::Settings;
use crate::solver::SolverConfig;

/// Settings of predictive sampling. Defaults are the reference's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PredictiveSampling {
    /// S: candidates per iteration, the best plan known among them.
    pub samples: usize,
    /// Iterations; the reference makes one, and relies on planning often.
    pub iterations: usize,
    /// Standard deviation of every number.
    pub sigma: f64,
    /// Whether candidates are clipped to the bounds of the actions. The reference does not.
    pub clip: bool,
    /// Seed of the noise, beside that of the episode.
    pub seed: u32,
}

impl Default for PredictiveSampling {
    fn default() -> Self {
        Self { samples: 300, iterations: 1, sigma: 1.0, clip: false, seed: 0 }
    }
}

impl Settings for PredictiveSampling {
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "samples", doc: "candidate plans, the best one known among them", default: "300" },
        Setting { name: "iterations", doc: "rounds of drawing and choosing", default: "1" },
        Setting { name: "sigma", doc: "standard deviation of the candidates", default: "1" },
        Setting { name: "clip", doc: "clip candidates to the action bounds", default: "false" },
        Setting { name: "seed", doc: "seed of the noise, beside the episode's", default: "0" },
    ];

    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_positive("sigma", self.sigma)
    }
}

impl SolverConfig for PredictiveSampling {
    const NAME: &'static str = "predictive-sampling";
    const SUMMARY: &'static str = "take the cheapest of samples around the last plan";
}

impl Sampler for PredictiveSampling {
    fn search(&self) -> Search {
        Search {
            samples: self.samples,
            iterations: self.iterations,
            elites: 1,
            sigma: self.sigma as f32,
            clip: self.clip,
            return_best: false,
        }
    }

    /// The best plan known, then that + spread × noise.
    fn draw(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        episode.draw_around_mean(candidates, &noise);
    }

    fn learn(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        let size = episode.mean.len();
        episode.mean.copy_from_slice(&candidates[elites[0] as usize * size..][..size]);
    }
}
