//! How to land: the descent that keeps enough thrust to brake, and the attitude that leads to the axis of the pad.
//!
//! The engine cannot burn below 39 % of its thrust, which lifts the rocket. Less than that is pulsed.

use nalgebra::Vector3;

use super::aerodynamics::{DRAG_AREA, HALF_DENSITY};
use super::body::{BOOSTER, FIN_PLACE, MassProperties};
use super::flight::{Conditions, GIMBAL_LIMIT_DEG, GRAVITY, MAX_THRUST, MIN_THROTTLE, MIN_THRUST};
use super::rules::End;
use super::state::{ACTION_DIM, State};
use crate::attitude::world_from_body;

/// The descent ends at this height of the origin, m.
const TOUCHDOWN: f64 = 2.6;
/// Speed at its end, m/s.
const TOUCHDOWN_SPEED: f64 = 1.5;
/// Greatest speed, m/s.
const MAX_SPEED: f64 = 30.0;
/// Deceleration of the descent, m/s², and the share of what the engine can do that it may take.
const BRAKING: f64 = 10.0;
const BRAKING_SHARE: f64 = 0.75;
/// How fast a wrong speed is corrected, 1/s.
const SPEED_GAIN: f64 = 3.0;
/// Who is slower than the descent by this much does not brake, m/s.
const SLACK: f64 = 1.0;
/// Sideways acceleration per distance from the axis and per velocity, and its limit, m/s².
const SIDE_GAINS: [f64; 2] = [0.3, 0.9];
const SIDE_LIMIT: f64 = 1.6;
/// Angular acceleration per leaning and per angular velocity.
const LEAN_GAINS: [f64; 2] = [6.0, 4.0];
/// Lift of the two surfaces of an axis at full deflection, N s²/m².
const FIN_LIFT: f64 = 2.0 * HALF_DENSITY * 0.25 * 0.74;
/// Fins that turn less than this, N m, are left alone.
const LEAST_FIN_TORQUE: f64 = 20.0;
/// Costs per squared error of the sideways velocity, of the direction of thrust and of the angular velocity, beside that of
/// the descent; and of what ends the flight.
const SIDE_COST: f64 = 1.0;
const LEAN_COST: f64 = 60.0;
const SPIN_COST: f64 = 4.0;
const CRASH_COST: f64 = 1e4;
const LANDED_COST: f64 = -1e3;

/// The velocity along z and the deceleration of the descent at a height of the origin.
fn descent(mass: f64, height: f64) -> (f64, f64) {
    let braking = BRAKING.min(BRAKING_SHARE * (MAX_THRUST / mass - GRAVITY));
    let above = (height - TOUCHDOWN).max(0.0);
    let speed = (2.0 * braking * above + TOUCHDOWN_SPEED * TOUCHDOWN_SPEED).sqrt();
    (-speed.min(MAX_SPEED), if speed < MAX_SPEED && height > TOUCHDOWN { braking } else { 0.0 })
}

/// The acceleration by drag in the wind along x and y, m/s², of a rocket that does not move sideways.
fn drift(conditions: &Conditions, mass: f64) -> [f64; 2] {
    conditions.wind.map(|wind| HALF_DENSITY * DRAG_AREA[0] * wind * wind.abs() / mass)
}

/// The controller's memory: the share of a pulse that is due.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pilot {
    due: f64,
}

impl Pilot {
    /// The action in a state.
    pub(super) fn act(&mut self, conditions: &Conditions, state: &State) -> [f64; ACTION_DIM] {
        let properties = MassProperties::new(conditions.dry_mass, state.fuel);
        let mass = properties.mass;
        let [.., z] = state.position;
        let (speed, braking) = descent(mass, z);
        // Who is slower than the descent needs to brake less: the least thrust would stop the fall above the pad.
        let slack = (state.velocity[2] - speed).max(0.0);
        let pull = GRAVITY + braking * (1.0 - slack / SLACK).max(0.0);
        let wanted = mass * (pull + SPEED_GAIN * (speed - state.velocity[2])).max(0.0);
        let (is_lit, thrust) = if wanted >= MIN_THRUST {
            (true, wanted.min(MAX_THRUST))
        } else {
            self.due += wanted / MIN_THRUST;
            let fires = self.due >= 1.0;
            self.due -= if fires { 1.0 } else { 0.0 };
            (fires, MIN_THRUST)
        };
        let level = (thrust / MAX_THRUST - MIN_THROTTLE) / (1.0 - MIN_THROTTLE);
        let (fin, gimbal) = steer(conditions, &properties, state, pull, thrust);
        let [on, level] = if is_lit { [1.0, level] } else { [0.0; 2] };
        [fin, 0.0, 0.0, on, level, gimbal[0], gimbal[1]]
    }
}

/// Where the thrust should point: in the body frame, the rotation from the nose to it (its sine about x and y).
fn lean_error(conditions: &Conditions, mass: f64, state: &State, pull: f64) -> Vector3<f64> {
    let world = world_from_body(state.attitude);
    let wind = drift(conditions, mass);
    let side = [0, 1].map(|axis| {
        let back = SIDE_GAINS[0] * state.position[axis] + SIDE_GAINS[1] * state.velocity[axis];
        (-back - wind[axis]).clamp(-SIDE_LIMIT, SIDE_LIMIT)
    });
    let wanted = Vector3::new(side[0], side[1], pull).normalize();
    world.transpose() * (world * Vector3::z()).cross(&wanted)
}

/// Deflection of the fins on the x axis and of the gimbal, shares of their limits, that turn the rocket towards where it
/// must push. About y the fins take what they can: they work between the engine's pulses, too. The surfaces that turn
/// about x are at tank and booster, where they push sideways more than they turn.
fn steer(
    conditions: &Conditions,
    properties: &MassProperties,
    state: &State,
    pull: f64,
    thrust: f64,
) -> (f64, [f64; 2]) {
    let error = lean_error(conditions, properties.mass, state, pull);
    let body = world_from_body(state.attitude).transpose();
    let (spin, velocity) = (body * Vector3::from(state.spin), body * Vector3::from(state.velocity));
    let mut torques = [0, 1].map(|axis| {
        let turn = LEAN_GAINS[0] * error[axis] - LEAN_GAINS[1] * spin[axis];
        turn * properties.inertia[axis]
    });
    let by_fins = FIN_LIFT * velocity.z * velocity.z * (FIN_PLACE[1] - properties.center_z);
    let fin = if by_fins > LEAST_FIN_TORQUE { (torques[1] / by_fins).clamp(-1.0, 1.0) } else { 0.0 };
    torques[1] -= fin * by_fins;
    let arm = properties.center_z - BOOSTER[2];
    let share = |torque: f64| (-(torque / (arm * thrust)).to_degrees() / GIMBAL_LIMIT_DEG).clamp(-1.0, 1.0);
    (fin, torques.map(share))
}

/// How far a state is from the descent: lower is better.
pub(super) fn cost(conditions: &Conditions, state: &State, end: End) -> f64 {
    if end.fatal_collision || end.out_of_bounds {
        return CRASH_COST;
    }
    if end.env_complete {
        return LANDED_COST;
    }
    let mass = MassProperties::new(conditions.dry_mass, state.fuel).mass;
    let (speed, braking) = descent(mass, state.position[2]);
    let [x, y, z] = state.position;
    let [vx, vy, vz] = state.velocity;
    // As fast towards the axis as the pilot would be.
    let approach = SIDE_GAINS[0] / SIDE_GAINS[1];
    let side = (vx + approach * x).hypot(vy + approach * y);
    let error = lean_error(conditions, mass, state, GRAVITY + braking);
    let spin = Vector3::from(state.spin).norm_squared();
    // Over the pad, a little faster than the descent: hovering there costs.
    let fall = vz - speed + 0.1 * (z - TOUCHDOWN).clamp(0.0, 1.0);
    fall * fall + SIDE_COST * side * side + LEAN_COST * error.norm_squared() + SPIN_COST * spin
}

#[cfg(test)]
mod tests {
    use super::super::body::DRY_MASS;
    use super::*;

    #[test]
    fn the_descent_brakes_as_hard_as_the_engine_can() {
        let (speed, braking) = descent(158.7, 400.0);
        assert_eq!((speed, braking), (-MAX_SPEED, 0.0));
        assert_eq!(descent(158.7, TOUCHDOWN), (-TOUCHDOWN_SPEED, 0.0));
        let (speed, braking) = descent(158.7, TOUCHDOWN + 5.0);
        assert!(
            braking == BRAKING && (speed * speed - 100.0 - TOUCHDOWN_SPEED * TOUCHDOWN_SPEED).abs() < 1e-9
        );
        let full = MassProperties::new(DRY_MASS, 1.0).mass;
        let (_, braking) = descent(full, TOUCHDOWN + 1.0);
        assert!(braking > 1.0 && full * (GRAVITY + braking) < MAX_THRUST, "{braking}");
    }

    #[test]
    fn weak_thrust_is_pulsed() {
        let conditions = Conditions { dry_mass: DRY_MASS, wind: [0.0; 2] };
        let mut state = State::landed(0.05);
        state.position[2] = 400.0;
        state.velocity[2] = -MAX_SPEED;
        let mut pilot = Pilot::default();
        let lit = (0..100).filter(|_| pilot.act(&conditions, &state)[3] == 1.0).count();
        // Weight over the least thrust.
        assert!((50..55).contains(&lit), "{lit} of 100 steps");
    }
}
