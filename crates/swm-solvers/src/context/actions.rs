//! From the values of a plan to actions of an environment.

use swm_core::{SliceMut, Space};

use super::scale::{ActionScale, NAME};
use crate::error::PlanError;
use crate::sampling::clip;
use crate::space::{categories, largest, plan_dim};

/// Turns A values of a plan into one action: clipped to the action space (if enabled), denormalized (if plans are
/// normalized), in its type. Integers are the category with the largest value.
///
/// The policy and the simulator costs use the same map, so that what is planned is what is executed.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionMap {
    /// `[A]`: bounds of plan values; infinite where nothing is clipped.
    low: Vec<f32>,
    high: Vec<f32>,
    scaling: Option<Scaling>,
    /// For integers: how many categories each has, and which is the first.
    groups: Vec<(usize, i64)>,
    /// The action space in plan units.
    space: Space,
}

/// Denormalization of plan values.
#[derive(Clone, Debug, PartialEq)]
struct Scaling {
    scale: ActionScale,
    /// `[A]`: bounds of actions; rounding must not leave them.
    low: Vec<f32>,
    high: Vec<f32>,
}

impl ActionMap {
    /// The map to actions of `space`.
    pub fn new(space: &Space, clips: bool) -> Self {
        let groups: Vec<(usize, i64)> =
            categories(space).zip(space.bounds().0.iter().map(|&first| first as i64)).collect();
        let [low, high] = if clips && groups.is_empty() {
            inner_bounds(space)
        } else {
            let dim = plan_dim(space);
            [vec![f32::NEG_INFINITY; dim], vec![f32::INFINITY; dim]]
        };
        Self { low, high, scaling: None, groups, space: space.clone() }
    }

    /// The map to actions of `space` from plans in units of `scale`. Bounds of the space become bounds of the plan, by
    /// the same formula as any action.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: the space is not of real numbers, or the scale has another dimension or fails
    /// [`ActionScale::check`].
    pub fn scaled(space: &Space, scale: &ActionScale, clips: bool) -> Result<Self, PlanError> {
        let Space::Box { dtype, shape, low, high } = space else {
            let reason = format!("normalizes real numbers, and the action space is {}", space.kind());
            return Err(PlanError::setting(NAME, reason));
        };
        scale.check()?;
        if scale.dim() != low.len() {
            let (found, expected) = (scale.dim(), low.len());
            let reason =
                format!("has {found} values, and the action has {expected}; use a model of this environment");
            return Err(PlanError::setting(NAME, reason));
        }
        let planned = |bounds: &[f64]| -> Vec<f64> {
            bounds.iter().enumerate().map(|(index, &bound)| scale.to_plan(index, bound)).collect()
        };
        let units =
            Space::Box { dtype: *dtype, shape: shape.clone(), low: planned(low), high: planned(high) };
        let [low, high] = Self::new(space, clips).into_bounds();
        let scaling = Some(Scaling { scale: scale.clone(), low, high });
        Ok(Self { scaling, ..Self::new(&units, clips) })
    }

    fn into_bounds(self) -> [Vec<f32>; 2] {
        [self.low, self.high]
    }

    /// Whether it clips any value.
    pub fn clips(&self) -> bool {
        self.low.iter().chain(&self.high).any(|bound| bound.is_finite())
    }

    /// A: plan values per action.
    pub fn dim(&self) -> usize {
        self.low.len()
    }

    /// The action space in the units of the plan: what solvers search.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// Writes the action that `values`, `[A]`, stand for.
    pub fn write(&self, values: &[f32], action: &mut SliceMut<'_>) {
        match action {
            SliceMut::F32(out) => {
                out.iter_mut().enumerate().for_each(|(index, out)| *out = self.value(index, values[index]));
            }
            SliceMut::F64(out) => out
                .iter_mut()
                .enumerate()
                .for_each(|(index, out)| *out = self.value(index, values[index]).into()),
            SliceMut::I64(out) => {
                for (out, (group, first)) in out.iter_mut().zip(self.groups_of(values)) {
                    *out = first + largest(group) as i64;
                }
            }
            _ => unreachable!("action spaces are boxes or integers"),
        }
    }

    /// Element `index` of the action from its plan value.
    fn value(&self, index: usize, value: f32) -> f32 {
        let clipped = clip(value, self.low[index], self.high[index]);
        match &self.scaling {
            None => clipped,
            Some(Scaling { scale, low, high }) => {
                let action = scale.to_action(index, f64::from(clipped)) as f32;
                clip(action, low[index], high[index])
            }
        }
    }

    /// Writes what is executed when `values`, `[A]`, are planned, in plan units: clipped, or one-hot. This is what a model
    /// gets as its past actions.
    pub fn executed(&self, values: &[f32], out: &mut [f32]) {
        let bounds = self.low.iter().zip(&self.high);
        for ((out, &value), (&low, &high)) in out.iter_mut().zip(values).zip(bounds) {
            *out = clip(value, low, high);
        }
        if self.groups.is_empty() {
            return;
        }
        out.fill(0.0);
        let mut start = 0;
        for (group, _) in self.groups_of(values) {
            out[start + largest(group)] = 1.0;
            start += group.len();
        }
    }

    /// The values of each integer, and its first category.
    fn groups_of<'a>(&'a self, values: &'a [f32]) -> impl Iterator<Item = (&'a [f32], i64)> {
        let mut rest = values;
        self.groups.iter().map(move |&(count, first)| {
            let (group, tail) = rest.split_at(count);
            rest = tail;
            (group, first)
        })
    }
}

/// The bounds of a box as `f32`, never wider than they are.
fn inner_bounds(space: &Space) -> [Vec<f32>; 2] {
    let (low, high) = space.bounds();
    [
        low.iter().map(|&bound| inward(bound, f32::next_up, |x| x < bound)).collect(),
        high.iter().map(|&bound| inward(bound, f32::next_down, |x| x > bound)).collect(),
    ]
}

/// The bound as `f32`, moved by `toward` where rounding has put it outside: 0.1 becomes larger in `f32`.
fn inward(bound: f64, toward: fn(f32) -> f32, outside: impl Fn(f64) -> bool) -> f32 {
    let rounded = bound as f32;
    if outside(f64::from(rounded)) { toward(rounded) } else { rounded }
}

#[cfg(test)]
mod tests {
    use swm_core::{Column, Dtype};

    use super::*;

    #[test]
    fn clipped_actions_lie_in_the_space_to_the_last_bit() {
        let space =
            Space::Box { dtype: Dtype::F64, shape: vec![2], low: vec![-0.1, -1.0], high: vec![0.1, 0.7] };
        let scale = ActionScale::MeanStd { mean: vec![0.03, 0.1], std: vec![0.07, 1e-9] };
        let mut action = Column::zeros(Dtype::F64, 2);
        for value in [-9.0, 9.0] {
            for map in [ActionMap::new(&space, true), ActionMap::scaled(&space, &scale, true).unwrap()] {
                map.write(&[value, value], &mut action.as_slice_mut());
                space.check("action", action.as_slice()).unwrap();
            }
        }
        ActionMap::new(&space, false).write(&[9.0, -9.0], &mut action.as_slice_mut());
        assert_eq!(action, Column::F64(vec![9.0, -9.0]));
    }

    #[test]
    fn plans_are_normalized_and_actions_are_not() {
        let space = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
        let scale = ActionScale::MeanStd { mean: vec![0.5, 0.0], std: vec![0.25, 2.0] };
        let map = ActionMap::scaled(&space, &scale, true).unwrap();
        assert_eq!(map.space().bounds(), (vec![-6.0, -0.5], vec![2.0, 0.5]));
        let (mut action, mut executed) = (Column::zeros(Dtype::F32, 2), [0.0; 2]);
        map.write(&[1.0, 9.0], &mut action.as_slice_mut());
        map.executed(&[1.0, 9.0], &mut executed);
        assert_eq!((action, executed), (Column::F32(vec![0.75, 1.0]), [1.0, 0.5]));

        let free = ActionMap::scaled(&space, &scale, false).unwrap();
        let mut action = Column::zeros(Dtype::F32, 2);
        free.write(&[1.0, 9.0], &mut action.as_slice_mut());
        free.executed(&[1.0, 9.0], &mut executed);
        assert_eq!((action, executed), (Column::F32(vec![0.75, 18.0]), [1.0, 9.0]));
    }

    #[test]
    fn scales_for_other_actions_are_refused() {
        let scale = ActionScale::MeanStd { mean: vec![0.0], std: vec![1.0] };
        let message = |space: &Space| ActionMap::scaled(space, &scale, true).unwrap_err().to_string();
        let two = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
        assert!(message(&two).contains("has 1 values, and the action has 2"));
        assert!(message(&Space::Discrete { n: 3, start: 0 }).contains("the action space is discrete"));
    }

    #[test]
    fn integers_are_read_from_groups_of_values() {
        let space = Space::MultiDiscrete { n: vec![2, 3], start: vec![0, -1] };
        let (map, mut action) = (ActionMap::new(&space, true), Column::zeros(Dtype::I64, 2));
        let planned = [0.2, 0.8, 0.0, 0.0, 1.0];
        map.write(&planned, &mut action.as_slice_mut());
        assert_eq!((map.dim(), action), (5, Column::I64(vec![1, 1])));
        let mut executed = [9.0; 5];
        map.executed(&planned, &mut executed);
        assert_eq!(executed, [0.0, 1.0, 0.0, 0.0, 1.0]);
    }
}
