//! Choosing the goal row of a clip, as the reference does: at random, later in the episode, or the present.

use rand::RngExt as _;
use swm_core::seed::keyed;

use super::options::{GoalOptions, GoalWeights};
use super::{Clip, wrong};
use crate::error::DataError;

/// Draws goals for clips of one dataset.
#[derive(Clone, Debug)]
pub(super) struct Goals {
    weights: GoalWeights,
    gamma: f64,
    seed: u64,
    frameskip: usize,
    /// From the start of a clip to its current row.
    current: usize,
    /// By episode, the row behind its last, counted over the whole dataset.
    ends: Vec<usize>,
}

impl Goals {
    /// Checks the options for a dataset with episodes of these lengths.
    pub(super) fn new(
        options: &GoalOptions,
        num_steps: usize,
        frameskip: usize,
        lengths: impl Iterator<Item = usize>,
    ) -> Result<Self, DataError> {
        let GoalWeights { random, geometric, uniform, current } = options.weights;
        let weights = [random, geometric, uniform, current];
        if weights.iter().any(|weight| !(0.0..=1.0).contains(weight))
            || (weights.iter().sum::<f64>() - 1.0).abs() > 1e-6
        {
            return wrong(
                "goals.weights",
                format!("{weights:?}; use four numbers of 0 or more that sum to 1"),
            );
        }
        if !(0.0..1.0).contains(&options.gamma) {
            return wrong("goals.gamma", format!("{}; use a number from 0 up to, but not, 1", options.gamma));
        }
        let offset = options.offset.unwrap_or(num_steps);
        let current = offset.checked_sub(1).and_then(|steps| steps.checked_mul(frameskip));
        let Some(current) = current.filter(|current| current.checked_add(frameskip).is_some()) else {
            return wrong("goals.offset", format!("{offset}; rows of a clip are counted from 1"));
        };
        let ends = lengths.scan(0, |end, len| {
            *end += len;
            Some(*end)
        });
        let ends = ends.collect();
        let GoalOptions { weights, gamma, seed, .. } = *options;
        Ok(Self { weights, gamma, seed, frameskip, current, ends })
    }

    /// Rows that an episode must have from the start of a clip on, so that the clip has the goals that may be drawn.
    pub(super) fn reach(&self) -> usize {
        let future = self.weights.geometric > 0.0 || self.weights.uniform > 0.0;
        self.current + 1 + if future { self.frameskip } else { 0 }
    }

    /// The episode and row of the goal of a clip, in this epoch.
    pub(super) fn draw(&self, epoch: u64, index: usize, clip: Clip) -> (usize, usize) {
        let mut rng = keyed(self.seed, "goals", [epoch, index as u64]);
        let GoalWeights { random, geometric, uniform, .. } = self.weights;
        let kind: f64 = rng.random();
        let before = clip.episode.checked_sub(1).map_or(0, |last| self.ends[last]);
        let len = self.ends[clip.episode] - before;
        let current = clip.start + self.current;
        let steps_left = (len - 1).saturating_sub(current) / self.frameskip;
        let ahead = |steps: usize| (clip.episode, current + steps.min(steps_left) * self.frameskip);
        if kind < random {
            let row = rng.random_range(0..self.ends.last().copied().unwrap_or(1));
            let episode = self.ends.partition_point(|&end| end <= row);
            (episode, row - episode.checked_sub(1).map_or(0, |last| self.ends[last]))
        } else if kind < random + geometric {
            ahead(geometric_draw(rng.random(), self.gamma))
        } else if kind < random + geometric + uniform {
            ahead(rng.random_range(1..=steps_left.max(1)))
        } else {
            (clip.episode, current)
        }
    }
}

/// The number of trials up to the first success of probability 1 − γ, at least 1, by inversion: the least k with
/// 1 − γᵏ > `uniform`.
fn geometric_draw(uniform: f64, gamma: f64) -> usize {
    let gamma = gamma.min(1.0 - 1e-6);
    // `as` saturates, and 0/0 (gamma 0) becomes 0.
    ((-uniform).ln_1p() / gamma.ln()).floor() as usize + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goals(weights: GoalWeights) -> Goals {
        let options = GoalOptions { weights, ..GoalOptions::default() };
        Goals::new(&options, 2, 3, [10, 4, 30].into_iter()).unwrap()
    }

    #[test]
    fn kinds_come_as_often_as_their_weights_say() {
        let only = |random, geometric, uniform, current| GoalWeights { random, geometric, uniform, current };
        let clip = Clip { episode: 2, start: 5 };
        let present = (2, 5 + 3);
        let all = goals(GoalWeights::default());
        assert_eq!(all.reach(), 7);
        let draws: Vec<_> = (0..20_000).map(|epoch| all.draw(epoch, 7, clip)).collect();
        let share = |wanted: &dyn Fn(&(usize, usize)) -> bool| {
            draws.iter().filter(|draw| wanted(draw)).count() as f64 / draws.len() as f64
        };
        // A random row is the present one once in 44 times, and in another episode 14 times.
        assert!((share(&|&draw| draw == present) - (0.2 + 0.3 / 44.0)).abs() < 0.01);
        assert!((share(&|&(episode, _)| episode != 2) - 0.3 * 14.0 / 44.0).abs() < 0.01);
        for future in [only(0.0, 1.0, 0.0, 0.0), only(0.0, 0.0, 1.0, 0.0)] {
            for epoch in 0..500 {
                let (episode, row) = goals(future).draw(epoch, 0, clip);
                assert!(episode == 2 && row > 8 && row < 30 && (row - 8) % 3 == 0, "{row}");
            }
        }
        assert_eq!(goals(only(0.0, 0.0, 0.0, 1.0)).reach(), 4);
    }

    #[test]
    fn geometric_draws_follow_their_distribution() {
        // P(k = 1) = 1 − γ, P(k ≤ 2) = 1 − γ².
        assert_eq!(geometric_draw(0.0, 0.9), 1);
        assert_eq!(geometric_draw(0.0999, 0.9), 1);
        assert_eq!(geometric_draw(0.1001, 0.9), 2);
        assert_eq!(geometric_draw(0.1901, 0.9), 3);
        assert_eq!(geometric_draw(0.5, 0.0), 1);
    }

    #[test]
    fn weights_that_are_no_distribution_are_refused() {
        let bad = GoalWeights { random: 0.9, ..GoalWeights::default() };
        let options = GoalOptions { weights: bad, ..GoalOptions::default() };
        let message = Goals::new(&options, 1, 1, [3].into_iter()).unwrap_err().to_string();
        assert!(message.contains("goals.weights") && message.contains("sum to 1"), "{message}");
    }
}
