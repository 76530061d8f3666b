//! What a model is worth for its task, measured while it trains: what a loss does not say. How it is measured is the
//! business of whoever trains.

use swm_core::BoxError;

use super::data::DataConfig;
use crate::baseline::Baseline;

/// Measures a model on the way, every [`quality_every`](super::FitSettings::quality_every) steps.
pub trait Diagnosis {
    /// Measures the model as it is now, which was trained on data of this form: values by name.
    ///
    /// # Errors
    ///
    /// Whatever the measurement meets; it ends the training.
    fn measure(&mut self, model: &dyn Baseline, data: &DataConfig) -> Result<Vec<(String, f64)>, BoxError>;
}
