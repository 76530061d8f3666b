//! Rows per second, and the times of messages in nanoseconds that stand for them.

use swm_core::Metadata;

/// The time from one row to the next in nanoseconds.
pub(super) fn period_ns(rows_per_second: f64) -> u64 {
    (1e9 / rows_per_second).round().max(1.0) as u64
}

/// The record of a run whose messages follow each other after so many nanoseconds: its own rate, up to rounding, unless another was
/// asked for when it was written.
pub(super) fn at_rate(run: Metadata, row_ns: u64) -> Metadata {
    let exact = 1e9 / row_ns.max(1) as f64;
    // A period is rounded to whole nanoseconds; people ask for 30 or 29.97.
    let asked = (exact * 1e3).round() / 1e3;
    let of_messages = if period_ns(asked) == row_ns { asked } else { exact };
    let rate = |own| if period_ns(own) == row_ns { own } else { of_messages };
    Metadata { rows_per_second: run.rows_per_second.map(rate), ..run }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_is_not_that_of_the_messages_is_corrected() {
        let said = |own, row_ns| {
            at_rate(Metadata { rows_per_second: own, ..Metadata::default() }, row_ns).rows_per_second
        };
        for rate in [30.0, 29.97, 10.0, 0.5] {
            assert_eq!(said(Some(7.0), period_ns(rate)), Some(rate));
        }
        assert_eq!(said(Some(1.0 / 0.03), 30_000_000), Some(1.0 / 0.03));
        assert_eq!(said(None, 30_000_000), None);
        assert!(said(Some(10.0), 0).is_some_and(f64::is_finite));
    }
}
