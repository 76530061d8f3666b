//! Two policies with several runs each (seeds of their own noise) on the same pairs: one difference, one interval, one p-value.

use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use super::stats::{PairedTest, percentiles95};
use crate::seed::keyed;

/// All runs of one policy against all runs of another, on the same pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PairedRuns {
    /// Pairs of start and goal.
    pub pairs: usize,
    /// Runs of the first and of the second policy.
    pub runs: [usize; 2],
    /// Mean success rate of the first minus that of the second, in percentage points.
    pub difference: f64,
    /// Its 95 % interval: Newcombe's for one run each, else a bootstrap over pairs and over the runs of each side.
    pub interval95: [f64; 2],
    /// Two-sided p-value of the exact sign-flip test over pairs. For one run each it is that of the exact McNemar test.
    pub p_value: f64,
}

impl PairedRuns {
    /// Compares successes: `first[r][i]` is run r, pair i. What only longer runs have is left out. `None` if a side has no
    /// run.
    pub fn of(first: &[&[bool]], second: &[&[bool]], seed: u64) -> Option<Self> {
        let pairs = first.iter().chain(second).map(|run| run.len()).min()?;
        let runs = [first.len(), second.len()];
        if runs.contains(&0) {
            return None;
        }
        let differences = differences(first, second, pairs);
        let scale = 100.0 / (runs[0] * runs[1] * pairs.max(1)) as f64;
        let interval95 = match (first, second) {
            ([a], [b]) => PairedTest::of(a, b).interval95,
            _ => bootstrap95(first, second, pairs, seed),
        };
        Some(Self {
            pairs,
            runs,
            difference: differences.iter().sum::<i64>() as f64 * scale,
            interval95,
            p_value: sign_flip_exact(&differences),
        })
    }
}

/// By how much the first is ahead in each pair: difference of success rates × runs of the first × runs of the second, which
/// is an integer.
fn differences(first: &[&[bool]], second: &[&[bool]], pairs: usize) -> Vec<i64> {
    let wins = |runs: &[&[bool]], pair: usize| runs.iter().filter(|run| run[pair]).count() as i64;
    let (a, b) = (first.len() as i64, second.len() as i64);
    (0..pairs).map(|pair| wins(first, pair) * b - wins(second, pair) * a).collect()
}

/// The two-sided p-value of the exact sign-flip test: how often the sum is as far from 0 as found, if every difference
/// had either sign by a fair coin. Which policy is called the first makes no difference where both are equal.
///
/// Source: R. A. Fisher, "The Design of Experiments" (1935), section 21. All 2ⁿ sums are counted, not sampled: those of
/// integers are few.
pub fn sign_flip_exact(differences: &[i64]) -> f64 {
    let found = differences.iter().sum::<i64>().unsigned_abs();
    // Twice the sum of those with a plus, less the total, is the sum: `chance[s]` is that the former is s.
    let mut chance = vec![1.0];
    for weight in differences.iter().map(|difference| difference.unsigned_abs() as usize) {
        if weight == 0 {
            continue;
        }
        let before = chance.len();
        chance.resize(before + weight, 0.0);
        for sum in (0..chance.len()).rev() {
            let without = if sum < before { chance[sum] } else { 0.0 };
            let with = if sum >= weight { chance[sum - weight] } else { 0.0 };
            chance[sum] = (without + with) / 2.0;
        }
    }
    let total = chance.len() as u64 - 1;
    let far = |plus: u64| (2 * plus).abs_diff(total) >= found;
    let p: f64 = (0..).zip(&chance).filter(|&(plus, _)| far(plus)).map(|(_, chance)| chance).sum();
    p.min(1.0)
}

/// The 95 % interval of the difference of mean success rates, in percentage points: pairs are sampled with repetition, and so
/// are the runs of each side; every sampled pair counts with all sampled runs.
///
/// Source: percentiles of a bootstrap over two crossed random effects (A. B. Owen, "The pigeonhole bootstrap", Annals of
/// Applied Statistics 1 (2007)). With few runs it is, if anything, too wide for the pairs and too narrow for the runs.
fn bootstrap95(first: &[&[bool]], second: &[&[bool]], pairs: usize, seed: u64) -> [f64; 2] {
    const SAMPLES: usize = 10_000;
    if pairs == 0 {
        return [-100.0, 100.0];
    }
    let runs = [first.len() as u64, second.len() as u64];
    let mut rng = keyed(seed, "bootstrap of runs", runs);
    let mut times = vec![0_u32; pairs];
    let found = (0..SAMPLES)
        .map(|_| {
            times.fill(0);
            (0..pairs).for_each(|_| times[rng.random_range(0..pairs)] += 1);
            let mut mean = |side: &[&[bool]]| {
                let sampled = side.iter().map(|_| {
                    let run = side[rng.random_range(0..side.len())];
                    let wins = run.iter().zip(&times).filter(|(win, _)| **win).map(|(_, times)| times);
                    f64::from(wins.sum::<u32>())
                });
                sampled.sum::<f64>() / (side.len() * pairs) as f64
            };
            100.0 * (mean(first) - mean(second))
        })
        .collect();
    percentiles95(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::stats::mcnemar_exact;

    fn run(wins: impl Fn(usize) -> bool, pairs: usize) -> Vec<bool> {
        (0..pairs).map(wins).collect()
    }

    #[test]
    fn one_run_each_is_mcnemar_and_newcombe() {
        let (a, b) = (run(|i| i < 45, 60), run(|i| (5..35).contains(&i), 60));
        let found = PairedRuns::of(&[&a], &[&b], 0).unwrap();
        let expected = PairedTest::of(&a, &b);
        assert!((found.p_value - expected.p_value).abs() < 1e-12, "{found:?} {expected:?}");
        assert_eq!((found.difference, found.interval95), (expected.difference, expected.interval95));
        for (plus, minus) in [(8, 2), (10, 0), (5, 5), (0, 0), (1, 0)] {
            let signs: Vec<i64> = [vec![1; plus], vec![-1; minus], vec![0; 7]].concat();
            assert!((sign_flip_exact(&signs) - mcnemar_exact(plus, minus)).abs() < 1e-12, "{plus} {minus}");
        }
    }

    #[test]
    fn all_sums_are_counted() {
        // Of the 16 sums of ±1 ±2 ±2 ±3, 2 are as far from 0 as 8, 4 as 6, and 8 as 4.
        let p = |differences: &[i64]| sign_flip_exact(differences);
        assert_eq!(p(&[1, 2, 2, 3]), 2.0 / 16.0);
        assert_eq!(p(&[-1, 2, 2, 3]), 4.0 / 16.0);
        assert_eq!(p(&[1, -2, 2, 3]), 8.0 / 16.0);
        assert_eq!(p(&[1, -2, 2, 3, 0]), p(&[-1, 2, -2, -3]));
    }

    #[test]
    fn every_run_counts() {
        // The first runs are equal; of the second ones, that of the first policy is better in 20 pairs.
        let (same, better) = (run(|i| i % 2 == 0, 40), run(|_| true, 40));
        let alone = PairedRuns::of(&[&same], &[&same], 0).unwrap();
        assert_eq!((alone.difference, alone.p_value), (0.0, 1.0));
        let both = PairedRuns::of(&[&same, &better], &[&same, &same], 0).unwrap();
        assert_eq!((both.pairs, both.runs, both.difference), (40, [2, 2], 25.0));
        assert!(both.p_value < 1e-5, "{}", both.p_value);
        let [low, high] = both.interval95;
        // A quarter of all samples of runs holds the good one twice, another never: 50 or 0 points.
        assert!(low <= 0.0 && (45.0..70.0).contains(&high), "{low} {high}");
        assert_eq!(both, PairedRuns::of(&[&same, &better], &[&same, &same], 0).unwrap());
        let turned = PairedRuns::of(&[&same, &same], &[&same, &better], 0).unwrap();
        assert_eq!((turned.difference, turned.p_value), (-25.0, both.p_value));
    }

    #[test]
    fn equal_runs_are_no_more_evidence_than_one() {
        let (a, b) = (run(|i| i % 4 != 0, 200), run(|i| i % 3 == 0, 200));
        let one = PairedRuns::of(&[&a], &[&b], 0).unwrap();
        let three = PairedRuns::of(&[&a, &a, &a], &[&b, &b], 0).unwrap();
        assert_eq!(one.difference, three.difference);
        assert!((one.p_value - three.p_value).abs() < 1e-12);
        let close = one.interval95.iter().zip(three.interval95).all(|(a, b)| (a - b).abs() < 1.5);
        assert!(close, "{:?} {:?}", one.interval95, three.interval95);
        assert!(PairedRuns::of(&[], &[&b], 0).is_none());
    }
}
