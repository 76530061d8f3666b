//! CMA-ES: an evolution strategy that adapts the covariance to successful steps and the step size to the length of the
//! evolution path. Positive weights only, no restarts. Not in the reference.
//!
//! Source: Hansen, *The CMA Evolution Strategy: A Tutorial* (2016, arXiv 1604.00772), whose default rates are used; its
//! equation numbers are given in the code.

use crate::error::PlanError;
use crate::matrix::{check_size, eigen, stack_len};
use crate::problem::Problem;
use crate::ranges::{check_counts, check_positive};
use crate::sampler::{Episode, Sampler, Search, StateSizes};
use crate::sampling::{Noise, fill_normal};
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of CMA-ES. Its defaults evaluate as many plans as those of [`crate::Cem`], in more and smaller iterations:
    /// it adapts between them.
    pub struct CmaEs {
        /// Candidate plans per iteration (4 or more): λ. The cheaper half has weights.
        samples: usize = 50,
        /// Rounds of sampling and adapting; 0 returns the initial plan.
        iterations: usize = 180,
        /// Standard deviation of the candidates in the first iteration.
        sigma: f64 = 1.0,
        /// Clip candidates to the action bounds.
        clip: bool = false,
        /// Return the cheapest plan evaluated, not the final mean.
        return_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for CmaEs {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        if self.samples < 4 {
            let reason = format!("{} is too few; its cheaper half must be 2 or more", self.samples);
            return Err(PlanError::setting("samples", reason));
        }
        check_positive("sigma", self.sigma)
    }
}

impl Sampler for CmaEs {
    const NAME: &'static str = "cma-es";
    const SUMMARY: &'static str = "evolution strategy that adapts covariance and step size (CMA-ES)";

    fn search(&self) -> Search {
        Search {
            samples: self.samples,
            iterations: self.iterations,
            elites: self.samples / 2,
            sigma: self.sigma as f32,
            clip: self.clip,
            return_best: self.return_best,
        }
    }

    fn check_problem(&self, problem: &Problem<'_>) -> Result<(), PlanError> {
        check_size(problem)
    }

    fn state_sizes(&self, problem: &Problem<'_>) -> StateSizes {
        let size = problem.plan_size();
        StateSizes { floats: size, doubles: 2 * size * size + 6 * size + 2, stack: stack_len(size) }
    }

    fn begin(&self, episode: &mut Episode<'_>) {
        let size = episode.mean.len();
        let state = State::of(size, episode.doubles);
        state.mean.iter_mut().zip(&*episode.mean).for_each(|(out, &value)| *out = f64::from(value));
        *state.sigma = self.sigma;
        state.lengths.fill(1.0);
        for i in 0..size {
            state.covariance[i + i * size] = 1.0;
            state.axes[i + i * size] = 1.0;
        }
    }

    /// Mean + σ × axes × lengths × noise (38 to 40). The mean itself is no candidate.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        let (size, key) = (episode.mean.len(), *episode.key());
        let State { mean, axes, lengths, step, sigma, .. } = State::of(size, episode.doubles);
        let mut stream = noise.stream(&key, episode.iteration);
        for candidate in candidates.chunks_exact_mut(size) {
            fill_normal(&mut stream, episode.floats);
            step.fill(0.0);
            for ((axis, length), &noise) in axes.chunks_exact(size).zip(&*lengths).zip(&*episode.floats) {
                let weight = length * f64::from(noise);
                step.iter_mut().zip(axis).for_each(|(sum, value)| *sum += weight * value);
            }
            for ((out, mean), step) in candidate.iter_mut().zip(&*mean).zip(&*step) {
                *out = (mean + *sigma * step) as f32;
            }
        }
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        let size = episode.mean.len();
        let rates = Rates::new(size, self.samples);
        let state = State::of(size, episode.doubles);
        let sigma = *state.sigma;
        let plans = || elites.iter().map(|&elite| &candidates[elite as usize * size..][..size]);
        // Fewer than half of the candidates may be usable: the remaining weights still add up to 1.
        let total: f64 = (0..elites.len()).map(|rank| rates.weight(rank)).sum();
        let weight = |rank: usize| rates.weight(rank) / total;

        // The mean step (41), in units of sigma, and the mean (42).
        state.step.fill(0.0);
        for (rank, plan) in plans().enumerate() {
            for ((step, &value), mean) in state.step.iter_mut().zip(plan).zip(&*state.mean) {
                *step += weight(rank) * (f64::from(value) - mean) / sigma;
            }
        }
        // The path of sigma (43): the step without the form of the covariance.
        let keep = 1.0 - rates.sigma;
        let grow = (rates.sigma * (2.0 - rates.sigma) * rates.mass).sqrt();
        state.sigma_path.iter_mut().for_each(|path| *path *= keep);
        for (axis, length) in state.axes.chunks_exact(size).zip(&*state.lengths) {
            let along: f64 = axis.iter().zip(&*state.step).map(|(axis, step)| axis * step).sum();
            let along = grow * along / length;
            state.sigma_path.iter_mut().zip(axis).for_each(|(path, axis)| *path += along * axis);
        }
        let length = state.sigma_path.iter().map(|path| path * path).sum::<f64>().sqrt();
        let generations = f64::from(episode.iteration) + 1.0;
        let settled = (1.0 - keep.powf(2.0 * generations)).sqrt();
        let steady = length / settled < (1.4 + 2.0 / (size as f64 + 1.0)) * rates.expected_length;
        // The path of the covariance (45); it is held while sigma grows fast.
        let keep = 1.0 - rates.path;
        let grow = if steady { (rates.path * (2.0 - rates.path) * rates.mass).sqrt() } else { 0.0 };
        for (path, step) in state.path.iter_mut().zip(&*state.step) {
            *path = keep * *path + grow * step;
        }
        // The covariance (47), its lower triangle.
        let lost = if steady { 0.0 } else { rates.one * rates.path * (2.0 - rates.path) };
        let keep = 1.0 - rates.one - rates.many + lost;
        for (j, column) in state.covariance.chunks_exact_mut(size).enumerate() {
            let weight = rates.one * state.path[j];
            for (value, path) in column[j..].iter_mut().zip(&state.path[j..]) {
                *value = keep * *value + weight * path;
            }
        }
        for (rank, plan) in plans().enumerate() {
            let scale = rates.many * weight(rank) / (sigma * sigma);
            for ((offset, &value), mean) in state.offset.iter_mut().zip(plan).zip(&*state.mean) {
                *offset = f64::from(value) - mean;
            }
            for (j, column) in state.covariance.chunks_exact_mut(size).enumerate() {
                let weight = scale * state.offset[j];
                column[j..]
                    .iter_mut()
                    .zip(&state.offset[j..])
                    .for_each(|(sum, value)| *sum += weight * value);
            }
        }
        for (mean, step) in state.mean.iter_mut().zip(&*state.step) {
            *mean += sigma * step;
        }
        // Sigma (44); at most e times larger in one iteration.
        let change = rates.sigma / rates.damping * (length / rates.expected_length - 1.0);
        *state.sigma = (sigma * change.min(1.0).exp()).clamp(SIGMA.0, SIGMA.1);
        // The form of the covariance changes slowly: factorize it when it has changed by about a tenth.
        *state.waited += 1.0;
        if *state.waited * (rates.one + rates.many) * size as f64 * 10.0 >= 1.0 {
            *state.waited = 0.0;
            factorize(state.covariance, state.lengths, state.axes, episode.stack);
        }
        episode.mean.iter_mut().zip(&*state.mean).for_each(|(out, &value)| *out = value as f32);
        for (j, std) in episode.std.iter_mut().enumerate() {
            *std = (*state.sigma * state.covariance[j + j * size].sqrt()) as f32;
        }
    }
}

/// Sigma stays within what plans can hold.
const SIGMA: (f64, f64) = (1e-12, 1e12);

/// Eigenvectors and roots of the eigenvalues of the covariance. If it cannot be factorized, it becomes the identity.
fn factorize(
    covariance: &mut [f64],
    lengths: &mut [f64],
    axes: &mut [f64],
    stack: &mut [std::mem::MaybeUninit<f64>],
) {
    let size = lengths.len();
    let largest = |lengths: &[f64]| lengths[size - 1];
    if eigen(covariance, lengths, axes, stack) && largest(lengths) > 0.0 && largest(lengths).is_finite() {
        // Rounding may leave the smallest at or below 0.
        let least = 1e-14 * largest(lengths);
        lengths.iter_mut().for_each(|value| *value = value.max(least).sqrt());
        return;
    }
    covariance.fill(0.0);
    axes.fill(0.0);
    lengths.fill(1.0);
    for i in 0..size {
        covariance[i + i * size] = 1.0;
        axes[i + i * size] = 1.0;
    }
}

/// Learning rates: the defaults of the tutorial, for n values and λ candidates.
struct Rates {
    /// λ.
    samples: f64,
    /// μ_eff (8): effective number of weighted candidates.
    mass: f64,
    /// c_σ (55).
    sigma: f64,
    /// d_σ (55).
    damping: f64,
    /// c_c (56).
    path: f64,
    /// c_1 (57).
    one: f64,
    /// c_μ (58).
    many: f64,
    /// Mean length of a vector of n standard normal values.
    expected_length: f64,
}

impl Rates {
    fn new(size: usize, samples: usize) -> Self {
        let n = size as f64;
        let mut rates = Self {
            samples: samples as f64,
            mass: 0.0,
            sigma: 0.0,
            damping: 0.0,
            path: 0.0,
            one: 0.0,
            many: 0.0,
            expected_length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        };
        let (sum, squares) = (0..samples / 2)
            .map(|rank| rates.weight(rank))
            .fold((0.0, 0.0), |(sum, squares), weight| (sum + weight, squares + weight * weight));
        let mass = sum * sum / squares;
        rates.mass = mass;
        rates.sigma = (mass + 2.0) / (n + mass + 5.0);
        rates.damping = 1.0 + 2.0 * (((mass - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + rates.sigma;
        rates.path = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n);
        rates.one = 2.0 / ((n + 1.3).powi(2) + mass);
        let many = 2.0 * (0.25 + mass + 1.0 / mass - 2.0) / ((n + 2.0).powi(2) + mass);
        rates.many = many.min(1.0 - rates.one);
        rates
    }

    /// The weight of the candidate of rank `rank`, from 0 (49), before they are made to add up to 1.
    fn weight(&self, rank: usize) -> f64 {
        ((self.samples + 1.0) / 2.0).ln() - (rank as f64 + 1.0).ln()
    }
}

/// State that an episode keeps from iteration to iteration, and scratch. Matrices are stored column by column.
struct State<'a> {
    /// `[n]`: the mean in double precision.
    mean: &'a mut [f64],
    /// `[n, n]`: the lower triangle.
    covariance: &'a mut [f64],
    /// `[n, n]`: its eigenvectors.
    axes: &'a mut [f64],
    /// `[n]`: the roots of its eigenvalues.
    lengths: &'a mut [f64],
    /// `[n]`.
    path: &'a mut [f64],
    /// `[n]`.
    sigma_path: &'a mut [f64],
    /// `[n]`.
    step: &'a mut [f64],
    /// `[n]`.
    offset: &'a mut [f64],
    /// The step size.
    sigma: &'a mut f64,
    /// Iterations since the covariance was factorized.
    waited: &'a mut f64,
}

impl<'a> State<'a> {
    fn of(size: usize, doubles: &'a mut [f64]) -> Self {
        let mut rest = doubles;
        let mut cut = |length: usize| {
            let (part, tail) = std::mem::take(&mut rest).split_at_mut(length);
            rest = tail;
            part
        };
        Self {
            mean: cut(size),
            covariance: cut(size * size),
            axes: cut(size * size),
            lengths: cut(size),
            path: cut(size),
            sigma_path: cut(size),
            step: cut(size),
            offset: cut(size),
            sigma: &mut cut(1)[0],
            waited: &mut cut(1)[0],
        }
    }
}
