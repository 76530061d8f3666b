//! Gaussian noise, drawn anew at every step.

use rand::RngExt as _;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;
use swm_core::view::Frame;

use super::{Distractor, Schedule, byte, within};

/// Adds noise of deviation `std` to every channel.
#[derive(Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Noise {
    std: f64,
    schedule: Schedule,
    end: f64,
    horizon: u64,
    decay: f64,
    truncate: bool,
}

impl Default for Noise {
    fn default() -> Self {
        Self { std: 10.0, schedule: Schedule::Constant, end: 0.0, horizon: 50, decay: 0.95, truncate: false }
    }
}

impl Distractor for Noise {
    const NAME: &'static str = "noise";
    const SUMMARY: &'static str = "Gaussian noise on every channel, new at every step";
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "std", doc: "standard deviation in bytes, at the start", default: "10.0" },
        Setting {
            name: "schedule",
            doc: "how it changes: constant, linear, cosine, exponential, sinusoidal",
            default: "constant",
        },
        Setting { name: "end", doc: "where the schedule goes", default: "0.0" },
        Setting { name: "horizon", doc: "steps of the schedule", default: "50" },
        Setting { name: "decay", doc: "factor per step of the exponential schedule", default: "0.95" },
        Setting { name: "truncate", doc: "cut numbers off, as the reference does", default: "false" },
    ];

    fn check(&self) -> Result<(), String> {
        within("std", self.std, 0.0, 1e4)?;
        within("end", self.end, 0.0, 1e4)?;
        within("decay", self.decay, 0.0, 1.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let std = self.schedule.at(frame.step, self.std, self.end, self.horizon, self.decay) as f32;
        if std <= 0.0 {
            return;
        }
        let mut rng = frame.of_step("distractor noise");
        for value in &mut *frame.pixels {
            let z: f32 = rng.sample(StandardNormal);
            *value = byte(f32::from(*value) + std * z, self.truncate);
        }
    }
}
