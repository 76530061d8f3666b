//! How long to train, how often to look, and when to stop: what does not depend on the baseline.

use serde::{Deserialize, Serialize};

use crate::error::BaselineError;
use crate::precision::Precision;

/// Settings of [`super::fit`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Passes over the training clips, in each phase of the baseline.
    pub epochs: u64,
    /// Optimizer steps of each phase, in place of epochs.
    pub steps: Option<u64>,
    /// Clips per step; 0: as many as the preset says.
    pub batch: usize,
    /// Seed of everything: weights, order of clips, noise.
    pub seed: u64,
    /// Steps from one record to the next.
    pub log_every: u64,
    /// Steps from one validation and checkpoint to the next; 0: once per epoch.
    pub checkpoint_every: u64,
    /// Checkpoints that are kept; the best one is kept besides.
    pub keep: usize,
    /// Clips that validate, a random choice that is always the same; 0: all.
    pub validation_clips: usize,
    /// Training batches from which the running statistics of batch normalization are estimated anew before each validation
    /// and checkpoint, without dropout; 0: they are those that training gathers.
    pub norm_batches: usize,
    /// Stop when so many validations in a row were not better than the best; 0: never.
    pub patience: u64,
    /// Steps from one measurement of the model ([`super::Diagnosis`]) to the next, and there is one at the end; 0: never.
    #[serde(skip_serializing_if = "is_never")]
    pub quality_every: u64,
    /// The precision of linear layers and attention.
    #[serde(skip_serializing_if = "Precision::is_fp32")]
    pub precision: Precision,
}

/// Files need not name a default that came after them.
fn is_never(steps: &u64) -> bool {
    *steps == 0
}

impl Default for FitSettings {
    /// 10 epochs, a record every 20 steps, a checkpoint per epoch, the last 3 kept.
    fn default() -> Self {
        Self {
            epochs: 10,
            steps: None,
            batch: 0,
            seed: 42,
            log_every: 20,
            checkpoint_every: 0,
            keep: 3,
            validation_clips: 1024,
            norm_batches: 0,
            patience: 0,
            quality_every: 0,
            precision: Precision::Fp32,
        }
    }
}

impl FitSettings {
    /// Refuses what cannot be trained with.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Training`], which names the setting.
    pub fn check(&self) -> Result<(), BaselineError> {
        let at_least_one = |setting: &str, value: u64| match value {
            0 => Err(BaselineError::Training {
                setting: setting.to_owned(),
                reason: "0; use 1 or more".to_owned(),
            }),
            _ => Ok(()),
        };
        at_least_one("epochs", self.epochs)?;
        at_least_one("steps", self.steps.unwrap_or(1))?;
        at_least_one("log_every", self.log_every)?;
        at_least_one("keep", self.keep as u64)
    }

    /// Optimizer steps of a phase, for epochs of `per_epoch` steps.
    pub fn total(&self, per_epoch: u64) -> u64 {
        self.steps.unwrap_or_else(|| self.epochs.saturating_mul(per_epoch))
    }
}
