//! Bounds of the values of a plan, for solvers of real actions.

use swm_core::Space;

use crate::error::PlanError;
use crate::sampling::clip;

/// Bounds of every value of a plan, each action's repeated; none at all if nothing is clipped.
pub(crate) fn fill_bounds((low, high): (&[f64], &[f64]), clip: bool, lows: &mut [f32], highs: &mut [f32]) {
    lows.fill(f32::NEG_INFINITY);
    highs.fill(f32::INFINITY);
    if clip {
        lows.iter_mut().zip(low.iter().cycle()).for_each(|(out, &value)| *out = value as f32);
        highs.iter_mut().zip(high.iter().cycle()).for_each(|(out, &value)| *out = value as f32);
    }
}

/// Clips every value to its bounds.
pub(crate) fn clamp(values: &mut [f32], low: &[f32], high: &[f32]) {
    for ((value, low), high) in values.iter_mut().zip(low).zip(high) {
        *value = clip(*value, *low, *high);
    }
}

/// Lower and upper bounds of real-valued actions; other spaces are refused.
pub(crate) fn box_bounds<'a>(
    solver: &'static str,
    space: &'a Space,
) -> Result<(&'a [f64], &'a [f64]), PlanError> {
    let refuse = |reason| Err(PlanError::Space { solver, reason });
    let Space::Box { low, high, .. } = space else {
        let kind = space.kind();
        let reason = format!(
            "it needs real numbers (a box), and the action space is {kind}; categorical-cem plans integers"
        );
        return refuse(reason);
    };
    if let Some(index) = (0..low.len()).find(|&i| low[i].is_nan() || high[i].is_nan() || low[i] > high[i]) {
        let (low, high) = (low[index], high[index]);
        return refuse(format!("element {index} of the action has the bounds low {low} and high {high}"));
    }
    if low.is_empty() {
        return refuse("the action has no elements".to_owned());
    }
    Ok((low, high))
}
