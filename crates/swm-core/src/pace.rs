//! How finely work on rows is divided among threads: not at all where a hand-over costs more than the work.
//!
//! The cost of a row is learnt from the clock. It decides who works, never what comes out.

use std::time::Instant;

/// Work below this many nanoseconds is not worth handing to another thread.
const WORTH_NANOS: f64 = 15_000.0;
/// Weight of the newest measurement.
const LEARNING: f64 = 0.2;

/// The learnt cost of one row of a phase.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    nanos_per_row: f64,
}

impl Default for Pace {
    /// Takes rows for dear until it knows better.
    fn default() -> Self {
        Self { nanos_per_row: WORTH_NANOS }
    }
}

impl Pace {
    /// Does `work` on `rows` rows, divided into leaves of the given number of rows, and learns from how long it took.
    pub(crate) fn learn<R>(&mut self, rows: usize, work: impl FnOnce(usize) -> R) -> R {
        let leaf = ((WORTH_NANOS / self.nanos_per_row).ceil() as usize).clamp(1, rows.max(1));
        let started = Instant::now();
        let result = work(leaf);
        let threads = rayon::current_num_threads().min(rows.div_ceil(leaf)).max(1);
        let nanos = started.elapsed().as_nanos() as f64 * threads as f64 / rows.max(1) as f64;
        self.nanos_per_row += LEARNING * (nanos.max(1.0) - self.nanos_per_row);
        result
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn cheap_rows_stay_together_and_dear_rows_part() {
        let mut pace = Pace::default();
        let mut leaf = 0;
        for _ in 0..100 {
            pace.learn(8, |rows| leaf = rows);
        }
        assert_eq!(leaf, 8);
        for _ in 0..40 {
            pace.learn(8, |rows| {
                leaf = rows;
                std::thread::sleep(Duration::from_millis(1));
            });
        }
        assert_eq!(leaf, 1);
    }
}
