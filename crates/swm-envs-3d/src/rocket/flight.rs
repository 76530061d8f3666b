//! One physics step, 1/240 s: actuators, engine, air, and the motion of a rigid body by PyBullet's update.
//!
//! PyBullet's frames of links lag one step behind: forces are computed and applied in the attitude of the step before.
//! The origin's velocity, not that of the center of mass, is what is integrated.

use nalgebra::{Matrix3, Vector3};

use super::aerodynamics::{Load, add_air_forces};
use super::body::{BOOSTER, MassProperties, TANK_MASS};
use super::state::{ACTION_DIM, State};
use crate::attitude::{sin_cos, turned, world_from_body};

/// Duration of a physics step, s.
pub(super) const PHYSICS_STEP_S: f64 = 1.0 / 240.0;
/// Gravity, m/s².
pub(super) const GRAVITY: f64 = 9.81;
/// Greatest thrust, N.
pub(super) const MAX_THRUST: f64 = 7607.0;
/// Least thrust of a burning engine, N.
pub(super) const MIN_THRUST: f64 = 2966.7;
/// Least throttle of a burning engine.
pub(super) const MIN_THROTTLE: f64 = MIN_THRUST / MAX_THRUST;
/// Greatest angle of the gimbal about each axis, degrees.
pub(super) const GIMBAL_LIMIT_DEG: f64 = 5.0;
/// Fuel that full thrust burns, kg/s.
const BURN_RATE: f64 = 1.451;
/// Time constants of fins, and of gimbal and throttle, s.
const FIN_LAG_S: f64 = 0.05;
const ENGINE_LAG_S: f64 = 0.01;
/// Share of the throttle by which its noise scales.
const NOISE_SCALE: f64 = 0.01;

/// What stays the same in an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Conditions {
    /// Mass without fuel, kg.
    pub(super) dry_mass: f64,
    /// Velocity of the air along x and y, m/s.
    pub(super) wind: [f64; 2],
}

/// Deflections that the fins are to take, from the first three values of an action.
fn fin_targets([x, y, yaw, ..]: &[f64; ACTION_DIM]) -> [f64; 4] {
    [y + yaw, y - yaw, x - yaw, x + yaw].map(|target| target.clamp(-1.0, 1.0))
}

/// Moves actuators and engine, burns fuel, and returns what acts on the body. `noise` is a sample of the throttle's.
pub(super) fn actuate(conditions: &Conditions, state: &mut State, noise: f64) -> Load {
    let world = world_from_body(state.attitude);
    let lag = world.transpose() * world_from_body(state.lagging_attitude);
    let mut load = Load::default();
    for (fin, target) in state.fins.iter_mut().zip(fin_targets(&state.action)) {
        *fin += PHYSICS_STEP_S / FIN_LAG_S * (target - *fin);
    }
    let [wind_x, wind_y] = conditions.wind;
    let velocity = world.transpose() * (Vector3::from(state.velocity) - Vector3::new(wind_x, wind_y, 0.0));
    let spin = world.transpose() * Vector3::from(state.spin);
    add_air_forces(&mut load, &state.fins, &lag, |place| lag * (velocity + spin.cross(&place)));
    let thrust = lag * engine(state, noise);
    load.force += thrust;
    load.torque += Vector3::from(BOOSTER).cross(&thrust);
    load
}

/// Moves gimbal and throttle, burns fuel, and returns the thrust in the lagging body frame.
fn engine(state: &mut State, noise: f64) -> Vector3<f64> {
    let [.., ignition, level, gimbal_x, gimbal_y] = state.action;
    let rate = PHYSICS_STEP_S / ENGINE_LAG_S;
    for (gimbal, target) in state.gimbal.iter_mut().zip([gimbal_x, gimbal_y]) {
        *gimbal += rate * (target - *gimbal);
    }
    let target = if ignition > 0.5 { level * (1.0 - MIN_THROTTLE) + MIN_THROTTLE } else { 0.0 };
    state.throttle += rate * (target - state.throttle);
    state.throttle += noise * state.throttle * NOISE_SCALE;
    if state.fuel <= 0.0 {
        state.throttle = 0.0;
    }
    let burned = state.throttle * BURN_RATE / TANK_MASS * PHYSICS_STEP_S;
    state.fuel = (state.fuel - burned).clamp(0.0, 1.0);
    let [(sin_x, cos_x), (sin_y, cos_y)] =
        state.gimbal.map(|share| sin_cos((GIMBAL_LIMIT_DEG * share).to_radians()));
    MAX_THRUST * state.throttle * Vector3::new(sin_y, -sin_x * cos_y, cos_x * cos_y)
}

/// Moves a body that touches nothing.
pub(super) fn fly(conditions: &Conditions, state: &mut State, load: &Load) {
    let properties = MassProperties::new(conditions.dry_mass, state.fuel);
    let world = world_from_body(state.attitude);
    let (velocity, spin) = accelerated(&properties, &world, state, load);
    state.lagging_attitude = state.attitude;
    state.attitude = turned(state.attitude, spin * PHYSICS_STEP_S);
    state.position = (Vector3::from(state.position) + velocity * PHYSICS_STEP_S).into();
    (state.velocity, state.spin) = (velocity.into(), spin.into());
}

/// Velocity of the origin and angular velocity after the step.
fn accelerated(
    properties: &MassProperties,
    world: &Matrix3<f64>,
    state: &State,
    load: &Load,
) -> (Vector3<f64>, Vector3<f64>) {
    let MassProperties { mass, inertia, .. } = *properties;
    let (center, inertia) = (properties.center(), Vector3::from(inertia));
    let spin = world.transpose() * Vector3::from(state.spin);
    let about_center = load.torque - center.cross(&load.force);
    let spin_up = (about_center - spin.cross(&inertia.component_mul(&spin))).component_div(&inertia);
    let of_center = world * load.force / mass - Vector3::z() * GRAVITY;
    let of_origin = of_center - world * (spin_up.cross(&center) + spin.cross(&spin.cross(&center)));
    (
        Vector3::from(state.velocity) + of_origin * PHYSICS_STEP_S,
        Vector3::from(state.spin) + world * spin_up * PHYSICS_STEP_S,
    )
}
