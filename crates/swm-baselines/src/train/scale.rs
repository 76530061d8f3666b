//! How vectors are standardized.

use serde::{Deserialize, Serialize};
use swm_core::moments::divisor;
use swm_data::stats::ColumnStatistics;

/// Standardizes a column, as scikit-learn's `StandardScaler` does: stds are those of the population, and
/// [constant](swm_core::moments::is_constant) components are only shifted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// Means, per component.
    pub mean: Vec<f64>,
    /// Divisors, per component.
    pub std: Vec<f64>,
}

impl Scale {
    /// From statistics of a column; `None` if no row of it counts.
    pub fn of(statistics: &ColumnStatistics) -> Option<Self> {
        let std =
            statistics.mean.iter().zip(&statistics.std).map(|(&mean, &std)| divisor(mean, std)).collect();
        (statistics.rows > 0).then(|| Self { mean: statistics.mean.clone(), std })
    }

    /// Scales vectors `[…, D]`. What is missing (NaN) becomes 0, the mean.
    pub fn apply(&self, values: &mut [f32]) {
        for row in values.chunks_mut(self.mean.len().max(1)) {
            for ((value, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *value = match ((f64::from(*value) - mean) / std) as f32 {
                    scaled if scaled.is_nan() => 0.0,
                    scaled => scaled,
                };
            }
        }
    }
}
