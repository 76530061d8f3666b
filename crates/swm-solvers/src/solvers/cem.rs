//! The cross-entropy method: draw plans around a mean, refit mean and spread to the cheapest ones, repeat.
//! Without momentum, correlated noise or kept elites: those belong to its relatives.
//!
//! Source: Rubinstein & Kroese, *The Cross-Entropy Method* (2004), in the variant of the reference's
//! `CEMSolver`: sample 0 is the mean itself, and spread is the unbiased standard deviation of the elites.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Space;
use swm_core::registry::Setting;

use crate::bounds::{box_bounds, clamp, fill_bounds};
use crate::cost::Cost;
use crate::error::PlanError;
use crate::sampling::{Noise, cheapest, count_non_finite};
use crate::settings::Settings;
use crate::solver::{Plan, PlanKey, Problem, Solver, SolverConfig, at_least_one};
use crate::trace::{Iteration, Trace};
use crate::workspace::Workspace;

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

/// More samples or iterations are a typing error (and would not fit the keys of the noise).
const MAX_COUNT: usize = 10_000_000;

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
        at_least_one("samples", self.samples)?;
        for (name, value) in [("samples", self.samples), ("iterations", self.iterations)] {
            if value > MAX_COUNT {
                return Err(PlanError::setting(name, format!("{value} is more than {MAX_COUNT}")));
            }
        }
        if self.elites < 2 {
            let reason = format!("{} is too few; a spread needs 2 or more", self.elites);
            return Err(PlanError::setting("elites", reason));
        }
        if self.elites > self.samples {
            let reason =
                format!("{} of {} samples; use fewer elites or more samples", self.elites, self.samples);
            return Err(PlanError::setting("elites", reason));
        }
        let in_range = |value: f64| (0.0..=f64::from(f32::MAX)).contains(&value);
        if !in_range(self.sigma) || self.sigma == 0.0 {
            let reason = format!("{} is not a positive number", self.sigma);
            return Err(PlanError::setting("sigma", reason));
        }
        if !in_range(self.sigma_min) {
            let reason = format!("{} is not a number from 0 on", self.sigma_min);
            return Err(PlanError::setting("sigma_min", reason));
        }
        Ok(())
    }
}

impl SolverConfig for Cem {
    const NAME: &'static str = "cem";
    const SUMMARY: &'static str = "cross-entropy method: refit a Gaussian to the cheapest of its samples";
}

impl Solver for Cem {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.changed()
    }

    fn check(&self, space: &Space) -> Result<(), PlanError> {
        self.validate()?;
        box_bounds(Self::NAME, space).map(|_| ())
    }

    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        self.validate()?;
        problem.check()?;
        let bounds = box_bounds(Self::NAME, problem.action)?;
        let (rows, size, samples) = (problem.keys.len(), problem.plan_size(), self.samples);
        problem.check_samples(samples)?;
        let [candidates, low, high, best] =
            workspace.floats.cut([rows * samples * size, size, size, rows * size]);
        let [costs, best_costs] = workspace.doubles.cut([rows * samples, rows]);
        let [order] = workspace.indices.cut([rows * samples]);
        fill_bounds(bounds, self.clip, low, high);
        best_costs.fill(f64::INFINITY);
        plan.begin(problem, self.sigma as f32);
        plan.actions.chunks_exact_mut(size).for_each(|mean| clamp(mean, low, high));
        plan.iterations.fill(self.iterations as u32);
        trace.begin(Self::NAME, problem);

        for iteration in 0..self.iterations {
            let episodes = (
                problem.keys,
                plan.actions.par_chunks_exact(size),
                plan.spread.par_chunks_exact(size),
                candidates.par_chunks_exact_mut(samples * size),
            );
            episodes.into_par_iter().for_each(|(key, mean, spread, candidates)| {
                self.draw(key, iteration as u32, mean, spread, [low, high], candidates);
            });
            cost.evaluate(&problem.candidates(candidates, samples), costs)?;
            self.screen(problem.keys, iteration, costs, &mut plan.non_finite)?;
            let episodes = (
                costs.par_chunks_exact(samples),
                candidates.par_chunks_exact(samples * size),
                order.par_chunks_exact_mut(samples),
                plan.actions.par_chunks_exact_mut(size),
                plan.spread.par_chunks_exact_mut(size),
                &mut plan.elite_mean_last,
                best.par_chunks_exact_mut(size),
                &mut *best_costs,
            );
            episodes.into_par_iter().for_each(
                |(costs, candidates, order, mean, spread, elite_mean, best, best_cost)| {
                    let elites = finite(costs, cheapest(costs, self.elites, order));
                    let sum: f64 = elites.iter().map(|&elite| costs[elite as usize]).sum();
                    *elite_mean = sum / elites.len() as f64;
                    self.refit(candidates, elites, mean, spread);
                    let first = elites[0] as usize;
                    if self.return_best && costs[first] < *best_cost {
                        *best_cost = costs[first];
                        best.copy_from_slice(&candidates[first * size..][..size]);
                    }
                },
            );
            trace.iteration(&Iteration {
                number: iteration,
                keys: problem.keys,
                candidates: problem.candidates(candidates, samples),
                costs,
                elites: self.elites,
                mean: &plan.actions,
                spread: &plan.spread,
                gradient: &[],
            });
        }

        cost.evaluate(&problem.candidates(&plan.actions, 1), &mut plan.cost_of_returned)?;
        for (cost, count) in plan.cost_of_returned.chunks_exact_mut(1).zip(&mut plan.non_finite) {
            *count += count_non_finite(cost);
        }
        if self.return_best {
            plan.replace_by_cheaper(best, best_costs);
        }
        trace.end(problem, plan);
        Ok(())
    }
}

impl Cem {
    /// Candidates `[S, H, D]` of one episode: the mean, then mean + spread × noise, all clipped to the bounds.
    fn draw(
        &self,
        key: &PlanKey,
        iteration: u32,
        mean: &[f32],
        spread: &[f32],
        [low, high]: [&[f32]; 2],
        candidates: &mut [f32],
    ) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        let (first, others) = candidates.split_at_mut(mean.len());
        first.copy_from_slice(mean);
        for (sample, candidate) in (1..).zip(others.chunks_exact_mut(mean.len())) {
            noise.fill(key, iteration, sample, candidate);
            for ((value, mean), spread) in candidate.iter_mut().zip(mean).zip(spread) {
                *value = mean + spread * *value;
            }
            if self.clip {
                clamp(candidate, low, high);
            }
        }
    }

    /// Counts costs that are not finite; an episode that has no other is an error.
    fn screen(
        &self,
        keys: &[PlanKey],
        iteration: usize,
        costs: &mut [f64],
        non_finite: &mut [u64],
    ) -> Result<(), PlanError> {
        let samples = self.samples;
        for ((costs, total), key) in costs.chunks_exact_mut(samples).zip(non_finite).zip(keys) {
            let count = count_non_finite(costs);
            *total += count;
            if count == samples as u64 {
                let &PlanKey { episode, plan, .. } = key;
                return Err(PlanError::NoFiniteCost { episode, plan, iteration, samples });
            }
        }
        Ok(())
    }

    /// Mean and unbiased standard deviation of the elites; a single one leaves the spread as it is.
    fn refit(&self, candidates: &[f32], elites: &[u32], mean: &mut [f32], spread: &mut [f32]) {
        let size = mean.len();
        let plans = || elites.iter().map(|&elite| &candidates[elite as usize * size..][..size]);
        mean.fill(0.0);
        for plan in plans() {
            mean.iter_mut().zip(plan).for_each(|(sum, value)| *sum += value);
        }
        let count = elites.len() as f32;
        mean.iter_mut().for_each(|sum| *sum /= count);
        if elites.len() < 2 {
            return;
        }
        spread.fill(0.0);
        for plan in plans() {
            for ((sum, value), mean) in spread.iter_mut().zip(plan).zip(&*mean) {
                *sum += (value - mean) * (value - mean);
            }
        }
        let floor = self.sigma_min as f32;
        spread.iter_mut().for_each(|sum| *sum = (*sum / (count - 1.0)).sqrt().max(floor));
    }
}

/// The elites (in ascending order of cost) whose cost is finite; there is at least one.
fn finite<'a>(costs: &[f64], elites: &'a [u32]) -> &'a [u32] {
    let count = elites.partition_point(|&elite| costs[elite as usize].is_finite());
    &elites[..count]
}
