//! The figures of a trace: one record per episode, plan and iteration, and one per plan.
//!
//! Definitions follow the reference's callbacks, but records have fixed names, and one line is one episode: nothing is
//! reduced over episodes.

use serde::Serialize;

use super::Iteration;
use crate::problem::{Plan, PlanKey, Problem};

/// Figures of one iteration of one plan of one episode. `None` where the solver has no such figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct IterationRecord {
    /// Index of the episode in its run.
    pub episode: u64,
    /// How many plans the episode had before.
    pub plan: u64,
    /// Iteration, from 0.
    pub iteration: usize,
    /// Cost of the cheapest candidate; `None` if none has a finite cost.
    pub best: Option<f64>,
    /// Mean cost of the elites.
    pub elite_mean: Option<f64>,
    /// Mean cost of the candidates whose cost is finite.
    pub sample_mean: Option<f64>,
    /// How many candidates have no finite cost.
    pub non_finite: usize,
    /// Mean over H and D of the new standard deviation.
    pub mean_sigma: Option<f64>,
    /// Euclidean distance, over H and D, of the new mean from the one before; in iteration 0 from the plan that the
    /// search was given.
    pub mean_shift: Option<f64>,
    /// Mean over H and D of the elites' unbiased standard deviation; `None` for fewer than two elites.
    pub elite_std: Option<f64>,
    /// Fraction of all values of all candidates that lie on a bound of the action space or beyond; `None` for
    /// integers.
    pub clipped: Option<f64>,
    /// Mean over the candidates of the gradient's Euclidean norm over H and D, as evaluated.
    pub gradient_norm: Option<f64>,
    /// Mean over the candidates of the Euclidean norm over H and D.
    pub action_norm: f64,
}

/// The result of a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PlanRecord {
    /// Index of the episode in its run.
    pub episode: u64,
    /// How many plans the episode had before.
    pub plan: u64,
    /// Iterations made.
    pub iterations: u32,
    /// Cost of the plan itself; `None` if not finite.
    pub cost: Option<f64>,
    /// Mean cost of the last iteration's elites: what the reference reports as cost.
    pub elite_mean: Option<f64>,
    /// How many evaluated costs were not finite.
    pub non_finite: u64,
    /// The largest constraint value; `None` without constraints.
    pub violation: Option<f64>,
}

impl PlanRecord {
    /// The record of `episode` of a solve.
    pub fn of(key: &PlanKey, plan: &Plan, episode: usize) -> Self {
        Self {
            episode: key.episode,
            plan: key.plan,
            iterations: plan.iterations[episode],
            cost: finite(plan.cost_of_returned[episode]),
            elite_mean: finite(plan.elite_mean_last[episode]),
            non_finite: plan.non_finite[episode],
            violation: finite(plan.violation[episode]),
        }
    }
}

/// Computes [`IterationRecord`]s, from the bounds of the actions and the mean of the iteration before.
#[derive(Clone, Debug, Default)]
pub struct Records {
    /// `[B, H, D]`.
    previous: Vec<f32>,
    /// Bounds of one action; empty for integers.
    bounds: Vec<[f32; 2]>,
}

impl Records {
    /// A solve begins.
    pub fn begin(&mut self, problem: &Problem<'_>) {
        self.previous.clear();
        self.previous.extend_from_slice(problem.initial);
        self.bounds.clear();
        if let swm_core::Space::Box { low, high, .. } = problem.action {
            self.bounds.extend(low.iter().zip(high).map(|(&low, &high)| [low as f32, high as f32]));
        }
    }

    /// The records of an iteration: `[B]`, in the order of its episodes.
    pub fn of(&mut self, iteration: &Iteration<'_>) -> Vec<IterationRecord> {
        let episodes = 0..iteration.keys.len();
        let records = episodes.map(|episode| self.one(iteration, episode)).collect();
        if !iteration.mean.is_empty() {
            self.previous.clear();
            self.previous.extend_from_slice(iteration.mean);
        }
        records
    }

    fn one(&self, iteration: &Iteration<'_>, episode: usize) -> IterationRecord {
        let Iteration { candidates, keys, mean, std, gradient, .. } = *iteration;
        let size = candidates.horizon * candidates.dim;
        let of = |values| part(values, episode, size);
        let costs = iteration.costs_of(episode);
        let usable = || costs.iter().copied().filter(|cost| cost.is_finite());
        let elites = iteration.elites_of(episode);
        let cost_of = |&elite: &u32| costs[elite as usize];
        let plans: Vec<&[f32]> = iteration.candidates_of(episode).collect();
        let elite_plans: Vec<&[f32]> = elites.iter().map(|&elite| plans[elite as usize]).collect();
        let gradients =
            gradient.chunks_exact(size.max(1)).skip(episode * candidates.samples).take(plans.len());
        IterationRecord {
            episode: keys[episode].episode,
            plan: keys[episode].plan,
            iteration: iteration.number,
            best: usable().min_by(f64::total_cmp),
            elite_mean: average(elites.iter().map(cost_of)),
            sample_mean: average(usable()),
            non_finite: costs.len() - usable().count(),
            mean_sigma: average(of(std).iter().map(|&sigma| f64::from(sigma))),
            mean_shift: (!mean.is_empty()).then(|| distance(of(mean), of(&self.previous))),
            elite_std: average_std(&elite_plans),
            clipped: self.clipped(&plans),
            gradient_norm: average(gradients.map(norm)),
            action_norm: average(plans.iter().copied().map(norm)).unwrap_or(0.0),
        }
    }

    fn clipped(&self, plans: &[&[f32]]) -> Option<f64> {
        let beyond = |plan: &&[f32]| {
            let bounded = plan.iter().zip(self.bounds.iter().cycle());
            bounded.filter(|&(&value, &[low, high])| value <= low || value >= high).count() as f64
        };
        let size = plans.first()?.len() as f64;
        if self.bounds.is_empty() { None } else { average(plans.iter().map(|plan| beyond(plan) / size)) }
    }
}

/// The values of `episode` of `[B, size]`; empty if there are none at all.
fn part(values: &[f32], episode: usize, size: usize) -> &[f32] {
    if values.is_empty() { values } else { &values[episode * size..][..size] }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn average(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0usize, 0.0), |(count, sum), value| (count + 1, sum + value));
    (count > 0).then(|| sum / count as f64).and_then(finite)
}

fn norm(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>().sqrt()
}

fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>().sqrt()
}

/// The mean over H and D of the unbiased standard deviation of plans.
fn average_std(plans: &[&[f32]]) -> Option<f64> {
    if plans.len() < 2 {
        return None;
    }
    let std = |index: usize| {
        let values = || plans.iter().map(|plan| f64::from(plan[index]));
        let mean = values().sum::<f64>() / plans.len() as f64;
        (values().map(|value| (value - mean).powi(2)).sum::<f64>() / (plans.len() - 1) as f64).sqrt()
    };
    average((0..plans[0].len()).map(std))
}

#[cfg(test)]
mod tests {
    use swm_core::{Dtype, EpisodeSeed, Space};

    use super::*;

    /// Two episodes, three candidates each of one block of two values.
    #[test]
    fn figures_are_those_of_each_episode() {
        let key = |episode| PlanKey { episode, seed: EpisodeSeed::new(0), plan: 4 };
        let (keys, action) = ([key(7), key(8)], Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0));
        let problem = Problem {
            keys: &keys,
            horizon: 1,
            action_block: 1,
            action: &action,
            initial: &[0.0, 0.0, 3.0, 4.0],
            memory: &[],
        };
        let candidates = [3.0, 4.0, 0.0, 0.0, 0.5, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let iteration = Iteration {
            number: 2,
            keys: &keys,
            candidates: problem.candidates(&candidates, 3),
            costs: &[5.0, 1.0, 2.0, f64::INFINITY, 7.0, f64::INFINITY],
            elites: 2,
            mean: &[0.0, 2.0, 3.0, 4.0],
            std: &[0.5, 1.5, 1.0, 1.0],
            gradient: &[3.0, 4.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        };
        let mut records = Records::default();
        records.begin(&problem);
        let found = records.of(&iteration);
        let first = IterationRecord {
            episode: 7,
            plan: 4,
            iteration: 2,
            best: Some(1.0),
            elite_mean: Some(1.5),
            sample_mean: Some(8.0 / 3.0),
            non_finite: 0,
            mean_sigma: Some(1.0),
            mean_shift: Some(2.0),
            // Elites (0, 0) and (0.5, -1): half of the distance times the square root of two, in each value.
            elite_std: Some((0.125_f64.sqrt() + 0.5_f64.sqrt()) / 2.0),
            clipped: Some(0.5),
            gradient_norm: Some(2.0),
            action_norm: (5.0 + 1.25_f64.sqrt()) / 3.0,
        };
        assert_eq!(found[0], first);
        let second = &found[1];
        assert_eq!((second.episode, second.best, second.elite_mean), (8, Some(7.0), Some(7.0)));
        assert_eq!((second.sample_mean, second.non_finite, second.elite_std), (Some(7.0), 2, None));
        assert_eq!((second.mean_shift, second.clipped), (Some(0.0), Some(0.0)));

        let again = records.of(&Iteration { mean: &[], std: &[], gradient: &[], elites: 0, ..iteration });
        assert_eq!((again[0].mean_shift, again[0].mean_sigma, again[0].gradient_norm), (None, None, None));
        let same = records.of(&iteration);
        assert_eq!(same[0].mean_shift, Some(0.0), "measured from the mean of the iteration before");
    }
}
