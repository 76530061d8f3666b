//! MPPI, model-predictive path integral control: the plan is the mean of its samples, weighted by their costs.
//! The standard deviation of the samples is constant, and there is no control cost.
//!
//! Source: Williams et al., *Information-Theoretic Model Predictive Control* (2018), in the variant of the reference's
//! `MPPISolver`: weights are a softmax of minus cost over temperature, of the cheapest samples only.

use serde::{Deserialize, Serialize};

use crate::error::PlanError;
use crate::problem::Problem;
use crate::ranges::{check_at_most_samples, check_counts, check_positive};
use crate::sampler::{Episode, Sampler, Search, StateSizes};
use crate::sampling::Noise;
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of MPPI. Defaults are the reference's.
    pub struct Mppi {
        /// Candidate plans per iteration.
        samples: usize = 300,
        /// Rounds of sampling and averaging; 0 returns the initial plan.
        iterations: usize = 30,
        /// How many of the cheapest samples have a weight, 0 for all; by default 30, or half of the samples if there are fewer.
        ///
        /// The half (rounded down, at least 2) is that of settings by name, such as `mppi:samples=20`. A struct has 30 unless it sets both:
        /// `Mppi { samples: 20, elites: 10, ..Default::default() }`.
        elites: usize = 30,
        /// Standard deviation of the candidates, in all iterations.
        sigma: f64 = 1.0,
        /// Additional cost that makes a weight e times smaller.
        temperature: f64 = 0.5,
        /// Unit of the temperature: that of the cost (absolute) or its standard deviation (relative).
        temperature_mode: TemperatureMode = TemperatureMode::Absolute => "absolute",
        /// Clip candidates to the action bounds. The reference does not.
        clip: bool = false,
        /// Return the cheapest plan evaluated, not the final mean.
        return_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

/// Unit of the temperature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum TemperatureMode {
    /// Units of the cost, as in the reference: what it does depends on the scale of the cost.
    #[default]
    Absolute,
    /// Standard deviations of the costs that have a weight.
    Relative,
}

impl Validate for Mppi {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_at_most_samples(self.elites, self.samples)?;
        check_positive("sigma", self.sigma)?;
        check_positive("temperature", self.temperature)
    }
}

impl Sampler for Mppi {
    const NAME: &'static str = "mppi";
    const SUMMARY: &'static str =
        "path integral control: average samples, weighted by a softmax of their costs";

    fn search(&self) -> Search {
        Search {
            samples: self.samples,
            iterations: self.iterations,
            elites: if self.elites == 0 { self.samples } else { self.elites },
            sigma: self.sigma as f32,
            clip: self.clip,
            return_best: self.return_best,
        }
    }

    fn state_sizes(&self, problem: &Problem<'_>) -> StateSizes {
        StateSizes { doubles: problem.plan_size(), ..StateSizes::default() }
    }

    /// The mean, then mean + std × noise.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        episode.sample_around_mean(candidates, &noise);
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], costs: &[f64], elites: &[u32]) {
        let cost = |elite: u32| costs[elite as usize];
        let least = cost(elites[0]);
        let temperature = match self.temperature_mode {
            TemperatureMode::Absolute => self.temperature,
            TemperatureMode::Relative => self.temperature * std_of(elites.iter().map(|&elite| cost(elite))),
        };
        let (size, sums) = (episode.mean.len(), &mut *episode.doubles);
        sums.fill(0.0);
        let mut total = 0.0;
        for &elite in elites {
            let excess = cost(elite) - least;
            // Equal costs have equal weights, also where all are equal and a relative temperature is 0.
            let weight = if excess > 0.0 { (-excess / temperature).exp() } else { 1.0 };
            total += weight;
            let candidate = &candidates[elite as usize * size..][..size];
            sums.iter_mut().zip(candidate).for_each(|(sum, &value)| *sum += weight * f64::from(value));
        }
        for (mean, sum) in episode.mean.iter_mut().zip(sums) {
            *mean = (*sum / total) as f32;
        }
    }
}

/// Standard deviation (dividing by the count).
fn std_of(values: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let count = values.len() as f64;
    let mean = values.clone().sum::<f64>() / count;
    (values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / count).sqrt()
}
