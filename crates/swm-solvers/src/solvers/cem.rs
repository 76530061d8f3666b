//! The cross-entropy method: draw plans around a mean, refit mean and spread to the cheapest ones, repeat.
//! Without momentum, correlated noise or kept elites: those belong to its relatives.
//!
//! Source: Rubinstein & Kroese, *The Cross-Entropy Method* (2004), in the variant of the reference's
//! `CEMSolver`: sample 0 is the mean itself, and spread is the unbiased standard deviation of the elites.

use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;

use crate::error::PlanError;
use crate::ranges::{check_counts, check_elites, check_not_negative, check_positive};
use crate::sampling::{Noise, fit_gaussian};
use crate::search::{Episode, Sampler, Search};
use crate::settings::Settings;
use crate::solver::SolverConfig;

/// Settings of the cross-entropy method. Defaults are the reference's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Cem {
    /// S: candidates per iteration.
    pub samples: usize,
    /// Iterations; 0 returns the initial plan.
    pub iterations: usize,
    /// K: how many of the cheapest candidates the distribution is refitted to. If fewer have a finite cost, those
    /// only.
    pub elites: usize,
    /// Standard deviation of every number in the first iteration.
    pub sigma: f64,
    /// Smallest standard deviation after a refit; above 0 the search never freezes.
    pub sigma_min: f64,
    /// Whether candidates are clipped to the bounds of the actions. The reference does not.
    pub clip: bool,
    /// Whether the cheapest plan ever evaluated is returned instead of the final mean.
    pub return_best: bool,
    /// Seed of the noise, beside that of the episode.
    pub seed: u32,
}

impl Default for Cem {
    fn default() -> Self {
        Self {
            samples: 300,
            iterations: 30,
            elites: 30,
            sigma: 1.0,
            sigma_min: 0.0,
            clip: false,
            return_best: false,
            seed: 0,
        }
    }
}

impl Settings for Cem {
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "samples", doc: "candidate plans per iteration", default: "300" },
        Setting { name: "iterations", doc: "rounds of drawing and refitting", default: "30" },
        Setting { name: "elites", doc: "cheapest candidates that a refit uses (2 or more)", default: "30" },
        Setting { name: "sigma", doc: "standard deviation of the first candidates", default: "1" },
        Setting { name: "sigma_min", doc: "smallest standard deviation after a refit", default: "0" },
        Setting { name: "clip", doc: "clip candidates to the action bounds", default: "false" },
        Setting { name: "return_best", doc: "return the cheapest plan seen, not the mean", default: "false" },
        Setting { name: "seed", doc: "seed of the noise, beside the episode's", default: "0" },
    ];

    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_elites(self.elites, self.samples)?;
        check_positive("sigma", self.sigma)?;
        check_not_negative("sigma_min", self.sigma_min)
    }
}

impl SolverConfig for Cem {
    const NAME: &'static str = "cem";
    const SUMMARY: &'static str = "cross-entropy method: refit a Gaussian to the cheapest of its samples";
}

impl Sampler for Cem {
    fn search(&self) -> Search {
        Search {
            samples: self.samples,
            iterations: self.iterations,
            elites: self.elites,
            sigma: self.sigma as f32,
            clip: self.clip,
            return_best: self.return_best,
        }
    }

    /// The mean, then mean + spread × noise.
    fn draw(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        episode.draw_around_mean(candidates, &noise);
    }

    fn learn(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        fit_gaussian(candidates, elites, episode.mean, episode.spread);
        let floor = self.sigma_min as f32;
        episode.spread.iter_mut().for_each(|sigma| *sigma = sigma.max(floor));
    }
}
