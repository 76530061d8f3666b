//! How weights change: AdamW, the clipping of gradients, the schedule of the learning rate.
//!
//! The state of an optimizer is values by name, so that a training can be stored and resumed exactly.

mod adamw;
mod gradients;
mod joined;
mod schedule;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use adamw::AdamW;
pub use gradients::{Gradients, Norm};
pub use schedule::Schedule;

/// Values that a thread of the host takes at a time.
const PART: usize = 1 << 16;

/// Settings of AdamW. The defaults are LeWM's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OptimConfig {
    /// The highest learning rate.
    pub lr: f64,
    /// Decay of the weights, decoupled from the gradient; times the learning rate.
    pub weight_decay: f64,
    /// Shares of the past in the averages of gradients and of their squares.
    pub betas: [f64; 2],
    /// Beside the square root that the step is divided by.
    pub epsilon: f64,
    /// The greatest norm of all gradients together; `None`: any.
    pub clip: Option<f64>,
    /// How the learning rate changes over a training.
    pub schedule: Schedule,
    /// Decay of an exponential moving average (EMA) of the weights, which is what is validated, saved and used; 0: none. It
    /// grows to this value from the first step on, as (1 + step) / (10 + step).
    pub ema: f64,
}

impl OptimConfig {
    /// The decay of the average of weights after step `step` of a phase; `None`: there is none.
    pub fn ema_at(&self, step: u64) -> Option<f64> {
        let growing = (1 + step) as f64 / (10 + step) as f64;
        (self.ema > 0.0).then(|| self.ema.min(growing))
    }

    /// What is wrong with it, if anything is.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(&self) -> Result<(), String> {
        let Self { lr, weight_decay, betas, epsilon, clip, schedule, ema } = self;
        let above_zero = |name: &str, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(format!("`optim.{name}` is {value}; it must be above 0")),
        };
        let in_unit = |name: &str, value: f64| match (0.0..=1.0).contains(&value) {
            true => Ok(()),
            false => Err(format!("`optim.{name}` is {value}; it must be in [0, 1]")),
        };
        above_zero("lr", *lr)?;
        above_zero("epsilon", *epsilon)?;
        clip.map_or(Ok(()), |clip| above_zero("clip", clip))?;
        in_unit("weight_decay", *weight_decay)?;
        if !(0.0..1.0).contains(ema) {
            return Err(format!("`optim.ema` is {ema}; it must be in [0, 1)"));
        }
        if let Some(beta) = betas.iter().find(|beta| !(0.0..1.0).contains(*beta)) {
            return Err(format!("`optim.betas` holds {beta}; each must be in [0, 1)"));
        }
        match schedule {
            Schedule::Constant => Ok(()),
            Schedule::WarmUpCosine { warm_up } => in_unit("schedule.warm_up_cosine.warm_up", *warm_up),
        }
    }
}

impl Default for OptimConfig {
    fn default() -> Self {
        Self {
            lr: 5e-5,
            weight_decay: 1e-3,
            betas: [0.9, 0.999],
            epsilon: 1e-8,
            clip: Some(1.0),
            schedule: Schedule::default(),
            ema: 0.0,
        }
    }
}
