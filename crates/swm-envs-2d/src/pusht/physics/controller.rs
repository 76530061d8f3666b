//! The controller that drives the agent: a critically damped pull towards a target, in the reference's precision.
//!
//! The reference computes with the type of the action. Single precision shows in the trajectories (1e-2 px after 50
//! control steps), so both are offered. Sums and products stand in the reference's order.

use super::math::{Vec2, vec2};
use super::world::SUBSTEP_SECONDS;

/// Pixels per unit of a relative action.
const ACTION_SCALE: f32 = 100.0;
/// Pull per pixel of distance, 1/s².
const STIFFNESS: f32 = 100.0;
/// Brake per px/s of velocity, 1/s.
const DAMPING: f64 = 20.0;

/// What an action means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ActionMode {
    /// The target is the agent's position at the start of the control step plus 100 px times the action.
    #[default]
    Relative,
    /// The target is the action, in pixels.
    Absolute,
}

/// A number type that actions come in: `f32`, as the reference's action space has it, or `f64`.
///
/// The controller rounds to this type as the reference does.
pub trait ActionScalar: sealed::Sealed + Copy {}

impl ActionScalar for f32 {}
impl ActionScalar for f64 {}

mod sealed {
    /// One axis of the controller.
    pub trait Sealed: Sized {
        /// Target of a relative action at a position.
        fn target_from(self, position: f64) -> Self;
        /// Velocity after one pull towards the target `self`.
        fn pulled(self, position: f64, velocity: f64) -> f64;
    }
}

impl sealed::Sealed for f32 {
    fn target_from(self, position: f64) -> f32 {
        position as f32 + self * ACTION_SCALE
    }

    fn pulled(self, position: f64, velocity: f64) -> f64 {
        let brake = (DAMPING * (0.0 - velocity)) as f32;
        let acceleration = STIFFNESS * (self - position as f32) + brake;
        f64::from(velocity as f32 + acceleration * SUBSTEP_SECONDS as f32)
    }
}

impl sealed::Sealed for f64 {
    fn target_from(self, position: f64) -> f64 {
        position + self * f64::from(ACTION_SCALE)
    }

    fn pulled(self, position: f64, velocity: f64) -> f64 {
        let acceleration = f64::from(STIFFNESS) * (self - position) + DAMPING * (0.0 - velocity);
        velocity + acceleration * SUBSTEP_SECONDS
    }
}

/// Where an action wants an agent at `position` to go.
pub(super) fn target<T: ActionScalar>(action: [T; 2], mode: ActionMode, position: Vec2) -> [T; 2] {
    match mode {
        ActionMode::Relative => [action[0].target_from(position.x), action[1].target_from(position.y)],
        ActionMode::Absolute => action,
    }
}

/// The velocity that the controller gives an agent before a substep.
pub(super) fn velocity<T: ActionScalar>(target: [T; 2], position: Vec2, velocity: Vec2) -> Vec2 {
    vec2(target[0].pulled(position.x, velocity.x), target[1].pulled(position.y, velocity.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_action_from_rest_starts_at_100_pixels_per_second() {
        let position = vec2(200.0, 200.0);
        let goal = target([1.0_f32, 0.0], ActionMode::Relative, position);
        assert_eq!(goal, [300.0, 200.0]);
        assert_eq!(velocity(goal, position, Vec2::ZERO), vec2(f64::from(10_000.0 * 0.01_f32), 0.0));
        let goal = target([300.0, 200.0], ActionMode::Absolute, position);
        assert_eq!(velocity(goal, position, vec2(50.0, 0.0)), vec2(50.0 + 0.01 * (10_000.0 - 1000.0), 0.0));
    }
}
