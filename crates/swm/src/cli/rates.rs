//! Rates of success, and what sets two of them apart, as people read them.

use swm_core::evaluate::Summary;

/// `61.0 % (55.1 to 66.6)`.
pub(super) fn rate(summary: &Summary) -> String {
    percent(summary.success_rate, summary.ci95)
}

/// As [`rate`], of a rate and its interval.
pub(super) fn percent(rate: f64, [low, high]: [f64; 2]) -> String {
    format!("{rate:.1} % ({low:.1} to {high:.1})")
}

/// `+3.0 (-1.2 to +7.1)` and `p = 0.0313`: a difference of two rates with its interval, and the test of it.
pub(super) fn difference(points: f64, [low, high]: [f64; 2], p: f64) -> [String; 2] {
    [format!("{points:+.1} ({low:+.1} to {high:+.1})"), p_value(p)]
}

/// A p-value that is not shown as 0.
fn p_value(p: f64) -> String {
    // Halves go up, and what differs from one by the error of its computation counts as one: 0.03125 is 0.0313 from all tests.
    let rounded = ((p * 1e8).round() / 1e4).round() / 1e4;
    if p < 0.0001 { "p < 0.0001".to_owned() } else { format!("p = {rounded:.4}") }
}

/// ` (3 with success at reset, which counts for every policy)`.
pub(super) fn at_reset(solved: usize) -> String {
    match solved {
        0 => " (0 with success at reset)".to_owned(),
        solved => format!(" ({solved} with success at reset, which counts for every policy)"),
    }
}

#[cfg(test)]
mod tests {
    use super::p_value;

    #[test]
    fn p_values_are_rounded_alike_whatever_computed_them() {
        for (p, text) in [(0.03125, "p = 0.0313"), (0.031_249_999_999_99, "p = 0.0313"), (1.0, "p = 1.0000")]
        {
            assert_eq!(p_value(p), text);
        }
        assert_eq!(p_value(0.000_01), "p < 0.0001");
    }
}
