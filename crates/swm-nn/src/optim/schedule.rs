//! The learning rate over a training.

use serde::{Deserialize, Serialize};

/// How the learning rate changes, step by step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Schedule {
    /// Not at all.
    Constant,
    /// Up in a line from a hundredth, then down to zero along a cosine.
    WarmUpCosine {
        /// The share of all steps that goes up.
        warm_up: f64,
    },
}

impl Schedule {
    /// Down to zero along a cosine from the first step: the default of the reference's trainer.
    pub const COSINE: Self = Schedule::WarmUpCosine { warm_up: 0.0 };
}

impl Default for Schedule {
    /// The reference's: up over 1 % of the steps.
    fn default() -> Self {
        Schedule::WarmUpCosine { warm_up: 0.01 }
    }
}

/// What the learning rate begins with, as a share of the highest. The reference's begins with 0: its first step changes nothing.
const START: f64 = 0.01;

impl Schedule {
    /// The factor of the learning rate in step `step` of `total`, both counted from 0.
    pub fn factor(self, step: u64, total: u64) -> f64 {
        let Schedule::WarmUpCosine { warm_up } = self else { return 1.0 };
        let peak = (warm_up * total as f64).floor() as u64;
        if step < peak {
            return START + (1.0 - START) * step as f64 / peak as f64;
        }
        let progress = (step - peak) as f64 / total.saturating_sub(peak).max(1) as f64;
        0.5 * (1.0 + (std::f64::consts::PI * progress.min(1.0)).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_goes_up_in_a_line_and_down_along_a_cosine() {
        let factor = |step| Schedule::WarmUpCosine { warm_up: 0.1 }.factor(step, 1000);
        assert!((factor(0) - 0.01).abs() < 1e-12);
        assert!((factor(50) - 0.505).abs() < 1e-12);
        assert!((factor(100) - 1.0).abs() < 1e-12);
        assert!((factor(550) - 0.5).abs() < 1e-12);
        assert!(factor(1000).abs() < 1e-12);
        assert!((Schedule::default().factor(0, 10) - 1.0).abs() < 1e-12, "nothing to warm up in ten steps");
        assert!(
            [(0, 1.0), (5, 0.5), (10, 0.0)]
                .iter()
                .all(|&(step, wanted)| { (Schedule::COSINE.factor(step, 10) - wanted).abs() < 1e-12 })
        );
    }
}
