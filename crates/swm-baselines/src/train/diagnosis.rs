//! What a model is worth for its task, measured while it trains: what a loss does not say. How it is measured is the
//! business of whoever trains.

use swm_core::BoxError;

use super::data::DataConfig;
use crate::baseline::Baseline;

/// Measures a model every so many steps of its training.
pub trait Diagnosis {
    /// Steps from one measurement to the next; there is one at the end, too.
    fn every(&self) -> u64;

    /// Measures the model as it is now, which was trained on data of this form: values by name.
    ///
    /// # Errors
    ///
    /// Whatever the measurement meets; it ends the training.
    fn measure(&mut self, model: &dyn Baseline, data: &DataConfig) -> Result<Vec<(String, f64)>, BoxError>;
}
