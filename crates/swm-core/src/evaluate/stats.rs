//! Intervals for success rates.

/// The 95 % Wilson score interval of a proportion, in percent: `[low, high]`. Without trials: `[0, 100]`.
///
/// Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927);
/// it keeps its coverage near 0 and 1 and for few trials, where the normal interval does not.
pub fn wilson95(successes: usize, trials: usize) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 100.0];
    }
    // The 97.5 % quantile of the standard normal distribution.
    const Z: f64 = 1.959_963_984_540_054;
    let n = trials as f64;
    let p = successes as f64 / n;
    let centre = p + Z * Z / (2.0 * n);
    let spread = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 100.0 / (1.0 + Z * Z / n);
    // At the ends the bound is exact, and rounding must not move it.
    let low = if successes == 0 { 0.0 } else { scale * (centre - spread) };
    let high = if successes == trials { 100.0 } else { scale * (centre + spread) };
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_meets_published_values() {
        // 45 of 50: 78.6 to 95.7 %, a value often quoted for this protocol.
        let [low, high] = wilson95(45, 50);
        assert!((low - 78.64).abs() < 0.01 && (high - 95.65).abs() < 0.01, "{low} {high}");
        let [low, high] = wilson95(0, 10);
        assert!(low == 0.0 && (high - 27.75).abs() < 0.01, "{high}");
        assert_eq!(wilson95(25, 25)[1], 100.0);
        assert_eq!(wilson95(0, 0), [0.0, 100.0]);
    }
}
