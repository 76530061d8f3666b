//! Predictive sampling: sample plans around the best one known, take the cheapest. Nothing is fitted.
//!
//! Source: Howell et al., *Predictive Sampling: Real-time Behavior Synthesis with MuJoCo* (2022), in the variant of the
//! reference's `PredictiveSamplingSolver`: noise on every block, no splines.

use crate::error::PlanError;
use crate::ranges::{check_counts, check_positive};
use crate::sampler::{Episode, Sampler, Search};
use crate::sampling::Noise;
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of predictive sampling. Defaults are the reference's.
    pub struct PredictiveSampling {
        /// Candidate plans, the best one known among them.
        samples: usize = 300,
        /// Rounds of sampling and choosing. The reference makes one and replans often.
        iterations: usize = 1,
        /// Standard deviation of the candidates.
        sigma: f64 = 1.0,
        /// Clip candidates to the action bounds. The reference does not.
        clip: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for PredictiveSampling {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_positive("sigma", self.sigma)
    }
}

impl Sampler for PredictiveSampling {
    const NAME: &'static str = "predictive-sampling";
    const SUMMARY: &'static str = "take the cheapest of samples around the last plan";

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

    /// The best plan known, then that + std × noise.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        episode.sample_around_mean(candidates, &noise);
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        let size = episode.mean.len();
        episode.mean.copy_from_slice(&candidates[elites[0] as usize * size..][..size]);
    }
}
