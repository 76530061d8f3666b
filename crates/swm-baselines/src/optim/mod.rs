//! How weights change: AdamW, the clipping of gradients, the schedule of the learning rate, teachers that follow.
//!
//! The state of an optimiser is numbers by name, so that a training can be stored and resumed exactly.

mod adamw;
mod schedule;

use serde::{Deserialize, Serialize};

pub(crate) use adamw::{AdamW, Gradients, clip_gradients};
pub use schedule::Schedule;

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
        }
    }
}
