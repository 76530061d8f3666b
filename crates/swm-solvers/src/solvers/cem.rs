//! The cross-entropy method: sample plans around a mean, refit mean and standard deviation to the cheapest
//! ones, repeat. Without momentum, correlated noise or kept elites: iCEM has those.
//!
//! Source: Rubinstein & Kroese, *The Cross-Entropy Method* (2004), in the variant of the reference's
//! `CEMSolver`: sample 0 is the mean itself, and the standard deviation of the elites is the unbiased one.

use crate::error::PlanError;
use crate::ranges::{check_counts, check_elites, check_not_negative, check_positive};
use crate::sampler::{Episode, Sampler, Search};
use crate::sampling::{Noise, fit_gaussian};
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of the cross-entropy method. Defaults are the reference's.
    pub struct Cem {
        /// Candidate plans per iteration.
        samples: usize = 300,
        /// Rounds of sampling and refitting; 0 returns the initial plan.
        iterations: usize = 30,
        /// How many of the cheapest samples a refit uses (2 or more); by default 30, or half of the samples if there are fewer.
        ///
        /// The half (rounded down, at least 2) is that of settings by name, such as `cem:samples=20`. A struct has 30 unless it sets both:
        /// `Cem { samples: 20, elites: 10, ..Default::default() }`. If fewer have a finite cost, only those are used.
        elites: usize = 30,
        /// Standard deviation of the candidates in the first iteration.
        sigma: f64 = 1.0,
        /// Smallest standard deviation after a refit; above 0 the search never collapses.
        sigma_min: f64 = 0.0,
        /// Clip candidates to the action bounds. The reference does not.
        clip: bool = false,
        /// Return the cheapest plan evaluated, not the final mean.
        return_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for Cem {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_elites(self.elites, self.samples)?;
        check_positive("sigma", self.sigma)?;
        check_not_negative("sigma_min", self.sigma_min)
    }
}

impl Sampler for Cem {
    const NAME: &'static str = "cem";
    const SUMMARY: &'static str = "cross-entropy method: refit a Gaussian to the cheapest of its samples";

    fn search(&self) -> Search {
        let Self { samples, iterations, elites, sigma, clip, return_best, .. } = *self;
        Search { samples, iterations, elites, sigma: sigma as f32, clip, return_best }
    }

    /// The mean, then mean + std × noise.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        episode.sample_around_mean(candidates, &noise);
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        fit_gaussian(candidates, elites, episode.mean, episode.std);
        let least = self.sigma_min as f32;
        episode.std.iter_mut().for_each(|sigma| *sigma = sigma.max(least));
    }
}
