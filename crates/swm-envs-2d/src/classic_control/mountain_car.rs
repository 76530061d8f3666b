//! MountainCar: a car too weak for a hill swings up to a flag, by discrete or continuous pushes.
//!
//! Dynamics of Moore (1990), as in Gymnasium 1.2.3. The continuous car computes in f32 from its first step on, as NumPy does
//! with the state that Gymnasium stores.

use swm_core::seed::Stream;
use swm_core::{Dtype, Space};
use swm_fov::{Factor, Fov};
use swm_render::{Painter, Rgb};

use super::math::{rotated, turned_rectangle};
use super::task::{Step, Task, constant, uniform, value};

/// The ends of the world.
const MIN_X: f64 = -1.2;
const MAX_X: f64 = 0.6;

const BLACK: Rgb = [0, 0, 0];
const WHEEL: Rgb = [128, 128, 128];
const FLAG: Rgb = [204, 204, 0];
const SURFACE: [usize; 2] = [400, 600];
const COLORS: &[(Rgb, &str)] = &[([255; 3], "visuals.bg"), (BLACK, "visuals.fg")];
/// Pixels per unit of length.
const SCALE: f64 = 600.0 / (MAX_X - MIN_X);
/// Points of the hill's outline.
const OUTLINE: u32 = 100;
/// Height of the car's underside above the hill, and sizes, pixels.
const CLEARANCE_PX: f64 = 10.0;
const CAR_PX: [f64; 2] = [40.0, 20.0];
/// Gymnasium shows 30 steps per second; the dynamics have no unit of time.
const TIME_STEP_S: f64 = 1.0 / 30.0;

/// `swm/MountainCarControl-v0`. State: place x, velocity.
pub(super) struct MountainCar {
    force: f64,
    gravity: f64,
    max_speed: f64,
}

/// `swm/MountainCarContinuousControl-v0`. State: place x, velocity.
pub(super) struct MountainCarContinuous {
    power: f32,
    max_speed: f64,
}

/// Gravity of the continuous car, which no factor changes.
const CONTINUOUS_GRAVITY: f64 = 0.0025;

fn height(x: f64) -> f64 {
    (3.0 * x).sin() * 0.45 + 0.55
}

/// Where a place of the hill is on the surface.
fn on_surface(x: f64) -> [f64; 2] {
    [(x - MIN_X) * SCALE, height(x) * SCALE]
}

/// Velocity at the left wall.
fn stopped(x: f64, wall: f64, speed: f64) -> f64 {
    if x == wall && speed < 0.0 { 0.0 } else { speed }
}

fn max_speed() -> Factor {
    constant("physics.max_speed", 0.035, 0.105, 0.07).doc("greatest speed, length per step")
}

fn start(stream: &mut Stream) -> [f64; 2] {
    [uniform(stream, -0.6, -0.4), 0.0]
}

fn observe(state: &[f64; 2], out: &mut [f32]) {
    for (out, value) in out.iter_mut().zip(state) {
        *out = *value as f32;
    }
}

/// Energy that lacks for the goal, as a share of the hill's height, and the way to it where there is enough.
fn cost(&[x, speed]: &[f64; 2], gravity: f64, goal: f64) -> f64 {
    if x >= goal {
        return -1.0;
    }
    let energy = |x: f64, speed: f64| 0.5 * speed * speed + gravity / 3.0 * (3.0 * x).sin();
    let lacking = (energy(goal, 0.0) - energy(x, speed)) / (gravity / 1.5);
    lacking + 0.1 * (goal - x)
}

fn render_background(painter: &mut dyn Painter) {
    painter.fill([255; 3]);
    // The steps of NumPy's linspace.
    let step = (MAX_X - MIN_X) / f64::from(OUTLINE - 1);
    let place = |i: u32| on_surface(if i == OUTLINE - 1 { MAX_X } else { f64::from(i) * step + MIN_X });
    for i in 1..OUTLINE {
        painter.smooth_line(place(i - 1), place(i), BLACK);
    }
}

fn render(x: f64, goal: f64, painter: &mut dyn Painter) {
    // The slope of the hill is not this angle; Gymnasium turns the car by it.
    let angle = (3.0 * x).cos();
    let [left, ground] = on_surface(x);
    let under = [left, CLEARANCE_PX + ground];
    let [width, tall] = CAR_PX;
    painter.smooth_polygon(&turned_rectangle([-width / 2.0, width / 2.0], [0.0, tall], angle, under), BLACK);
    for side in [width / 4.0, -width / 4.0] {
        let [dx, dy] = rotated([side, 0.0], angle);
        painter.smooth_disc([dx + under[0], dy + under[1]], tall / 2.5, WHEEL);
    }
    let [flag, foot] = on_surface(goal).map(f64::trunc);
    let top = foot + 50.0;
    painter.axis_line([flag, foot], [flag, top], BLACK);
    painter.smooth_polygon(&[[flag, top], [flag, top - 10.0], [flag + 25.0, top - 5.0]], FLAG);
}

fn place(x: f64) -> (&'static str, [f64; 2]) {
    let [left, ground] = on_surface(x);
    ("car", [left, ground + CLEARANCE_PX])
}

impl MountainCar {
    const GOAL: f64 = 0.5;
}

impl Task for MountainCar {
    const ID: &'static str = "swm/MountainCarControl-v0";
    const SUMMARY: &'static str = "swing a weak car up a hill to a flag; three discrete pushes";
    const SUCCESS: &'static str = "at x = 0.5 or beyond, not rolling back";
    const PLANNER: &'static str = "categorical-cem:samples=64,elites=8,iterations=3,horizon=10,receding_horizon=2,\
                                   action_block=5";
    const TIME_LIMIT: u64 = 200;
    const TIME_STEP_S: f64 = TIME_STEP_S;
    const OBSERVATION_DIM: usize = 2;
    const STATE_DIM: usize = 2;
    const SURFACE: [usize; 2] = SURFACE;
    const COLORS: &'static [(Rgb, &'static str)] = COLORS;
    type State = [f64; 2];

    fn action_space() -> Space {
        Space::Discrete { n: 3, start: 0 }
    }

    fn physics() -> Vec<Factor> {
        vec![
            constant("physics.force", 0.0005, 0.0015, 0.001).doc("acceleration by a push"),
            constant("physics.gravity", 0.00125, 0.00375, 0.0025).doc("gravity"),
            max_speed(),
        ]
    }

    fn new(fov: &Fov) -> Self {
        Self {
            force: value(fov, "physics.force"),
            gravity: value(fov, "physics.gravity"),
            max_speed: value(fov, "physics.max_speed"),
        }
    }

    fn start(&self, stream: &mut Stream) -> [f64; 2] {
        start(stream)
    }

    fn step(&self, state: &mut [f64; 2], action: f32, _: bool) -> Step {
        let [mut x, mut speed] = *state;
        speed += (f64::from(action) - 1.0) * self.force + (3.0 * x).cos() * -self.gravity;
        speed = speed.clamp(-self.max_speed, self.max_speed);
        x = (x + speed).clamp(MIN_X, MAX_X);
        *state = [x, stopped(x, MIN_X, speed)];
        Step { reward: -1.0, terminated: x >= Self::GOAL && state[1] >= 0.0 }
    }

    fn observe(&self, state: &[f64; 2], out: &mut [f32]) {
        observe(state, out);
    }

    fn observed(&self, observation: &[f64]) -> [f64; 2] {
        observation.try_into().expect("the caller checks its dims")
    }

    fn is_success(&self, &[x, speed]: &[f64; 2], _: u64) -> bool {
        x >= Self::GOAL && speed >= 0.0
    }

    fn cost(&self, state: &[f64; 2]) -> f64 {
        cost(state, self.gravity, Self::GOAL)
    }

    /// Pushes the way that the car rolls.
    fn act(&self, &[_, speed]: &[f64; 2]) -> f32 {
        if speed >= 0.0 { 2.0 } else { 0.0 }
    }

    fn render_background(&self, painter: &mut dyn Painter) {
        render_background(painter);
    }

    fn render(&self, &[x, _]: &[f64; 2], _: f32, painter: &mut dyn Painter) {
        render(x, Self::GOAL, painter);
    }

    fn place(&self, &[x, _]: &[f64; 2]) -> (&'static str, [f64; 2]) {
        place(x)
    }
}

impl MountainCarContinuous {
    const GOAL: f64 = 0.45;

    /// The change of velocity, in f32: by the action, and by gravity at `angle` = 3 x.
    fn push(&self, action: f32, angle: f64) -> f32 {
        action.clamp(-1.0, 1.0) * self.power - (CONTINUOUS_GRAVITY * angle.cos()) as f32
    }

    /// Whether a state is one of f32 numbers, as all are but the first of an episode.
    fn single([x, speed]: [f64; 2]) -> Option<[f32; 2]> {
        let single = [x as f32, speed as f32];
        (single.map(f64::from) == [x, speed]).then_some(single)
    }
}

impl Task for MountainCarContinuous {
    const ID: &'static str = "swm/MountainCarContinuousControl-v0";
    const SUMMARY: &'static str = "swing a weak car up a hill to a flag; continuous pushes, which cost";
    const SUCCESS: &'static str = "at x = 0.45 or beyond, not rolling back";
    const PLANNER: &'static str =
        "icem:samples=64,elites=8,iterations=3,horizon=10,receding_horizon=2,action_block=5";
    const TIME_LIMIT: u64 = 999;
    const TIME_STEP_S: f64 = TIME_STEP_S;
    const OBSERVATION_DIM: usize = 2;
    const STATE_DIM: usize = 2;
    const SURFACE: [usize; 2] = SURFACE;
    const COLORS: &'static [(Rgb, &'static str)] = COLORS;
    type State = [f64; 2];

    fn action_space() -> Space {
        Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0)
    }

    fn physics() -> Vec<Factor> {
        vec![
            max_speed(),
            constant("physics.power", 0.00075, 0.00225, 0.0015).doc("acceleration by an action of 1"),
        ]
    }

    fn new(fov: &Fov) -> Self {
        Self { power: fov.f32("physics.power"), max_speed: value(fov, "physics.max_speed") }
    }

    fn start(&self, stream: &mut Stream) -> [f64; 2] {
        start(stream)
    }

    fn step(&self, state: &mut [f64; 2], action: f32, _: bool) -> Step {
        let terminated;
        *state = match Self::single(*state) {
            Some([mut x, mut speed]) => {
                let limit = self.max_speed as f32;
                speed = (speed + self.push(action, f64::from(3.0 * x))).clamp(-limit, limit);
                x = (x + speed).clamp(MIN_X as f32, MAX_X as f32);
                speed = stopped(x.into(), f64::from(MIN_X as f32), speed.into()) as f32;
                terminated = x >= Self::GOAL as f32 && speed >= 0.0;
                [x.into(), speed.into()]
            }
            None => {
                let [mut x, mut speed] = *state;
                speed += f64::from(self.push(action, 3.0 * x));
                speed = speed.clamp(-self.max_speed, self.max_speed);
                x = (x + speed).clamp(MIN_X, MAX_X);
                speed = stopped(x, MIN_X, speed);
                terminated = x >= Self::GOAL && speed >= 0.0;
                [x, speed].map(|value| f64::from(value as f32))
            }
        };
        let effort = f64::from(action) * f64::from(action);
        Step { reward: f64::from(u8::from(terminated)) * 100.0 - effort * 0.1, terminated }
    }

    fn observe(&self, state: &[f64; 2], out: &mut [f32]) {
        observe(state, out);
    }

    fn observed(&self, observation: &[f64]) -> [f64; 2] {
        observation.try_into().expect("the caller checks its dims")
    }

    fn is_success(&self, &[x, speed]: &[f64; 2], _: u64) -> bool {
        x as f32 >= Self::GOAL as f32 && speed >= 0.0
    }

    fn cost(&self, state: &[f64; 2]) -> f64 {
        cost(state, CONTINUOUS_GRAVITY, Self::GOAL)
    }

    /// Pushes the way that the car rolls.
    fn act(&self, &[_, speed]: &[f64; 2]) -> f32 {
        if speed >= 0.0 { 1.0 } else { -1.0 }
    }

    fn render_background(&self, painter: &mut dyn Painter) {
        render_background(painter);
    }

    fn render(&self, &[x, _]: &[f64; 2], _: f32, painter: &mut dyn Painter) {
        render(x, Self::GOAL, painter);
    }

    fn place(&self, &[x, _]: &[f64; 2]) -> (&'static str, [f64; 2]) {
        place(x)
    }
}
