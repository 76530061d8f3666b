//! From the numbers of a plan to actions of an environment.

use swm_core::{SliceMut, Space};

use crate::sampling::clip;
use crate::space::{categories, largest, plan_width};

/// Turns A numbers of a plan into one action: clipped to the action space (if wanted), in its type. Integers are the
/// category with the largest number.
///
/// The policy and the costs that simulate use the same map, so that what is planned is what is done.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionMap {
    low: Vec<f32>,
    high: Vec<f32>,
    /// For integers: how many categories each has, and which is the first.
    groups: Vec<(usize, i64)>,
}

impl ActionMap {
    /// The map to actions of `space`.
    pub fn new(space: &Space, clips: bool) -> Self {
        let (low, high) = space.bounds();
        let groups: Vec<(usize, i64)> =
            categories(space).zip(low.iter().map(|&first| first as i64)).collect();
        if !clips || !groups.is_empty() {
            let width = plan_width(space);
            return Self { low: vec![f32::NEG_INFINITY; width], high: vec![f32::INFINITY; width], groups };
        }
        Self {
            groups,
            low: low.iter().map(|&bound| inward(bound, f32::next_up, |x| x < bound)).collect(),
            high: high.iter().map(|&bound| inward(bound, f32::next_down, |x| x > bound)).collect(),
        }
    }

    /// A: numbers per action.
    pub fn width(&self) -> usize {
        self.low.len()
    }

    /// Writes the action that `values`, `[A]`, stand for.
    pub fn write(&self, values: &[f32], action: &mut SliceMut<'_>) {
        let bounds = self.low.iter().zip(&self.high);
        let clipped = values.iter().zip(bounds).map(|(&value, (&low, &high))| clip(value, low, high));
        match action {
            SliceMut::F32(out) => out.iter_mut().zip(clipped).for_each(|(out, value)| *out = value),
            SliceMut::F64(out) => out.iter_mut().zip(clipped).for_each(|(out, value)| *out = value.into()),
            SliceMut::I64(out) => {
                let mut rest = values;
                for (out, &(count, first)) in out.iter_mut().zip(&self.groups) {
                    let (group, tail) = rest.split_at(count);
                    *out = first + largest(group) as i64;
                    rest = tail;
                }
            }
            _ => unreachable!("action spaces are boxes or integers"),
        }
    }
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
        let mut action = Column::zeros(Dtype::F64, 2);
        for value in [-9.0, 9.0] {
            ActionMap::new(&space, true).write(&[value, value], &mut action.as_slice_mut());
            space.check("action", action.as_slice()).unwrap();
        }
        ActionMap::new(&space, false).write(&[9.0, -9.0], &mut action.as_slice_mut());
        assert_eq!(action, Column::F64(vec![9.0, -9.0]));
    }

    #[test]
    fn integers_are_read_from_groups_of_numbers() {
        let space = Space::MultiDiscrete { n: vec![2, 3], start: vec![0, -1] };
        let (map, mut action) = (ActionMap::new(&space, true), Column::zeros(Dtype::I64, 2));
        map.write(&[0.2, 0.8, 0.0, 0.0, 1.0], &mut action.as_slice_mut());
        assert_eq!((map.width(), action), (5, Column::I64(vec![1, 1])));
    }
}
