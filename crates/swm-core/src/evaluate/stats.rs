//! How sure one can be: intervals for proportions, tests for pairs, bootstrap over pairs.

use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use crate::moments::Moments;
use crate::seed::keyed;

/// The 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// The 95 % Wilson score interval of a proportion, in percent: `[low, high]`. Without trials: `[0, 100]`.
///
/// Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927);
/// it keeps its coverage near 0 and 1 and for few trials, where the normal interval does not.
pub fn wilson95(successes: usize, trials: usize) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 100.0];
    }
    let n = trials as f64;
    let p = successes as f64 / n;
    let center = p + Z * Z / (2.0 * n);
    let half_width = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 100.0 / (1.0 + Z * Z / n);
    // At the ends the bound is exact, and rounding must not move it.
    let low = if successes == 0 { 0.0 } else { scale * (center - half_width) };
    let high = if successes == trials { 100.0 } else { scale * (center + half_width) };
    [low, high]
}

/// Two policies on the same episodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PairedTest {
    /// Episodes.
    pub pairs: usize,
    /// Both succeed.
    pub both: usize,
    /// Only the first succeeds.
    pub only_first: usize,
    /// Only the second succeeds.
    pub only_second: usize,
    /// Success rate of the first minus that of the second, in percentage points.
    pub difference: f64,
    /// Its 95 % interval.
    pub interval95: [f64; 2],
    /// Two-sided p-value of the exact McNemar test: how often equal policies would differ by as much.
    pub p_value: f64,
}

impl PairedTest {
    /// Compares successes, `[n]` each; what only the longer one has is left out.
    pub fn of(first: &[bool], second: &[bool]) -> Self {
        let count = |wanted: [bool; 2]| first.iter().zip(second).filter(|&(&a, &b)| [a, b] == wanted).count();
        let (only_first, only_second) = (count([true, false]), count([false, true]));
        let pairs = first.len().min(second.len());
        let both = count([true, true]);
        Self {
            pairs,
            both,
            only_first,
            only_second,
            difference: 100.0 * (only_first as f64 - only_second as f64) / pairs.max(1) as f64,
            interval95: paired_interval95(both, only_first, only_second, pairs),
            p_value: mcnemar_exact(only_first, only_second),
        }
    }
}

/// The two-sided p-value of the exact McNemar test of `b` against `c` discordant pairs: twice the smaller tail of a fair
/// binomial, at most 1.
///
/// Source: Q. McNemar, "Note on the sampling error of the difference between correlated proportions or percentages",
/// Psychometrika 12 (1947); the exact form needs no large counts.
pub fn mcnemar_exact(b: usize, c: usize) -> f64 {
    let (n, k) = (b + c, b.min(c));
    // Terms C(n, i) / 2^n by recursion on their logarithms, which do not underflow.
    let mut log_term = -(n as f64) * std::f64::consts::LN_2;
    let mut tail = log_term.exp();
    for i in 0..k {
        log_term += ((n - i) as f64).ln() - ((i + 1) as f64).ln();
        tail += log_term.exp();
    }
    (2.0 * tail).min(1.0)
}

/// The 95 % interval of the difference of two proportions of the same pairs, in percentage points.
///
/// Source: R. G. Newcombe, "Improved confidence intervals for the difference between binomial proportions based on paired
/// data", Statistics in Medicine 17 (1998), method 10: Wilson intervals of the two, joined by their correlation.
pub fn paired_interval95(both: usize, only_first: usize, only_second: usize, pairs: usize) -> [f64; 2] {
    if pairs == 0 {
        return [-100.0, 100.0];
    }
    let (e, f, g) = (both as f64, only_first as f64, only_second as f64);
    let n = pairs as f64;
    let h = n - e - f - g;
    let (first, second) = ((e + f) / n, (e + g) / n);
    let [low1, high1] = wilson95(both + only_first, pairs).map(|x| x / 100.0);
    let [low2, high2] = wilson95(both + only_second, pairs).map(|x| x / 100.0);
    // Counts are small integers: the product is zero exactly where a margin is empty.
    let margins = (e + f) * (g + h) * (e + g) * (f + h);
    let numerator = e * h - f * g;
    let corrected = if numerator > n / 2.0 {
        numerator - n / 2.0
    } else if numerator >= 0.0 {
        0.0
    } else {
        numerator
    };
    let phi = if margins == 0.0 { 0.0 } else { corrected / margins.sqrt() };
    let reach = |a: f64, b: f64| (a * a - 2.0 * phi * a * b + b * b).max(0.0).sqrt();
    let difference = first - second;
    let low = difference - reach(first - low1, high2 - second);
    let high = difference + reach(high1 - first, second - low2);
    [100.0 * low.max(-1.0), 100.0 * high.min(1.0)]
}

/// The 95 % interval of the mean success rate of several runs on the same episodes, in percent: episodes are sampled with
/// repetition, each with all of its runs (they are not independent). `runs[r][i]`: run r, episode i.
///
/// Source: B. Efron, "Bootstrap methods: another look at the jackknife", Annals of Statistics 7 (1979), with percentiles;
/// samples are keyed, so that the same runs give the same interval.
pub fn bootstrap95(runs: &[&[bool]], seed: u64) -> [f64; 2] {
    const SAMPLES: usize = 10_000;
    let episodes = runs.iter().map(|run| run.len()).min().unwrap_or(0);
    if episodes == 0 {
        return [0.0, 100.0];
    }
    let per_episode: Vec<f64> = (0..episodes)
        .map(|episode| 100.0 * runs.iter().filter(|run| run[episode]).count() as f64 / runs.len() as f64)
        .collect();
    let mut rng = keyed(seed, "bootstrap", [episodes as u64, runs.len() as u64]);
    let means = (0..SAMPLES)
        .map(|_| {
            let sampled = (0..episodes).map(|_| per_episode[rng.random_range(0..episodes)]);
            sampled.sum::<f64>() / episodes as f64
        })
        .collect();
    percentiles95(means)
}

/// The 2.5 % and the 97.5 % quantile of samples, of which there is at least one.
pub(super) fn percentiles95(mut samples: Vec<f64>) -> [f64; 2] {
    samples.sort_by(f64::total_cmp);
    let at = |part: f64| samples[((samples.len() - 1) as f64 * part).round() as usize];
    [at(0.025), at(0.975)]
}

/// Mean and sample standard deviation; no std for fewer than two values.
pub fn mean_and_std(values: &[f64]) -> (f64, Option<f64>) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n.max(1.0);
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (mean, (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()))
}

/// Spearman's rank correlation, with mean ranks for ties; `None` if one side is constant or there are fewer than two.
///
/// Source: C. Spearman, "The proof and measurement of association between two things", 1904.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    correlation(&ranks(a), &ranks(b))
}

/// Pearson's correlation; `None` if one side is constant or there are fewer than two.
pub fn correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    let ((mean_a, _), (mean_b, _)) = (mean_and_std(a), mean_and_std(b));
    let sums = a.iter().zip(b).fold([0.0; 3], |[ab, aa, bb], (&x, &y)| {
        let (x, y) = (x - mean_a, y - mean_b);
        [ab + x * y, aa + x * x, bb + y * y]
    });
    let [ab, aa, bb] = sums;
    // Rounding of its mean leaves a constant a spread of its last digits.
    let varies = |values: &[f64]| !values.iter().copied().collect::<Moments>().is_constant();
    (n > 1 && varies(a) && varies(b)).then(|| (ab / (aa * bb).sqrt()).clamp(-1.0, 1.0))
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    while start < order.len() {
        let same = order[start..].iter().take_while(|&&i| values[i] == values[order[start]]).count().max(1);
        let rank = start as f64 + (same as f64 + 1.0) / 2.0;
        order[start..start + same].iter().for_each(|&i| ranks[i] = rank);
        start += same;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: [f64; 2], expected: [f64; 2], tolerance: f64) {
        let close = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < tolerance);
        assert!(close, "{found:?} is not {expected:?}");
    }

    #[test]
    fn wilson_meets_published_values() {
        // 45 of 50: 78.6 to 95.7 %, a value often quoted for this protocol.
        near(wilson95(45, 50), [78.64, 95.65], 0.01);
        near(wilson95(25, 50), [36.64, 63.36], 0.01);
        near(wilson95(90, 100), [82.56, 94.48], 0.01);
        near(wilson95(0, 10), [0.0, 27.75], 0.01);
        assert_eq!(wilson95(25, 25)[1], 100.0);
        assert_eq!(wilson95(0, 0), [0.0, 100.0]);
    }

    #[test]
    fn mcnemar_is_the_exact_binomial_test() {
        for (b, c, p) in [(8, 2, 0.109375), (10, 0, 0.001953125), (5, 5, 1.0), (6, 0, 0.03125), (0, 0, 1.0)] {
            assert!((mcnemar_exact(b, c) - p).abs() < 1e-12, "{b} {c}: {}", mcnemar_exact(b, c));
            assert!((mcnemar_exact(c, b) - p).abs() < 1e-12);
        }
        // 2 * Binomial(2000, 1/2).cdf(900), by exact integers: thousands of pairs neither underflow nor drift.
        assert!((mcnemar_exact(900, 1100) / 8.457_089_535_5e-6 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn paired_intervals_meet_newcombe() {
        // Table III of the paper, first example (36, 12, 2, 0): 0.0569 to 0.3404.
        near(paired_interval95(36, 12, 2, 50), [5.69, 34.04], 0.01);
        let [low, high] = paired_interval95(10, 0, 0, 20);
        assert!((low + high).abs() < 1e-9 && low < 0.0, "equal policies: {low} {high}");
        let (a, b) = (paired_interval95(5, 9, 1, 30), paired_interval95(5, 1, 9, 30));
        near([-b[1], -b[0]], a, 1e-9);
        assert_eq!(paired_interval95(0, 0, 0, 0), [-100.0, 100.0]);
    }

    #[test]
    fn paired_tests_count() {
        let test = PairedTest::of(&[true, true, true, false], &[true, false, false, true]);
        assert_eq!((test.both, test.only_first, test.only_second, test.difference), (1, 2, 1, 25.0));
        assert_eq!(test.p_value, 1.0);
    }

    #[test]
    fn bootstrap_agrees_with_theory_and_repeats() {
        let run: Vec<bool> = (0..400).map(|i| i % 4 == 0).collect();
        let found = bootstrap95(&[&run], 1);
        // 25 % ± 1.96 × 100 √(0.25 × 0.75 / 400) %.
        near(found, [20.757, 29.243], 0.5);
        assert_eq!(found, bootstrap95(&[&run], 1));
        // The same run three times is no more evidence than once.
        near(bootstrap95(&[&run, &run, &run], 1), found, 0.6);
    }

    #[test]
    fn correlations_meet_known_values() {
        // Spearman's rho without ties is 1 - 6 Σd² / (n (n² - 1)): here Σd² = 194 of n = 10.
        let iq = [106.0, 86.0, 100.0, 101.0, 99.0, 103.0, 97.0, 113.0, 112.0, 110.0];
        let hours = [7.0, 0.0, 27.0, 50.0, 28.0, 29.0, 20.0, 12.0, 6.0, 17.0];
        assert!((rank_correlation(&iq, &hours).unwrap() + 29.0 / 165.0).abs() < 1e-12);
        assert_eq!(ranks(&[1.0, 2.0, 2.0, 5.0]), [1.0, 2.5, 2.5, 4.0]);
        assert_eq!(correlation(&[1.0, 1.0], &[1.0, 2.0]), None);
    }
}
