//! Gaussian noise, drawn anew at every step.

use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::view::Frame;

use super::{Distractor, Schedule, byte, within};

swm_core::settings! {
    /// Adds Gaussian noise to every channel.
    pub(super) struct Noise {
        /// Standard deviation in bytes, at the start.
        std: f64 = 10.0,
        /// How it changes: constant, linear, cosine, exponential, sinusoidal.
        schedule: Schedule = Schedule::Constant => "constant",
        /// Value at the end of the schedule.
        end: f64 = 0.0,
        /// Steps of the schedule.
        horizon: u64 = 50,
        /// Factor per step of the exponential schedule.
        decay: f64 = 0.95,
        /// Truncate to bytes instead of rounding, as the reference does.
        truncate: bool = false,
    }
}

impl Distractor for Noise {
    const NAME: &'static str = "noise";
    const SUMMARY: &'static str = "Gaussian noise on every channel, new at every step";

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
