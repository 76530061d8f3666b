//! One control step, 1/120 s, and what it is worth: the reference's reward, and when an episode ends.

use nalgebra::Vector3;

use super::contact::{Stage, Touch};
use super::flight::{Conditions, actuate, fly};
use super::state::State;
use crate::attitude::{euler, exp, world_from_body};

/// Physics steps per control step.
pub(super) const PHYSICS_STEPS: usize = 2;
/// The flight is over beyond this distance from the axis of the pad, and above this height, m.
const DOME: [f64; 2] = [200.0, 500.0];
/// A touch at more than this angular or linear speed (rad/s, m/s) breaks the rocket.
const BREAKS_ABOVE: [f64; 2] = [10.0, 5.0];
/// A landing is slower than this, leans less (rad), is nearer to the axis and lower (m).
const LANDS_BELOW: [f64; 2] = [5.0, 4.0];
const LANDS_LEANING: f64 = 0.6;
const LANDS_NEAR: f64 = 12.0;
const LANDS_LOW: f64 = 3.0;

/// What ended an episode, if anything did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct End {
    pub(super) out_of_bounds: bool,
    pub(super) fatal_collision: bool,
    /// The rocket has landed.
    pub(super) env_complete: bool,
}

impl End {
    /// Whether anything did.
    pub(super) fn any(self) -> bool {
        self.out_of_bounds || self.fatal_collision || self.env_complete
    }
}

/// What rewards and landings depend on.
#[derive(Clone, Copy, Debug)]
struct View {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// Angular velocity in the body frame.
    body_spin: Vector3<f64>,
    /// Length of the vector of roll and pitch.
    lean: f64,
}

impl View {
    fn of(state: &State) -> Self {
        let [roll, pitch, _] = euler(state.attitude);
        Self {
            position: state.position.into(),
            velocity: state.velocity.into(),
            body_spin: world_from_body(state.attitude).transpose() * Vector3::from(state.spin),
            lean: (roll * roll + pitch * pitch).sqrt(),
        }
    }

    /// Distance from the axis of the pad.
    fn off_axis(&self) -> f64 {
        self.position.xy().norm()
    }
}

/// Two physics steps. Returns the reward and what they ended. `noise`: samples of the throttle's.
pub(super) fn control_step(
    conditions: &Conditions,
    stage: &mut Stage,
    state: &mut State,
    noise: &[f64; PHYSICS_STEPS],
    is_sparse: bool,
) -> (f64, End) {
    let before = View::of(state);
    let mut touch = Touch::default();
    for &noise in noise {
        touch = touch.or(physics_step(conditions, stage, state, noise));
    }
    state.pad_contact = [state.pad_contact[1], touch.pad];
    let now = View::of(state);
    let mut end = End {
        out_of_bounds: now.off_axis() > DOME[0] || now.position.z > DOME[1],
        fatal_collision: touch.floor || now.position.z < 0.0,
        env_complete: false,
    };
    let mut reward = if is_sparse { 0.0 } else { shaped_reward(&before, &now) };
    if touch.pad {
        reward += 5.0 - 0.3 * now.velocity.z.abs();
        let (spin, speed) = (before.body_spin.norm(), before.velocity.norm());
        if spin > BREAKS_ABOVE[0] || speed > BREAKS_ABOVE[1] {
            end.fatal_collision = true;
        } else if spin < LANDS_BELOW[0]
            && speed < LANDS_BELOW[1]
            && now.lean < LANDS_LEANING
            && now.off_axis() < LANDS_NEAR
            && now.position.z < LANDS_LOW
        {
            end.env_complete = true;
            reward += 3.0;
        }
    }
    (reward, end)
}

/// One physics step, and what touched at its start.
pub(super) fn physics_step(
    conditions: &Conditions,
    stage: &mut Stage,
    state: &mut State,
    noise: f64,
) -> Touch {
    let touch = stage.touch(state);
    let load = actuate(conditions, state, noise);
    if touch.any() {
        stage.step(conditions, state, &load);
    } else {
        fly(conditions, state, &load);
    }
    touch
}

fn shaped_reward(before: &View, now: &View) -> f64 {
    let braking = 4.0 * (now.velocity.z - before.velocity.z + 1.0) / exp(now.position.z);
    -0.3 + 0.3 / (now.off_axis() + 0.1)
        + 10.0 * (before.off_axis() - now.off_axis())
        + 0.2 * (before.position.z - now.position.z)
        + if now.velocity.z < 0.0 { braking } else { -braking }
        - now.body_spin.z.abs()
        - now.lean
}
