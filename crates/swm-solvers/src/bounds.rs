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
    let Space::Box { shape, low, high, .. } = space else {
        let kind = space.kind();
        let reason = format!(
            "it needs real numbers (a box), and the action space is {kind}; categorical-cem plans integers"
        );
        return refuse(reason);
    };
    let elements: usize = shape.iter().product();
    if [low.len(), high.len()] != [elements; 2] {
        let (lows, highs) = (low.len(), high.len());
        return refuse(format!(
            "an action of the shape {shape:?} has {elements} elements, and the space has {lows} lower and {highs} upper bounds; \
             give one of each per element (`Space::uniform_box` repeats them)"
        ));
    }
    if let Some(index) = (0..low.len()).find(|&i| low[i].is_nan() || high[i].is_nan() || low[i] > high[i]) {
        let (low, high) = (low[index], high[index]);
        return refuse(format!(
            "element {index} of the action has the bounds low {low} and high {high}; low must not be above high"
        ));
    }
    if low.is_empty() {
        return refuse("the action has no elements".to_owned());
    }
    Ok((low, high))
}

#[cfg(test)]
mod tests {
    use swm_core::{Dtype, EpisodeSeed};

    use super::*;
    use crate::{Cem, Mpc, PlanConfig, PlanKey, Problem, Solver as _};

    fn space(shape: &[usize], low: &[f64], high: &[f64]) -> Space {
        Space::Box { dtype: Dtype::F32, shape: shape.to_vec(), low: low.to_vec(), high: high.to_vec() }
    }

    #[test]
    fn bounds_of_another_length_are_refused() {
        for (low, high, found) in [
            (&[-1.0][..], &[1.0, 1.0][..], "1 lower and 2 upper bounds"),
            (&[-1.0, -1.0], &[1.0], "2 lower and 1 upper bounds"),
            (&[-1.0; 3], &[1.0; 3], "3 lower and 3 upper bounds"),
            (&[], &[], "0 lower and 0 upper bounds"),
        ] {
            let space = space(&[2], low, high);
            let message = Cem::default().check(&space).unwrap_err().to_string();
            assert!(
                message.starts_with("cem cannot plan these actions: an action of the shape [2]"),
                "{message}"
            );
            assert!(message.contains(found) && message.contains("give one of each"), "{message}");
            assert!(Mpc::new(Box::new(Cem::default()), PlanConfig::default(), space).is_err(), "{found}");
        }
        assert!(Cem::default().check(&space(&[2], &[-1.0; 2], &[1.0; 2])).is_ok());
        let message = Cem::default().check(&space(&[1], &[f64::NAN], &[1.0])).unwrap_err().to_string();
        assert!(message.contains("element 0") && message.contains("NaN"), "{message}");
    }

    #[test]
    fn plans_start_from_finite_values() {
        let action = space(&[2], &[-1.0; 2], &[1.0; 2]);
        let key = PlanKey { episode: 0, seed: EpisodeSeed::new(1), plan: 0 };
        let mut initial = [0.0; 12];
        initial[9] = f32::NAN;
        let problem = Problem {
            keys: &[key; 2],
            horizon: 3,
            action_block: 1,
            action: &action,
            initial: &initial,
            memory: &[],
        };
        let message = problem.check().unwrap_err().to_string();
        assert!(message.contains("`initial` has the value NaN at 9 (episode 1, block 1)"), "{message}");
        assert!(Problem { initial: &[0.0; 12], ..problem }.check().is_ok());
        assert!(Problem { initial: &[f32::INFINITY; 12], ..problem }.check().is_err());
    }
}
