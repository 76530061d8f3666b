//! Pendulum: a torque swings up a rod and holds it upright.
//!
//! Dynamics of Gymnasium 1.2.3: semi-implicit Euler. The angle is 0 upright and is never wrapped.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use swm_core::seed::Stream;
use swm_core::{Dtype, Space};
use swm_fov::{Factor, Fov};
use swm_render::{Painter, Rgb};

use super::math::{modulo, rotated, squared, turned_rectangle};
use super::task::{Step, Task, constant, uniform, value};

/// Bound of an action.
const MAX_ACTION: f32 = 2.0;
/// Upright: within this of it, and slower than this.
const UPRIGHT: f64 = 8.0 * PI / 180.0;
const SLOW: f64 = 1.0;

const ROD: Rgb = [204, 77, 77];
const BLACK: Rgb = [0, 0, 0];
/// Pixels per unit of length.
const SCALE: f64 = 500.0 / (2.2 * 2.0);
const MIDDLE_PX: f64 = 250.0;
const ROD_WIDTH_PX: f64 = 0.2 * SCALE;

/// `swm/PendulumControl-v1`. State: angle, angular velocity.
pub(super) struct Pendulum {
    gravity: f64,
    mass: f64,
    length: f64,
    max_torque: f32,
    max_speed: f64,
    time_step_s: f64,
}

/// An angle as one in [-π, π).
fn wrapped(angle: f64) -> f64 {
    modulo(angle + PI, TAU) - PI
}

impl Pendulum {
    fn torque(&self, action: f32) -> f32 {
        action.clamp(-self.max_torque, self.max_torque)
    }

    /// Angular acceleration by gravity per sine of the angle, and by a torque of 1.
    fn gains(&self) -> [f64; 2] {
        [3.0 * self.gravity / (2.0 * self.length), 3.0 / (self.mass * squared(self.length))]
    }
}

impl Task for Pendulum {
    const ID: &'static str = "swm/PendulumControl-v1";
    const SUMMARY: &'static str = "swing up a pendulum by a weak torque and hold it upright";
    const SUCCESS: &'static str = "within 8° of upright, slower than 1 rad/s";
    const PLANNER: &'static str =
        "icem:samples=100,elites=10,iterations=4,horizon=12,receding_horizon=1,action_block=2";
    const TIME_LIMIT: u64 = 200;
    const TIME_STEP_S: f64 = 0.05;
    const OBSERVATION_DIM: usize = 3;
    const STATE_DIM: usize = 2;
    const SURFACE: [usize; 2] = [500, 500];
    const COLORS: &'static [(Rgb, &'static str)] =
        &[([255; 3], "visuals.bg"), (ROD, "visuals.rod"), (BLACK, "visuals.hub")];
    type State = [f64; 2];

    fn action_space() -> Space {
        Space::uniform_box(Dtype::F32, &[1], -f64::from(MAX_ACTION), f64::from(MAX_ACTION))
    }

    fn physics() -> Vec<Factor> {
        vec![
            constant("physics.dt", 0.025, 0.1, 0.05).doc("duration of a step, s"),
            constant("physics.g", 5.0, 15.0, 10.0).doc("gravity, m/s²"),
            constant("physics.l", 0.5, 1.5, 1.0).doc("length of the rod, m"),
            constant("physics.m", 0.5, 1.5, 1.0).doc("mass of the rod, kg"),
            constant("physics.max_speed", 4.0, 12.0, 8.0).doc("greatest angular speed, rad/s"),
            constant("physics.max_torque", 1.0, 4.0, 2.0)
                .doc("greatest torque, N m; above 2, the bound of actions, it changes nothing"),
        ]
    }

    fn new(fov: &Fov) -> Self {
        Self {
            gravity: value(fov, "physics.g"),
            mass: value(fov, "physics.m"),
            length: value(fov, "physics.l"),
            max_torque: fov.f32("physics.max_torque"),
            max_speed: value(fov, "physics.max_speed"),
            time_step_s: value(fov, "physics.dt"),
        }
    }

    fn start(&self, stream: &mut Stream) -> [f64; 2] {
        [uniform(stream, -PI, PI), uniform(stream, -1.0, 1.0)]
    }

    fn step(&self, state: &mut [f64; 2], action: f32, _: bool) -> Step {
        let [angle, spin] = *state;
        let torque = self.torque(action);
        let effort = f64::from(0.001_f32 * (torque * torque));
        let cost = squared(wrapped(angle)) + 0.1 * squared(spin) + effort;
        let [by_gravity, by_torque] = self.gains();
        let spin_up = by_gravity * angle.sin() + f64::from(by_torque as f32 * torque);
        let spin = (spin + spin_up * self.time_step_s).clamp(-self.max_speed, self.max_speed);
        *state = [angle + spin * self.time_step_s, spin];
        Step { reward: -cost, terminated: false }
    }

    fn observe(&self, &[angle, spin]: &[f64; 2], out: &mut [f32]) {
        out.copy_from_slice(&[angle.cos() as f32, angle.sin() as f32, spin as f32]);
    }

    fn observed(&self, observation: &[f64]) -> [f64; 2] {
        [observation[1].atan2(observation[0]), observation[2]]
    }

    fn is_success(&self, &[angle, spin]: &[f64; 2], _: u64) -> bool {
        wrapped(angle).abs() < UPRIGHT && spin.abs() < SLOW
    }

    fn cost(&self, &[angle, spin]: &[f64; 2]) -> f64 {
        wrapped(angle) * wrapped(angle) + 0.1 * spin * spin
    }

    /// Far from upright: drives the energy to that of standing there. Near it: a linear feedback that cancels gravity and
    /// brakes.
    fn act(&self, &[angle, spin]: &[f64; 2]) -> f32 {
        let [by_gravity, by_torque] = self.gains();
        let limit = f64::from(self.max_torque.min(MAX_ACTION));
        let angle = wrapped(angle);
        let rate = 1.5 * by_gravity.sqrt();
        let hold = -(by_gravity * angle.sin() + rate * rate * angle + 2.0 * rate * spin) / by_torque;
        if hold.abs() <= 2.0 * limit && angle.abs() < 1.0 {
            return hold.clamp(-limit, limit) as f32;
        }
        let energy = 0.5 * spin * spin + by_gravity * (angle.cos() - 1.0);
        let direction = if spin == 0.0 { 1.0 } else { spin.signum() };
        let share = (-energy / (0.2 * by_gravity)).clamp(-1.0, 1.0);
        (share * direction * limit) as f32
    }

    fn render_background(&self, painter: &mut dyn Painter) {
        painter.fill([255; 3]);
    }

    fn render(&self, &[angle, _]: &[f64; 2], action: f32, painter: &mut dyn Painter) {
        let middle = [MIDDLE_PX; 2];
        let (half, turn) = (ROD_WIDTH_PX / 2.0, angle + FRAC_PI_2);
        painter.smooth_polygon(&turned_rectangle([0.0, SCALE], [-half, half], turn, middle), ROD);
        painter.smooth_disc(middle, half, ROD);
        painter.smooth_disc(rotated([SCALE, 0.0], turn).map(|end| end + MIDDLE_PX), half, ROD);
        let torque = self.torque(action);
        let side = SCALE as f32 * torque.abs() / 2.0;
        painter.turn_arrow(middle, f64::from(side), torque > 0.0, BLACK);
        painter.smooth_disc(middle, 0.05 * SCALE, BLACK);
    }

    fn place(&self, &[angle, _]: &[f64; 2]) -> (&'static str, [f64; 2]) {
        let [x, y] = rotated([SCALE, 0.0], angle + FRAC_PI_2);
        ("rod", [x + MIDDLE_PX, y + MIDDLE_PX])
    }
}
