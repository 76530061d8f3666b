//! iCEM: the cross-entropy method with noise that is correlated in time, elites that are kept, and momentum.
//!
//! Source: Pinneri et al., *Sample-efficient Cross-Entropy Method for Real-time Planning* (2020). The defaults are the
//! reference's `ICEMSolver`, which lacks three things of the publication; they are the settings `decay`, `elite_shift`
//! and `mean_at_last`.

use crate::colored::{Normalize, color, fill_kernel};
use crate::error::PlanError;
use crate::problem::Problem;
use crate::ranges::{check_below_one, check_counts, check_elites, check_not_negative, check_positive};
use crate::sampler::{Episode, Sampler, Search, StateSizes, scale};
use crate::sampling::{Noise, fill_normal, fit_gaussian};
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of iCEM. Defaults are the reference's.
    pub struct Icem {
        /// Candidate plans of the first iteration.
        samples: usize = 300,
        /// Rounds of sampling and refitting; 0 returns the initial plan.
        iterations: usize = 30,
        /// How many of the cheapest samples a refit uses (2 or more); by default 30, or half of the samples if there are fewer.
        ///
        /// The half (rounded down, at least 2) is that of settings by name, such as `icem:samples=20`. A struct has 30 unless it sets both:
        /// `Icem { samples: 20, elites: 10, ..Default::default() }`. If fewer have a finite cost, only those are used.
        elites: usize = 30,
        /// How many elites are candidates again in the next iteration (no more than there are elites).
        elites_kept: usize = 5,
        /// Standard deviation of the candidates in the first iteration.
        sigma: f64 = 1.0,
        /// Smallest standard deviation after a refit; above 0 the search never collapses.
        sigma_min: f64 = 0.0,
        /// Color of the noise: 0 white, 1 pink, 2 red.
        ///
        /// The power at frequency f falls as f^-beta.
        noise_beta: f64 = 2.0,
        /// Standard deviation of the noise: 1 in every sequence (per_sequence) or on average (analytic).
        #[serde(alias = "normalise")]
        normalize: Normalize = Normalize::PerSequence => "per_sequence",
        /// Momentum: weight of the old mean and standard deviation in the new ones.
        alpha: f64 = 0.1,
        /// Factor by which candidates become fewer, down to twice the elites (1.25 as published).
        decay: f64 = 1.0,
        /// Blocks between two plans of an episode, to reuse the last plan's elites; 0 does not.
        ///
        /// Elites of the last plan are shifted by this (the receding horizon) and become candidates of the next.
        elite_shift: usize = 0,
        /// The mean is a candidate in the last iteration only, as published.
        mean_at_last: bool = false,
        /// Clip candidates to the action bounds.
        clip: bool = true,
        /// Return the cheapest plan evaluated, not the final mean.
        return_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for Icem {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_elites(self.elites, self.samples)?;
        if self.elites_kept >= self.samples {
            let (kept, samples) = (self.elites_kept, self.samples);
            let reason = format!("{kept} and the mean are more than {samples} samples; keep fewer");
            return Err(PlanError::setting("elites_kept", reason));
        }
        check_positive("sigma", self.sigma)?;
        check_not_negative("sigma_min", self.sigma_min)?;
        if !(0.0..=20.0).contains(&self.noise_beta) {
            let reason = format!("{} is not a number from 0 to 20", self.noise_beta);
            return Err(PlanError::setting("noise_beta", reason));
        }
        check_below_one("alpha", self.alpha)?;
        if !(1.0..=1e6).contains(&self.decay) {
            let reason = format!("{} is not a number from 1 on; 1.25 is as published", self.decay);
            return Err(PlanError::setting("decay", reason));
        }
        Ok(())
    }
}

impl Sampler for Icem {
    const NAME: &'static str = "icem";
    const SUMMARY: &'static str = "cross-entropy method with colored noise, kept elites and momentum";

    fn search(&self) -> Search {
        let Self { samples, iterations, elites, sigma, clip, return_best, .. } = *self;
        Search { samples, iterations, elites, sigma: sigma as f32, clip, return_best }
    }

    fn state_sizes(&self, problem: &Problem<'_>) -> StateSizes {
        let floats = problem.horizon + (self.kept() + 2) * problem.plan_size();
        StateSizes { floats, doubles: 1, ..StateSizes::default() }
    }

    fn samples_in(&self, iteration: usize) -> usize {
        let shrunk = self.samples as f64 * self.decay.powi(-(iteration.min(10_000) as i32));
        (shrunk as usize).max(2 * self.elites).min(self.samples)
    }

    fn begin(&self, episode: &mut Episode<'_>) {
        let (problem, remembered) = (episode.problem, episode.problem.remembered(episode.index));
        let state = self.parts(episode);
        fill_kernel(state.kernel, self.noise_beta, self.normalize);
        let (size, skipped) = (problem.plan_size(), self.elite_shift * problem.dim());
        if (1..size).contains(&skipped) && remembered.len() <= state.elites.len() {
            let elites = state.elites.chunks_exact_mut(size).zip(remembered.chunks_exact(size));
            for (elite, remembered) in elites {
                let shifted = elite.iter_mut().zip(&remembered[skipped..]);
                shifted.for_each(|(value, &remembered)| *value = remembered as f32);
                *state.count += 1.0;
            }
        }
    }

    /// The mean, kept elites, then mean + std × noise.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        let (key, iteration) = (*episode.key(), episode.iteration);
        let tries_mean = !self.mean_at_last || iteration as usize + 1 == self.iterations;
        // An elite of the last plan covers its first blocks; the rest is sampled.
        let covered = match iteration {
            0 => {
                (episode.problem.horizon - self.elite_shift.min(episode.problem.horizon))
                    * episode.problem.dim()
            }
            _ => episode.mean.len(),
        };
        let state = self.parts(episode);
        let (size, kept) = (state.mean.len(), *state.count as usize);
        let white = state.scratch;
        let mut stream = noise.stream(&key, iteration);
        for (sample, candidate) in candidates.chunks_exact_mut(size).enumerate() {
            // Also for candidates that need none: the noise of the next ones does not depend on it.
            fill_normal(&mut stream, white);
            if sample == 0 && tries_mean {
                candidate.copy_from_slice(state.mean);
                continue;
            }
            let elite = (1..=kept).contains(&sample).then(|| &state.elites[(sample - 1) * size..][..size]);
            if elite.is_none() || covered < size {
                color(state.kernel, self.normalize, white, candidate);
                scale(candidate, state.mean, state.std);
            }
            if let Some(elite) = elite {
                candidate[..covered].copy_from_slice(&elite[..covered]);
            }
        }
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        let state = self.parts(episode);
        let size = state.mean.len();
        let (mean, std) = (state.scratch, state.fitted_std);
        std.copy_from_slice(state.std);
        fit_gaussian(candidates, elites, mean, std);
        let (alpha, least) = (self.alpha as f32, self.sigma_min as f32);
        for (value, fitted) in state.mean.iter_mut().zip(mean) {
            *value = alpha * *value + (1.0 - alpha) * *fitted;
        }
        for (value, fitted) in state.std.iter_mut().zip(std) {
            *value = (alpha * *value + (1.0 - alpha) * *fitted).max(least);
        }
        let kept = elites.len().min(self.kept());
        for (kept, &elite) in state.elites.chunks_exact_mut(size).zip(&elites[..kept]) {
            kept.copy_from_slice(&candidates[elite as usize * size..][..size]);
        }
        *state.count = kept as f64;
    }

    fn end(&self, episode: &mut Episode<'_>, memory: &mut Vec<f64>) {
        if self.elite_shift > 0 {
            let state = self.parts(episode);
            let values = *state.count as usize * state.mean.len();
            memory.extend(state.elites[..values].iter().map(|&value| f64::from(value)));
        }
    }
}

/// State that an episode keeps from iteration to iteration, and scratch.
struct State<'a> {
    mean: &'a mut [f32],
    std: &'a mut [f32],
    /// `[H]`: the filter of the noise.
    kernel: &'a mut [f32],
    /// `[elites_kept, H, D]`, cheapest first.
    elites: &'a mut [f32],
    /// How many of them there are.
    count: &'a mut f64,
    /// `[H, D]`.
    scratch: &'a mut [f32],
    /// `[H, D]`.
    fitted_std: &'a mut [f32],
}

impl Icem {
    fn kept(&self) -> usize {
        self.elites_kept.min(self.elites)
    }

    fn parts<'a>(&self, episode: &'a mut Episode<'_>) -> State<'a> {
        let (horizon, size) = (episode.problem.horizon, episode.mean.len());
        let (kernel, rest) = episode.floats.split_at_mut(horizon);
        let (elites, rest) = rest.split_at_mut(self.kept() * size);
        let (scratch, fitted_std) = rest.split_at_mut(size);
        let (mean, std, count) = (&mut *episode.mean, &mut *episode.std, &mut episode.doubles[0]);
        State { mean, std, kernel, elites, count, scratch, fitted_std }
    }
}
