//! A value that changes over the steps of an episode.

use serde::{Deserialize, Serialize};

/// How a value changes from `start` to `end`; formulas are the reference's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Schedule {
    /// `start` for ever.
    #[default]
    Constant,
    /// In a straight line, within `horizon` steps.
    Linear,
    /// Along half a cosine, within `horizon` steps.
    Cosine,
    /// By a factor of `decay` per step, to `end` at least.
    Exponential,
    /// To and fro between `start` and `end`, every `horizon` steps.
    Sinusoidal,
}

impl Schedule {
    /// The value at `step`.
    pub fn at(self, step: u64, start: f64, end: f64, horizon: u64, decay: f64) -> f64 {
        use std::f64::consts::{PI, TAU};
        let part = (step as f64 / horizon.max(1) as f64).min(1.0);
        match self {
            Schedule::Constant => start,
            Schedule::Linear => start + (end - start) * part,
            Schedule::Cosine => end + 0.5 * (start - end) * (1.0 + (PI * part).cos()),
            Schedule::Exponential => (start * decay.powf(step as f64)).max(end),
            Schedule::Sinusoidal => {
                let (middle, swing) = ((start + end) / 2.0, (end - start) / 2.0);
                middle + swing * (TAU * step as f64 / horizon.max(1) as f64).sin()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_meet_their_ends() {
        let at = |schedule: Schedule, step| schedule.at(step, 10.0, 2.0, 100, 0.9);
        assert_eq!(at(Schedule::Constant, 50), 10.0);
        assert_eq!(
            (at(Schedule::Linear, 0), at(Schedule::Linear, 50), at(Schedule::Linear, 900)),
            (10.0, 6.0, 2.0)
        );
        assert!(
            (at(Schedule::Cosine, 50) - 6.0).abs() < 1e-12 && (at(Schedule::Cosine, 100) - 2.0).abs() < 1e-12
        );
        assert!((at(Schedule::Exponential, 1) - 9.0).abs() < 1e-12 && at(Schedule::Exponential, 90) == 2.0);
        assert!((at(Schedule::Sinusoidal, 25) - 2.0).abs() < 1e-12);
    }
}
