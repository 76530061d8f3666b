//! How vectors are standardized.

use serde::{Deserialize, Serialize};
use swm_core::moments::divisor;
use swm_data::stats::ColumnStatistics;

/// Standardizes a column, as scikit-learn's `StandardScaler` does: stds are those of the population, and
/// [constant](swm_core::moments::is_constant) components are only shifted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written")]
pub struct Scale {
    /// Means, per component.
    pub mean: Vec<f64>,
    /// Divisors, per component.
    pub std: Vec<f64>,
}

/// What a file has, which anybody can change.
#[derive(Deserialize)]
struct Written {
    mean: Vec<f64>,
    std: Vec<f64>,
}

impl TryFrom<Written> for Scale {
    type Error = String;

    fn try_from(Written { mean, std }: Written) -> Result<Self, String> {
        if mean.len() != std.len() {
            return Err(format!("a scale with {} means and {} stds", mean.len(), std.len()));
        }
        if let Some(wrong) = mean.iter().find(|mean| !mean.is_finite()) {
            return Err(format!("a scale whose mean is {wrong}"));
        }
        match std.iter().find(|std| !(**std > 0.0 && std.is_finite())) {
            Some(wrong) => Err(format!("a scale whose std is {wrong}; it must be above 0")),
            None => Ok(Self { mean, std }),
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_that_divides_by_nothing_is_not_read() {
        let read = |text: &str| serde_json::from_str::<Scale>(text).map_err(|error| error.to_string());
        let scale = Scale { mean: vec![0.0, 1.0], std: vec![1.0, 2.0] };
        assert_eq!(read(&serde_json::to_string(&scale).unwrap()).unwrap(), scale);
        for (text, told) in [
            (r#"{"mean":[0,1],"std":[0,0]}"#, "std is 0; it must be above 0"),
            (r#"{"mean":[0,1],"std":[1,-2]}"#, "std is -2"),
            (r#"{"mean":[],"std":[1]}"#, "0 means and 1 stds"),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(told), "{message}");
        }
    }
}
