//! CartPole: a pole on a cart, kept upright by pushing the cart left or right.
//!
//! Dynamics of Barto, Sutton and Anderson (1983), as in Gymnasium 1.2.3: explicit Euler with the old velocities.

use std::f64::consts::PI;

use swm_core::Space;
use swm_core::seed::Stream;
use swm_fov::{Factor, Fov};
use swm_render::{Painter, Rgb};

use super::math::turned_rectangle;
use super::task::{Step, Task, constant, uniform, value};

/// The episode ends beyond these: place of the cart, angle of the pole (12 degrees).
const MAX_X: f64 = 2.4;
const MAX_ANGLE: f64 = 12.0 * 2.0 * PI / 360.0;

const BLACK: Rgb = [0, 0, 0];
const POLE: Rgb = [202, 152, 101];
const AXLE: Rgb = [129, 132, 203];

/// Pixels per unit of length.
const SCALE: f64 = 600.0 / (2.0 * MAX_X);
/// Height of the track, and of the axle above it, pixels.
const TRACK_PX: f64 = 100.0;
const AXLE_PX: f64 = 7.5;
const POLE_WIDTH_PX: f64 = 10.0;

/// `swm/CartPoleControl-v1`. State: place x, velocity of the cart; angle from upright, angular velocity of the pole.
pub(super) struct CartPole {
    gravity: f64,
    cart_mass: f64,
    pole_mass: f64,
    /// Half the pole's length.
    length: f64,
    force: f64,
    time_step_s: f64,
}

impl CartPole {
    fn total_mass(&self) -> f64 {
        self.pole_mass + self.cart_mass
    }
}

fn is_out(&[x, _, angle, _]: &[f64; 4]) -> bool {
    !(-MAX_X..=MAX_X).contains(&x) || !(-MAX_ANGLE..=MAX_ANGLE).contains(&angle)
}

impl Task for CartPole {
    const ID: &'static str = "swm/CartPoleControl-v1";
    const SUMMARY: &'static str = "keep a pole upright by pushing its cart left or right";
    const SUCCESS: &'static str = "upright after 500 steps";
    const PLANNER: &'static str = "categorical-cem:samples=64,elites=8,iterations=3,horizon=12,receding_horizon=1,\
                                   action_block=1";
    const TIME_LIMIT: u64 = 500;
    const TIME_STEP_S: f64 = 0.02;
    const OBSERVATION_DIM: usize = 4;
    const STATE_DIM: usize = 4;
    const SURFACE: [usize; 2] = [400, 600];
    const COLORS: &'static [(Rgb, &'static str)] =
        &[([255; 3], "visuals.bg"), (BLACK, "visuals.cart"), (POLE, "visuals.pole"), (AXLE, "visuals.axle")];
    type State = [f64; 4];

    fn action_space() -> Space {
        Space::Discrete { n: 2, start: 0 }
    }

    fn physics() -> Vec<Factor> {
        vec![
            constant("physics.force_mag", 5.0, 15.0, 10.0).doc("force of an action, N"),
            constant("physics.gravity", 4.9, 14.7, 9.8).doc("gravity, m/s²"),
            constant("physics.length", 0.25, 0.75, 0.5).doc("half the length of the pole, m"),
            constant("physics.masscart", 0.5, 1.5, 1.0).doc("mass of the cart, kg"),
            constant("physics.masspole", 0.05, 0.5, 0.1).doc("mass of the pole, kg"),
            constant("physics.tau", 0.01, 0.04, 0.02).doc("duration of a step, s"),
        ]
    }

    fn new(fov: &Fov) -> Self {
        Self {
            gravity: value(fov, "physics.gravity"),
            cart_mass: value(fov, "physics.masscart"),
            pole_mass: value(fov, "physics.masspole"),
            length: value(fov, "physics.length"),
            force: value(fov, "physics.force_mag"),
            time_step_s: value(fov, "physics.tau"),
        }
    }

    fn start(&self, stream: &mut Stream) -> [f64; 4] {
        [(); 4].map(|()| uniform(stream, -0.05, 0.05))
    }

    fn step(&self, state: &mut [f64; 4], action: f32, has_ended: bool) -> Step {
        let [x, speed, angle, spin] = *state;
        let force = if action == 1.0 { self.force } else { -self.force };
        let (cos, sin) = (angle.cos(), angle.sin());
        let pole_moment = self.pole_mass * self.length;
        let pushed = (force + pole_moment * (spin * spin) * sin) / self.total_mass();
        let spin_up = (self.gravity * sin - cos * pushed)
            / (self.length * (4.0 / 3.0 - self.pole_mass * (cos * cos) / self.total_mass()));
        let speed_up = pushed - pole_moment * spin_up * cos / self.total_mass();
        let tau = self.time_step_s;
        *state = [x + tau * speed, speed + tau * speed_up, angle + tau * spin, spin + tau * spin_up];
        let terminated = is_out(state);
        Step { reward: if terminated && has_ended { 0.0 } else { 1.0 }, terminated }
    }

    fn observe(&self, state: &[f64; 4], out: &mut [f32]) {
        for (out, value) in out.iter_mut().zip(state) {
            *out = *value as f32;
        }
    }

    fn observed(&self, observation: &[f64]) -> [f64; 4] {
        observation.try_into().expect("the caller checks its dims")
    }

    /// Balanced for as long as an episode of Gymnasium lasts.
    fn is_success(&self, state: &[f64; 4], steps: u64) -> bool {
        steps >= Self::TIME_LIMIT && !is_out(state)
    }

    fn cost(&self, state: &[f64; 4]) -> f64 {
        let [x, speed, angle, spin] = *state;
        let fallen = if is_out(state) { 10.0 } else { 0.0 };
        let squares = [x / MAX_X, 0.2 * speed, angle / MAX_ANGLE, 0.2 * spin].map(|part| part * part);
        fallen + squares.iter().sum::<f64>()
    }

    /// Pushes towards where the pole falls, in units of the time in which it does, and a little towards the middle.
    fn act(&self, &[x, speed, angle, spin]: &[f64; 4]) -> f32 {
        let inertia = self.length * (4.0 / 3.0 - self.pole_mass / self.total_mass());
        let rate = (self.gravity / inertia).sqrt();
        f32::from(u8::from(angle + spin / rate + 0.03 * x + 0.08 * speed > 0.0))
    }

    fn render_background(&self, painter: &mut dyn Painter) {
        painter.fill([255; 3]);
    }

    fn render(&self, &[x, _, angle, _]: &[f64; 4], _: f32, painter: &mut dyn Painter) {
        let cart = [x * SCALE + 300.0, TRACK_PX];
        painter.smooth_polygon(&turned_rectangle([-25.0, 25.0], [-15.0, 15.0], 0.0, cart), BLACK);
        let axle = [cart[0], cart[1] + AXLE_PX];
        let half = POLE_WIDTH_PX / 2.0;
        let length_px = SCALE * (2.0 * self.length);
        let pole = turned_rectangle([-half, half], [-half, length_px - half], -angle, axle);
        painter.smooth_polygon(&pole, POLE);
        painter.smooth_disc(axle, half, AXLE);
        painter.axis_line([0.0, TRACK_PX], [600.0, TRACK_PX], BLACK);
    }

    fn place(&self, &[x, _, angle, _]: &[f64; 4]) -> (&'static str, [f64; 2]) {
        let length_px = SCALE * 2.0 * self.length;
        ("pole", [x * SCALE + 300.0 + length_px * angle.sin(), TRACK_PX + AXLE_PX + length_px * angle.cos()])
    }
}
