//! The state of the simulation: all that the future depends on, apart from factors and noise.

use serde::{Deserialize, Serialize};

use super::body::STANDING_HEIGHT;
use crate::attitude::{UPRIGHT, Xyzw};

/// Values of the column `state`.
pub(super) const STATE_DIM: usize = 34;

/// Values of an action.
pub(super) const ACTION_DIM: usize = 7;

/// A rocket in motion. World coordinates, SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    /// Of the body frame's origin.
    pub(super) position: [f64; 3],
    pub(super) attitude: Xyzw,
    /// Of the body frame's origin.
    pub(super) velocity: [f64; 3],
    /// Angular velocity.
    pub(super) spin: [f64; 3],
    /// Deflection of the surfaces, share of the limit.
    pub(super) fins: [f64; 4],
    /// Deflection of the engine about x and y, share of the limit.
    pub(super) gimbal: [f64; 2],
    pub(super) throttle: f64,
    /// Share of a full tank.
    pub(super) fuel: f64,
    /// The attitude at the start of the last physics step, in which PyBullet applies forces.
    pub(super) lagging_attitude: Xyzw,
    pub(super) action: [f64; ACTION_DIM],
    /// Whether the pad was touched in the control step before the last, which the observation tells, and in the last.
    pub(super) pad_contact: [bool; 2],
}

impl State {
    /// A rocket without motion, the engine off.
    pub(super) fn at_rest(position: [f64; 3], attitude: Xyzw, fuel: f64) -> Self {
        Self {
            position,
            attitude,
            velocity: [0.0; 3],
            spin: [0.0; 3],
            fins: [0.0; 4],
            gimbal: [0.0; 2],
            throttle: 0.0,
            fuel,
            lagging_attitude: attitude,
            action: [0.0; ACTION_DIM],
            pad_contact: [false; 2],
        }
    }

    /// Standing on the middle of the pad.
    pub(super) fn landed(fuel: f64) -> Self {
        Self::at_rest([0.0, 0.0, STANDING_HEIGHT], UPRIGHT, fuel)
    }

    /// The column `state`: the fields in their order.
    pub(super) fn to_row(self) -> [f64; STATE_DIM] {
        let contact = self.pad_contact.map(|touched| f64::from(u8::from(touched)));
        let (throttle, fuel) = ([self.throttle], [self.fuel]);
        let parts: [&[f64]; 11] = [
            &self.position,
            &self.attitude,
            &self.velocity,
            &self.spin,
            &self.fins,
            &self.gimbal,
            &throttle,
            &fuel,
            &self.lagging_attitude,
            &self.action,
            &contact,
        ];
        let mut row = [0.0; STATE_DIM];
        row.iter_mut().zip(parts.into_iter().flatten()).for_each(|(value, part)| *value = *part);
        row
    }

    /// The state of a row that [`State::to_row`] made.
    pub(super) fn from_row(row: &[f64; STATE_DIM]) -> Self {
        let mut rest = &row[..];
        let [contact_before, contact] = [row[STATE_DIM - 2], row[STATE_DIM - 1]];
        Self {
            position: take(&mut rest),
            attitude: take(&mut rest),
            velocity: take(&mut rest),
            spin: take(&mut rest),
            fins: take(&mut rest),
            gimbal: take(&mut rest),
            throttle: take::<1>(&mut rest)[0],
            fuel: take::<1>(&mut rest)[0],
            lagging_attitude: take(&mut rest),
            action: take(&mut rest),
            pad_contact: [contact_before != 0.0, contact != 0.0],
        }
    }

    /// Whether every value is finite and every quaternion has the length 1, to a millionth.
    pub(super) fn is_sound(&self) -> bool {
        let is_unit =
            |quaternion: &Xyzw| (quaternion.iter().map(|part| part * part).sum::<f64>() - 1.0).abs() < 1e-6;
        self.to_row().iter().all(|value| value.is_finite())
            && is_unit(&self.attitude)
            && is_unit(&self.lagging_attitude)
            && (0.0..=1.0).contains(&self.fuel)
    }
}

fn take<const N: usize>(rest: &mut &[f64]) -> [f64; N] {
    let (head, tail) = rest.split_first_chunk().expect("a row has as many values as a state");
    *rest = tail;
    *head
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_states_convert_both_ways() {
        let mut row = [0.0; STATE_DIM];
        row.iter_mut().enumerate().for_each(|(index, value)| *value = 0.5 + index as f64);
        row[STATE_DIM - 2..].copy_from_slice(&[1.0, 0.0]);
        let state = State::from_row(&row);
        assert_eq!(state.to_row(), row);
        assert!(!state.is_sound(), "its quaternions are too long");
        assert!(State::landed(0.3).is_sound());
    }
}
