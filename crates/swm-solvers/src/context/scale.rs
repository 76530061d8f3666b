//! Normalization of actions: the units that a model was trained with. Statistics belong to the model and are stored with
//! it; nothing here is fitted to an evaluation.

use serde::{Deserialize, Serialize};
use swm_core::moments::{Moments, divisor};

use crate::error::PlanError;

/// Normalization of actions, one statistic per element `[A]`. It acts on single actions, not on blocks.
///
/// Source of the formulas: the reference's `ZScoreScaler` and `PercentileScaler`. Where an element does not vary
/// the reference has three rules; here a [constant](swm_core::moments::is_constant) has the scale 1, in both directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum ActionScale {
    /// `(x - mean) / std`.
    MeanStd {
        /// `[A]`: means.
        mean: Vec<f64>,
        /// `[A]`: standard deviations.
        std: Vec<f64>,
    },
    /// `2 (x - low) / (high - low) - 1`, clipped to -1..1.
    Percentile {
        /// `[A]`: 1st percentiles.
        low: Vec<f64>,
        /// `[A]`: 99th percentiles.
        high: Vec<f64>,
    },
}

impl ActionScale {
    /// Means and standard deviations (divided by n) of `actions`, `[N, A]` with A = `dim`. Actions with a NaN, such as the
    /// last of an episode, are ignored.
    ///
    /// # Errors
    ///
    /// `actions` are not a multiple of `dim` values, or all of them are ignored.
    pub fn fit_mean_std(actions: &[f32], dim: usize) -> Result<Self, PlanError> {
        let columns = columns(actions, dim)?;
        let columns: Vec<Moments> = columns.iter().map(|column| column.iter().copied().collect()).collect();
        let each = |value: fn(&Moments) -> f64| columns.iter().map(value).collect();
        Ok(ActionScale::MeanStd { mean: each(Moments::mean), std: each(Moments::std) })
    }

    /// 1st and 99th percentiles (interpolated linearly) of `actions`, `[N, A]`. Actions with a NaN are ignored.
    ///
    /// # Errors
    ///
    /// As of [`ActionScale::fit_mean_std`].
    pub fn fit_percentile(actions: &[f32], dim: usize) -> Result<Self, PlanError> {
        let mut columns = columns(actions, dim)?;
        columns.iter_mut().for_each(|column| column.sort_unstable_by(f64::total_cmp));
        let all = |fraction: f64| columns.iter().map(|column| quantile(column, fraction)).collect();
        Ok(ActionScale::Percentile { low: all(0.01), high: all(0.99) })
    }

    /// A: elements of an action.
    pub fn dim(&self) -> usize {
        let (ActionScale::MeanStd { mean: first, .. } | ActionScale::Percentile { low: first, .. }) = self;
        first.len()
    }

    /// Refuses statistics that cannot be divided by, and lists of unequal length.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`], which names the first bad element.
    pub fn check(&self) -> Result<(), PlanError> {
        let (one, other) = match self {
            ActionScale::MeanStd { mean, std } => (mean, std),
            ActionScale::Percentile { low, high } => (low, high),
        };
        if one.len() != other.len() {
            let reason = format!(
                "lists of {} and {} values; one of each per element of the action",
                one.len(),
                other.len()
            );
            return Err(PlanError::setting(NAME, reason));
        }
        let wrong = |index: &usize| {
            let range = match self {
                ActionScale::MeanStd { .. } => other[*index],
                ActionScale::Percentile { .. } => other[*index] - one[*index],
            };
            !one[*index].is_finite() || !range.is_finite() || range < 0.0
        };
        match (0..one.len()).find(wrong) {
            Some(index) => {
                let reason = format!(
                    "{} and {} are no scale for element {index} of the action",
                    one[index], other[index]
                );
                Err(PlanError::setting(NAME, reason))
            }
            None => Ok(()),
        }
    }

    /// The center and scale of element `index`: `plan = (action - center) / scale`.
    fn line(&self, index: usize) -> (f64, f64) {
        let (center, scale) = match self {
            ActionScale::MeanStd { mean, std } => (mean[index], std[index]),
            ActionScale::Percentile { low, high } => {
                ((low[index] + high[index]) / 2.0, (high[index] - low[index]) / 2.0)
            }
        };
        (center, divisor(center, scale))
    }

    /// The plan value of element `index` of an action.
    pub fn to_plan(&self, index: usize, value: f64) -> f64 {
        let (center, scale) = self.line(index);
        let scaled = (value - center) / scale;
        match self {
            ActionScale::MeanStd { .. } => scaled,
            ActionScale::Percentile { .. } => scaled.clamp(-1.0, 1.0),
        }
    }

    /// Element `index` of the action from its plan value.
    pub fn to_action(&self, index: usize, value: f64) -> f64 {
        let (center, scale) = self.line(index);
        value * scale + center
    }
}

/// Its name in errors.
pub(super) const NAME: &str = "action_scale";

/// The elements of the usable actions of `[N, A]`: A lists, none of them empty.
fn columns(actions: &[f32], dim: usize) -> Result<Vec<Vec<f64>>, PlanError> {
    if dim == 0 || !actions.len().is_multiple_of(dim) {
        let reason = format!("{} values are not a multiple of {dim}", actions.len());
        return Err(PlanError::setting(NAME, reason));
    }
    let usable = || actions.chunks_exact(dim).filter(|action| action.iter().all(|value| !value.is_nan()));
    if usable().next().is_none() {
        return Err(PlanError::setting(NAME, "no action to fit it to; give actions that are not NaN"));
    }
    Ok((0..dim).map(|index| usable().map(|action| f64::from(action[index])).collect()).collect())
}

/// Of sorted values; between two of them, on the line.
fn quantile(sorted: &[f64], fraction: f64) -> f64 {
    let place = fraction * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    below + (above - below) * place.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: f32 = f32::NAN;

    #[test]
    fn scaling_round_trips() {
        for scale in [
            ActionScale::MeanStd { mean: vec![1.0, -2.0], std: vec![0.5, 3.0] },
            ActionScale::Percentile { low: vec![-1.0, 2.0], high: vec![3.0, 2.5] },
        ] {
            for index in 0..2 {
                let (center, factor) = scale.line(index);
                for step in [-0.9, 0.0, 0.4] {
                    let value = center + step * factor;
                    assert!((scale.to_plan(index, value) - step).abs() < 1e-12);
                    assert!((scale.to_action(index, step) - value).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn percentiles_clip_what_a_model_has_not_seen() {
        let scale = ActionScale::Percentile { low: vec![-1.0], high: vec![3.0] };
        assert_eq!((scale.to_plan(0, 9.0), scale.to_plan(0, -9.0), scale.to_plan(0, 2.0)), (1.0, -1.0, 0.5));
    }

    #[test]
    fn constant_elements_have_scale_one_in_both_directions() {
        for scale in [
            ActionScale::MeanStd { mean: vec![2.0], std: vec![1e-9] },
            ActionScale::Percentile { low: vec![2.0], high: vec![2.0] },
        ] {
            assert_eq!((scale.to_plan(0, 2.5), scale.to_action(0, 0.5)), (0.5, 2.5));
        }
    }

    #[test]
    fn fits_actions_without_nan() {
        let actions = [1.0, 10.0, 3.0, 30.0, NAN, 5.0, 7.0, NAN];
        let scale = ActionScale::fit_mean_std(&actions, 2).unwrap();
        assert_eq!(scale, ActionScale::MeanStd { mean: vec![2.0, 20.0], std: vec![1.0, 10.0] });
        let steps: Vec<f32> = (0..101).map(|value| value as f32).collect();
        let scale = ActionScale::fit_percentile(&steps, 1).unwrap();
        assert_eq!(scale, ActionScale::Percentile { low: vec![1.0], high: vec![99.0] });
        let scale = ActionScale::fit_percentile(&[0.0, 10.0], 1).unwrap();
        assert_eq!(scale, ActionScale::Percentile { low: vec![0.1], high: vec![9.9] });

        let message = |actions: &[f32], dim| ActionScale::fit_mean_std(actions, dim).unwrap_err().to_string();
        assert!(message(&[NAN, NAN], 2).contains("no action to fit"));
        assert!(message(&[1.0, 2.0, 3.0], 2).contains("3 values are not a multiple of 2"));
    }

    #[test]
    fn bad_statistics_are_refused() {
        let message = |scale: ActionScale| scale.check().unwrap_err().to_string();
        let mean = vec![0.0, 0.0];
        assert!(message(ActionScale::MeanStd { mean: mean.clone(), std: vec![1.0] }).contains("2 and 1"));
        let negative = ActionScale::MeanStd { mean: mean.clone(), std: vec![1.0, -1.0] };
        assert!(message(negative).contains("element 1"));
        assert!(message(ActionScale::MeanStd { mean: vec![f64::NAN], std: vec![1.0] }).contains("NaN"));
        let crossed = ActionScale::Percentile { low: vec![1.0], high: vec![0.0] };
        assert!(message(crossed).contains("1 and 0 are no scale for element 0"));
    }
}
