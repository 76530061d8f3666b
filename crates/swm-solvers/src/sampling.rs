//! Keyed noise, and the selection of the cheapest samples.

use rand_distr::{Distribution as _, StandardNormal};
use swm_core::seed::Stream;

use crate::problem::PlanKey;

/// Noise, keyed by its purpose: no value depends on which others were sampled.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Its purpose, usually the solver's name: two solvers see different noise.
    pub purpose: &'static str,
    /// The planner's own seed, to repeat an experiment with other noise on the same episodes.
    pub seed: u32,
}

impl Noise {
    /// The generator of one iteration of one plan: one thread samples from it from first to last candidate, so that the values
    /// of a candidate do not depend on how many follow it. A generator for each candidate would cost more than the values.
    pub fn stream(&self, key: &PlanKey, iteration: u32) -> Stream {
        self.stream_of(key, iteration, 0)
    }

    /// Fills `out` with the normal noise of one sample of one iteration of one plan, for samples that are generated in parallel.
    pub fn fill(&self, key: &PlanKey, iteration: u32, sample: u32, out: &mut [f32]) {
        fill_normal(&mut self.stream_of(key, iteration, sample), out);
    }

    fn stream_of(&self, key: &PlanKey, iteration: u32, sample: u32) -> Stream {
        // Plans are counted from 0 per episode, far below 2^32; seed and count share a word of the key.
        let plan = u64::from(self.seed) << 32 | key.plan;
        let sample = u64::from(iteration) << 32 | u64::from(sample);
        key.seed.indexed(self.purpose, [plan, sample])
    }
}

/// Fills `out` with normal noise, the next of `stream`.
pub(crate) fn fill_normal(stream: &mut Stream, out: &mut [f32]) {
    for value in out {
        *value = StandardNormal.sample(stream);
    }
}

/// `value`, or the bound that it is beyond. NaN stays NaN, to be found and not hidden.
pub fn clip(value: f32, low: f32, high: f32) -> f32 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}

/// Replaces costs that are not finite by infinity and returns how many there were.
pub fn count_non_finite(costs: &mut [f64]) -> u64 {
    let mut count = 0;
    for cost in costs {
        if !cost.is_finite() {
            *cost = f64::INFINITY;
            count += 1;
        }
    }
    count
}

/// The `count` cheapest of `costs` in ascending order, written to the front of `order` (as long as `costs`); of
/// equal costs the lower index comes first. `costs` holds no NaN.
pub fn cheapest<'a>(costs: &[f64], count: usize, order: &'a mut [u32]) -> &'a [u32] {
    for (index, slot) in (0..).zip(order.iter_mut()) {
        *slot = index;
    }
    let by_cost = |a: &u32, b: &u32| {
        let (x, y) = (costs[*a as usize], costs[*b as usize]);
        x.total_cmp(&y).then(a.cmp(b))
    };
    if count < order.len() {
        order.select_nth_unstable_by(count, by_cost);
    }
    order[..count].sort_unstable_by(by_cost);
    &order[..count]
}

/// Mean and unbiased standard deviation, `[H, D]` each, of the candidates `elites` (1 or more); a single one leaves
/// `std` as it is.
pub(crate) fn fit_gaussian(candidates: &[f32], elites: &[u32], mean: &mut [f32], std: &mut [f32]) {
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
    std.fill(0.0);
    for plan in plans() {
        for ((sum, value), mean) in std.iter_mut().zip(plan).zip(&*mean) {
            *sum += (value - mean) * (value - mean);
        }
    }
    std.iter_mut().for_each(|sum| *sum = (*sum / (count - 1.0)).sqrt());
}

#[cfg(test)]
mod tests {
    use swm_core::EpisodeSeed;

    use super::*;

    #[test]
    fn ties_go_to_the_lower_index() {
        let costs = [2.0, 1.0, f64::INFINITY, 1.0, 1.0, 0.5];
        let mut order = [0; 6];
        assert_eq!(cheapest(&costs, 3, &mut order), [5, 1, 3]);
        assert_eq!(cheapest(&costs, 6, &mut order), [5, 1, 3, 4, 0, 2]);
    }

    #[test]
    fn every_part_of_the_key_changes_the_noise() {
        let noise = |purpose, seed, episode_seed, plan, iteration, sample| {
            let key = PlanKey { episode: 0, seed: EpisodeSeed::new(episode_seed), plan };
            let mut out = [0.0];
            Noise { purpose, seed }.fill(&key, iteration, sample, &mut out);
            out[0]
        };
        let base = noise("a", 1, 2, 3, 4, 5);
        assert_eq!(base, noise("a", 1, 2, 3, 4, 5));
        for other in [
            noise("b", 1, 2, 3, 4, 5),
            noise("a", 0, 2, 3, 4, 5),
            noise("a", 1, 0, 3, 4, 5),
            noise("a", 1, 2, 0, 4, 5),
            noise("a", 1, 2, 3, 0, 5),
            noise("a", 1, 2, 3, 4, 0),
        ] {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn unusable_costs_are_infinite_and_counted() {
        let mut costs = [1.0, f64::NAN, f64::NEG_INFINITY, f64::INFINITY];
        assert_eq!(count_non_finite(&mut costs), 3);
        assert_eq!(costs, [1.0, f64::INFINITY, f64::INFINITY, f64::INFINITY]);
    }
}
