//! From the numbers of a plan to actions of an environment.

use swm_core::policy::write_action;
use swm_core::{SliceMut, Space};

use crate::sampling::clip;

/// Turns A numbers of a plan into one action: clipped to the action space (if wanted), in its type.
///
/// The policy and the costs that simulate use the same map, so that what is planned is what is done.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionMap {
    low: Vec<f32>,
    high: Vec<f32>,
}

impl ActionMap {
    /// The map to actions of `space`.
    pub fn new(space: &Space, clips: bool) -> Self {
        let (low, high) = space.bounds();
        if !clips {
            return Self { low: vec![f32::NEG_INFINITY; low.len()], high: vec![f32::INFINITY; high.len()] };
        }
        Self {
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
            whole => write_action(whole, values),
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
}
