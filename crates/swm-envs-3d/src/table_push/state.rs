//! The state of the simulation: all that the future depends on, apart from factors.

use serde::{Deserialize, Serialize};

use crate::attitude::{Xyzw, from_euler};

/// Values of the column `state`.
pub(super) const STATE_DIM: usize = 17;

/// Object and pusher in motion. World coordinates, z up, 0 at the top of the table; SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    /// Of the object's middle.
    pub(super) position: [f64; 3],
    pub(super) attitude: Xyzw,
    pub(super) velocity: [f64; 3],
    /// Angular velocity.
    pub(super) spin: [f64; 3],
    /// x, y of the pusher.
    pub(super) pusher: [f64; 2],
    pub(super) pusher_velocity: [f64; 2],
}

impl State {
    /// Everything at rest, the object upright.
    pub(super) fn at_rest(position: [f64; 3], angle_rad: f64, pusher: [f64; 2]) -> Self {
        Self {
            position,
            attitude: from_euler([0.0, 0.0, angle_rad]),
            velocity: [0.0; 3],
            spin: [0.0; 3],
            pusher,
            pusher_velocity: [0.0; 2],
        }
    }

    /// x, y of the object's middle.
    pub(super) fn object(&self) -> [f64; 2] {
        [self.position[0], self.position[1]]
    }

    /// The column `state`: the fields in their order.
    pub(super) fn to_row(self) -> [f64; STATE_DIM] {
        let parts: [&[f64]; 6] =
            [&self.position, &self.attitude, &self.velocity, &self.spin, &self.pusher, &self.pusher_velocity];
        let mut values = parts.into_iter().flatten();
        std::array::from_fn(|_| *values.next().expect("the fields have so many values"))
    }

    /// The state of a row of the column `state`.
    pub(super) fn from_row(row: &[f64; STATE_DIM]) -> Self {
        let &[x, y, z, qx, qy, qz, qw, vx, vy, vz, wx, wy, wz, px, py, pvx, pvy] = row;
        Self {
            position: [x, y, z],
            attitude: [qx, qy, qz, qw],
            velocity: [vx, vy, vz],
            spin: [wx, wy, wz],
            pusher: [px, py],
            pusher_velocity: [pvx, pvy],
        }
    }

    /// Whether every value is finite and the attitude a rotation.
    pub(super) fn is_sound(&self) -> bool {
        let length = self.attitude.iter().map(|part| part * part).sum::<f64>();
        self.to_row().iter().all(|value| value.is_finite()) && (length - 1.0).abs() < 1e-6
    }
}
