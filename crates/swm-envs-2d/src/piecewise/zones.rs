//! The zones as an agent meets them: which one it is in, and how a step moves it. Positions are `[x, y]` in pixels of the
//! 224-px image, y down, in f32 as in the reference.

use swm_fov::Fov;

use super::factors::bias_name;
use crate::tworoom_v2::room::{BORDER_PX, IMAGE_PX};

/// The side of the room, px.
pub(super) const SIDE_PX: f32 = IMAGE_PX as f32 - 2.0 * BORDER_PX as f32;

/// What of an assignment of factors matters for moving.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Zones {
    /// Zones along each axis.
    pub(super) grid_n: usize,
    /// The push of each zone, row by row, px per step.
    pub(super) biases: Vec<[f32; 2]>,
    /// Pixels per step and axis at full action.
    pub(super) speed: f32,
    radius: f32,
}

impl Zones {
    /// The zones of an episode.
    pub(super) fn new(fov: &Fov, grid_n: usize) -> Self {
        Self {
            grid_n,
            biases: (0..grid_n * grid_n).map(|zone| fov.vector(&bias_name(zone))).collect(),
            speed: fov.f32("agent.speed"),
            radius: fov.f32("agent.radius"),
        }
    }

    /// The push where the agent is.
    pub(super) fn bias(&self, position: [f32; 2]) -> [f32; 2] {
        let last = self.grid_n - 1;
        // A negative number becomes 0.
        let cell = |c: f32| ((c - BORDER_PX as f32) / SIDE_PX * self.grid_n as f32) as usize;
        let [column, row] = position.map(|c| cell(c).min(last));
        self.biases[row * self.grid_n + column]
    }

    /// Where zone `k` of a row or column begins, px.
    pub(super) fn edge(&self, k: usize) -> i32 {
        let side = SIDE_PX as usize;
        BORDER_PX as i32 + (k * side / self.grid_n) as i32
    }

    /// Where a step leads.
    pub(super) fn step(&self, position: [f32; 2], action: [f32; 2]) -> [f32; 2] {
        let bias = self.bias(position);
        let (low, high) = (BORDER_PX as f32 + self.radius, BORDER_PX as f32 + SIDE_PX - self.radius);
        std::array::from_fn(|axis| {
            let moved = position[axis] + action[axis].clamp(-1.0, 1.0) * self.speed;
            (moved + bias[axis]).clamp(low, high)
        })
    }
}
