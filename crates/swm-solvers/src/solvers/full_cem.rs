//! The cross-entropy method with a full covariance: it fits the correlations of cheap plans across time and actions,
//! where [`crate::Cem`] fits a standard deviation per value. Not in the reference.
//!
//! Source: Rubinstein & Kroese, *The Cross-Entropy Method* (2004), for Gaussians with covariance; shrinkage toward the
//! diagonal as of Ledoit & Wolf, *A well-conditioned estimator* (2004), with a fixed weight.

use crate::error::PlanError;
use crate::matrix::{check_size, cholesky, stack_len};
use crate::problem::Problem;
use crate::ranges::{
    check_below_one, check_counts, check_elites, check_fraction, check_not_negative, check_positive,
};
use crate::sampler::{Episode, Sampler, Search, StateSizes};
use crate::sampling::{Noise, fill_normal};
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of the cross-entropy method with a full covariance.
    pub struct FullCem {
        /// Candidate plans per iteration.
        samples: usize = 300,
        /// Rounds of sampling and refitting; 0 returns the initial plan.
        iterations: usize = 30,
        /// How many of the cheapest samples a refit uses (2 or more); by default 30, or half of the samples if there are fewer.
        ///
        /// The half (rounded down, at least 2) is that of settings by name, such as `full-cem:samples=20`. A struct has 30 unless it sets both:
        /// `FullCem { samples: 20, elites: 10, ..Default::default() }`. If fewer have a finite cost, only those are used.
        elites: usize = 30,
        /// Standard deviation of the candidates in the first iteration.
        sigma: f64 = 1.0,
        /// Smallest standard deviation after a refit; above 0 the search never collapses.
        sigma_min: f64 = 0.0,
        /// Weight of the diagonal in the covariance, 0 to 1.
        ///
        /// With fewer elites than values in a plan, more is better.
        shrinkage: f64 = 0.1,
        /// Momentum: weight of the old covariance in the new one.
        alpha: f64 = 0.2,
        /// Clip candidates to the action bounds.
        clip: bool = false,
        /// Return the cheapest plan evaluated, not the final mean.
        return_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for FullCem {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_elites(self.elites, self.samples)?;
        check_positive("sigma", self.sigma)?;
        check_not_negative("sigma_min", self.sigma_min)?;
        check_below_one("alpha", self.alpha)?;
        check_fraction("shrinkage", self.shrinkage)
    }
}

impl Sampler for FullCem {
    const NAME: &'static str = "full-cem";
    const SUMMARY: &'static str = "cross-entropy method with a full covariance over time and actions";

    fn search(&self) -> Search {
        let Self { samples, iterations, elites, sigma, clip, return_best, .. } = *self;
        Search { samples, iterations, elites, sigma: sigma as f32, clip, return_best }
    }

    fn check_problem(&self, problem: &Problem<'_>) -> Result<(), PlanError> {
        check_size(problem)
    }

    fn state_sizes(&self, problem: &Problem<'_>) -> StateSizes {
        let size = problem.plan_size();
        StateSizes { floats: size, doubles: 2 * size * size + 2 * size, stack: stack_len(size) }
    }

    fn begin(&self, episode: &mut Episode<'_>) {
        let size = episode.mean.len();
        let State { covariance, factor, .. } = State::of(size, episode.doubles);
        for i in 0..size {
            covariance[i + i * size] = self.sigma * self.sigma;
            factor[i + i * size] = self.sigma;
        }
    }

    /// The mean, then mean + factor × noise.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        let (size, key) = (episode.mean.len(), *episode.key());
        let State { factor, sum, .. } = State::of(size, episode.doubles);
        let mut stream = noise.stream(&key, episode.iteration);
        let (first, others) = candidates.split_at_mut(size);
        first.copy_from_slice(episode.mean);
        for candidate in others.chunks_exact_mut(size) {
            fill_normal(&mut stream, episode.floats);
            sum.iter_mut().zip(&*episode.mean).for_each(|(sum, &mean)| *sum = f64::from(mean));
            for (j, &noise) in episode.floats.iter().enumerate() {
                let column = &factor[j * size + j..(j + 1) * size];
                sum[j..].iter_mut().zip(column).for_each(|(sum, value)| *sum += value * f64::from(noise));
            }
            candidate.iter_mut().zip(&*sum).for_each(|(out, &value)| *out = value as f32);
        }
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        let size = episode.mean.len();
        let State { covariance, factor, sum, offset } = State::of(size, episode.doubles);
        let plans = || elites.iter().map(|&elite| &candidates[elite as usize * size..][..size]);
        let count = elites.len() as f64;
        sum.fill(0.0);
        plans().for_each(|plan| sum.iter_mut().zip(plan).for_each(|(sum, &value)| *sum += f64::from(value)));
        sum.iter_mut().for_each(|sum| *sum /= count);
        episode.mean.iter_mut().zip(&*sum).for_each(|(mean, &sum)| *mean = sum as f32);
        if elites.len() < 2 {
            return;
        }
        // The lower triangle, column by column; it is all that the factorization reads.
        factor.fill(0.0);
        for plan in plans() {
            for ((offset, &value), mean) in offset.iter_mut().zip(plan).zip(&*sum) {
                *offset = f64::from(value) - mean;
            }
            for (j, column) in factor.chunks_exact_mut(size).enumerate() {
                let weight = offset[j];
                column[j..].iter_mut().zip(&offset[j..]).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        let (scale, off_diagonal) = ((1.0 - self.alpha) / (count - 1.0), 1.0 - self.shrinkage);
        for j in 0..size {
            for i in j..size {
                let fitted = factor[i + j * size] * if i == j { 1.0 } else { off_diagonal };
                let value = &mut covariance[i + j * size];
                *value = self.alpha * *value + scale * fitted;
            }
            let variance = &mut covariance[j + j * size];
            *variance = variance.max(self.sigma_min * self.sigma_min);
            episode.std[j] = variance.sqrt() as f32;
        }
        factor.copy_from_slice(covariance);
        // The covariance of fewer elites than dimensions is singular; rounding may make it indefinite.
        (0..size)
            .for_each(|j| factor[j + j * size] = factor[j + j * size] * (1.0 + 1e-9) + f64::MIN_POSITIVE);
        if !cholesky(factor, size, episode.stack) {
            factor.fill(0.0);
            (0..size).for_each(|j| factor[j + j * size] = f64::from(episode.std[j]));
        }
    }
}

/// State that an episode keeps from iteration to iteration, and scratch. Matrices are stored column by column.
struct State<'a> {
    /// `[H × D, H × D]`, the lower triangle.
    covariance: &'a mut [f64],
    /// Its Cholesky factor.
    factor: &'a mut [f64],
    /// `[H × D]`.
    sum: &'a mut [f64],
    /// `[H × D]`.
    offset: &'a mut [f64],
}

impl<'a> State<'a> {
    fn of(size: usize, doubles: &'a mut [f64]) -> Self {
        let (covariance, rest) = doubles.split_at_mut(size * size);
        let (factor, rest) = rest.split_at_mut(size * size);
        let (sum, offset) = rest.split_at_mut(size);
        Self { covariance, factor, sum, offset }
    }
}
