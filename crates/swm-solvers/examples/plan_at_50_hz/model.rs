//! A double integrator in the plane with a round obstacle: the model, and what it should do.

use swm_core::{Dtype, Space};
use swm_solvers::models::{ControlModel, Stage};
use swm_solvers::{Icem, PlanConfig};

/// Seconds per control step: 50 Hz.
pub(crate) const STEP_S: f64 = 0.02;
/// Where it goes, in m.
pub(crate) const GOAL: [f64; 2] = [2.0, 0.0];
/// Center of the obstacle, in m.
pub(crate) const OBSTACLE: [f64; 2] = [1.0, 0.1];
/// Its radius, in m.
pub(crate) const RADIUS: f64 = 0.3;
/// Largest acceleration along each axis, in m/s².
pub(crate) const LARGEST: f64 = 3.0;

/// A body that is accelerated in x and y: `[x, y, vx, vy]`, in m and m/s.
pub(crate) struct Body {
    /// The measured state: where plans start.
    pub(crate) now: [f64; 4],
}

impl Body {
    /// The state after one control step at `acceleration`.
    pub(crate) fn after(state: &[f64], acceleration: [f64; 2]) -> [f64; 4] {
        let velocity = [0, 1].map(|axis| state[2 + axis] + STEP_S * acceleration[axis]);
        let position = [0, 1].map(|axis| state[axis] + STEP_S * velocity[axis]);
        [position[0], position[1], velocity[0], velocity[1]]
    }

    /// Distance from `point` in m.
    pub(crate) fn distance(state: &[f64], point: [f64; 2]) -> f64 {
        (state[0] - point[0]).hypot(state[1] - point[1])
    }
}

impl ControlModel for Body {
    fn state_dim(&self) -> usize {
        4
    }

    fn action_dim(&self) -> usize {
        2
    }

    fn start(&self, _episode: usize, state: &mut [f64]) {
        state.copy_from_slice(&self.now);
    }

    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        next.copy_from_slice(&Self::after(at.state, [at.action[0], at.action[1]]));
    }

    /// Far from the goal, fast, or near the obstacle, for which 5 cm are kept free.
    fn cost(&self, at: &Stage<'_>) -> f64 {
        let speed = at.state[2].hypot(at.state[3]);
        let inside = (RADIUS + 0.05 - Self::distance(at.state, OBSTACLE)).max(0.0);
        let distance = Self::distance(at.state, GOAL);
        let weight = if at.is_last() { 10.0 } else { 1.0 };
        weight * distance
            + 0.05 * speed * speed
            + 1000.0 * inside * inside
            + if inside > 0.0 { 1.0 } else { 0.0 }
    }
}

/// Accelerations `[ax, ay]`.
pub(crate) fn actions() -> Space {
    Space::uniform_box(Dtype::F32, &[2], -LARGEST, LARGEST)
}

/// Colored noise explores smooth motions with few samples.
pub(crate) fn solver() -> Icem {
    Icem { samples: 64, iterations: 6, elites: 8, elites_kept: 4, sigma: 2.0, ..Icem::default() }
}

/// Looks 1 s ahead and plans again at every step.
pub(crate) fn config() -> PlanConfig {
    PlanConfig { horizon: 50, receding_horizon: 1, action_block: 1, ..PlanConfig::default() }
}
