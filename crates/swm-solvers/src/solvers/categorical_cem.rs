//! The cross-entropy method for integers: sample plans from independent categories, refit their probabilities to the
//! cheapest ones, repeat.
//!
//! Source: Rubinstein & Kroese, *The Cross-Entropy Method* (2004), in the variant of the reference's
//! `CategoricalCEMSolver`: sample 0 is the most probable plan, and so is the result.

use rand_distr::{Distribution as _, Open01};
use swm_core::Space;

use crate::error::PlanError;
use crate::problem::Problem;
use crate::ranges::{
    at_least_one, check_at_most_samples, check_below_one, check_counts, check_fraction, check_not_negative,
};
use crate::sampler::{Episode, Sampler, Search, StateSizes};
use crate::sampling::Noise;
use crate::settings::Validate;
use crate::space::{check_categories, groups, largest, round};

swm_core::settings! {
    /// Settings of the categorical cross-entropy method. Defaults are the reference's.
    pub struct CategoricalCem {
        /// Candidate plans per iteration.
        samples: usize = 300,
        /// Rounds of sampling and refitting; 0 returns the initial plan.
        iterations: usize = 30,
        /// How many of the cheapest samples a refit uses (1 or more); by default 30, or half of the samples if there are fewer.
        ///
        /// The half (rounded down, at least 2) is that of settings by name, such as `categorical-cem:samples=20`. A struct has 30 unless it sets both:
        /// `CategoricalCem { samples: 20, elites: 10, ..Default::default() }`.
        elites: usize = 30,
        /// Added to every category's frequency among the elites; above 0, no category dies out.
        smoothing: f64 = 0.0,
        /// Momentum: weight of the old probabilities in the new ones.
        alpha: f64 = 0.0,
        /// Probability that a warm-started action is sampled uniformly; 1 ignores the warm start.
        ///
        /// The reference starts with equal probabilities always, as 1 does.
        warm_start_epsilon: f64 = 1.0,
        /// Return the cheapest plan evaluated, not the most probable one.
        return_best: bool = false,
        /// Seed of the noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for CategoricalCem {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        at_least_one("elites", self.elites)?;
        check_at_most_samples(self.elites, self.samples)?;
        check_not_negative("smoothing", self.smoothing)?;
        check_below_one("alpha", self.alpha)?;
        check_fraction("warm_start_epsilon", self.warm_start_epsilon)
    }
}

/// Categories that died out are still sampled with this probability, as in the reference.
const LEAST_PROBABILITY: f32 = 1e-10;

impl Sampler for CategoricalCem {
    const NAME: &'static str = "categorical-cem";
    const SUMMARY: &'static str =
        "cross-entropy method for integers: refit probabilities to the cheapest samples";

    fn bounds<'a>(&self, space: &'a Space) -> Result<(&'a [f64], &'a [f64]), PlanError> {
        check_categories(Self::NAME, space)?;
        Ok((&[], &[]))
    }

    fn search(&self) -> Search {
        Search {
            samples: self.samples,
            iterations: self.iterations,
            elites: self.elites,
            sigma: 0.0,
            clip: false,
            return_best: self.return_best,
        }
    }

    fn state_sizes(&self, problem: &Problem<'_>) -> StateSizes {
        StateSizes { floats: problem.plan_size(), ..StateSizes::default() }
    }

    /// From here on `mean` holds probabilities, and `std` the standard deviations of the values sampled with them.
    fn begin(&self, episode: &mut Episode<'_>) {
        let epsilon = self.warm_start_epsilon as f32;
        for group in groups(episode.problem.action, episode.mean) {
            let even = 1.0 / group.len() as f32;
            // Zeros stand where nothing is known.
            let known = group.iter().any(|&value| value > 0.0);
            let choice = largest(group);
            group.fill(if known { epsilon * even } else { even });
            if known {
                group[choice] += 1.0 - epsilon;
            }
        }
        update_std(episode);
    }

    /// The most probable plan, then plans sampled by probability.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        let (action, mean) = (episode.problem.action, &*episode.mean);
        candidates.fill(0.0);
        let (first, others) = candidates.split_at_mut(mean.len());
        for (out, probabilities) in pairs(action, first, mean) {
            out[largest(probabilities)] = 1.0;
        }
        let mut stream = noise.stream(episode.key(), episode.iteration);
        for candidate in others.chunks_exact_mut(mean.len()) {
            for (out, probabilities) in pairs(action, candidate, mean) {
                out[pick(probabilities, Open01.sample(&mut stream))] = 1.0;
            }
        }
    }

    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], _costs: &[f64], elites: &[u32]) {
        let (size, shares) = (episode.mean.len(), &mut *episode.floats);
        shares.fill(0.0);
        for &elite in elites {
            let candidate = &candidates[elite as usize * size..][..size];
            shares.iter_mut().zip(candidate).for_each(|(sum, value)| *sum += value);
        }
        let (count, smoothing, alpha) = (elites.len() as f32, self.smoothing as f32, self.alpha as f32);
        for (probabilities, shares) in pairs(episode.problem.action, episode.mean, shares) {
            let total = 1.0 + smoothing * shares.len() as f32;
            for (probability, share) in probabilities.iter_mut().zip(shares) {
                *probability = alpha * *probability + (1.0 - alpha) * (share / count + smoothing) / total;
            }
        }
        update_std(episode);
    }

    fn end(&self, episode: &mut Episode<'_>, _memory: &mut Vec<f64>) {
        round(episode.problem.action, episode.mean);
    }
}

/// The category at `quantile`, of 0 to 1, when categories are laid out by their probabilities.
fn pick(probabilities: &[f32], quantile: f32) -> usize {
    let total: f32 = probabilities.iter().map(|p| p.max(LEAST_PROBABILITY)).sum();
    let mut rest = quantile * total;
    for (category, probability) in probabilities.iter().enumerate() {
        rest -= probability.max(LEAST_PROBABILITY);
        if rest < 0.0 {
            return category;
        }
    }
    largest(probabilities)
}

/// A value that is 1 with probability p and 0 otherwise has the standard deviation √(p (1 - p)).
fn update_std(episode: &mut Episode<'_>) {
    for (std, &p) in episode.std.iter_mut().zip(&*episode.mean) {
        *std = (p * (1.0 - p)).max(0.0).sqrt();
    }
}

/// The groups of two plans at once.
fn pairs<'a>(
    action: &Space,
    plan: &'a mut [f32],
    other: &'a [f32],
) -> impl Iterator<Item = (&'a mut [f32], &'a [f32])> {
    let mut rest = other;
    groups(action, plan).map(move |group| {
        let (part, tail) = rest.split_at(group.len());
        rest = tail;
        (group, part)
    })
}
