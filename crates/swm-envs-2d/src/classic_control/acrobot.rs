//! Acrobot: two links swing up by a torque at the joint between them.
//!
//! Dynamics of Sutton and Barto's book, as in Gymnasium 1.2.3: fourth-order Runge-Kutta with steps of 0.2 s.

use std::f64::consts::{FRAC_PI_2, PI};

use swm_core::Space;
use swm_core::seed::Stream;
use swm_fov::{Factor, Fov};
use swm_render::{Painter, Rgb};

use super::math::{squared, turned_rectangle};
use super::task::{Step, Task, constant, uniform, value};

const GRAVITY: f64 = 9.8;
const STEP_S: f64 = 0.2;
/// Greatest angular velocities of the links.
const MAX_SPIN: [f64; 2] = [4.0 * PI, 9.0 * PI];

const BLACK: Rgb = [0, 0, 0];
const LINK: Rgb = [0, 204, 204];
const JOINT: Rgb = [204, 204, 0];
const SIDE_PX: f64 = 500.0;
const MIDDLE_PX: f64 = SIDE_PX / 2.0;

/// `swm/AcrobotControl-v1`. State: angle of the first link from hanging down, of the second from the first; their angular
/// velocities.
pub(super) struct Acrobot {
    lengths: [f64; 2],
    masses: [f64; 2],
    /// Distances of the centers of mass from the joints.
    centers: [f64; 2],
    inertia: f64,
    /// Pixels per unit of length.
    scale: f64,
}

impl Acrobot {
    /// The time derivative of a state under a torque.
    fn derivative(&self, torque: f64, [angle1, angle2, spin1, spin2]: [f64; 4]) -> [f64; 4] {
        let ([m1, m2], [l1, _], [c1, c2], inertia) = (self.masses, self.lengths, self.centers, self.inertia);
        let (sin2, cos2) = (angle2.sin(), angle2.cos());
        let d1 =
            m1 * squared(c1) + m2 * (squared(l1) + squared(c2) + 2.0 * l1 * c2 * cos2) + inertia + inertia;
        let d2 = m2 * (squared(c2) + l1 * c2 * cos2) + inertia;
        let phi2 = m2 * c2 * GRAVITY * (angle1 + angle2 - FRAC_PI_2).cos();
        let phi1 = -m2 * l1 * c2 * squared(spin2) * sin2 - 2.0 * m2 * l1 * c2 * spin2 * spin1 * sin2
            + (m1 * c1 + m2 * l1) * GRAVITY * (angle1 - FRAC_PI_2).cos()
            + phi2;
        let up2 = (torque + d2 / d1 * phi1 - m2 * l1 * c2 * squared(spin1) * sin2 - phi2)
            / (m2 * squared(c2) + inertia - squared(d2) / d1);
        let up1 = -(d2 * up2 + phi1) / d1;
        [spin1, spin2, up1, up2]
    }

    /// Energy of motion and height, which friction does not take.
    fn energy(&self, &[angle1, angle2, spin1, spin2]: &[f64; 4]) -> f64 {
        let ([m1, m2], [l1, _], [c1, c2]) = (self.masses, self.lengths, self.centers);
        let cos2 = angle2.cos();
        let d1 = m1 * c1 * c1 + m2 * (l1 * l1 + c2 * c2 + 2.0 * l1 * c2 * cos2) + 2.0 * self.inertia;
        let d2 = m2 * (c2 * c2 + l1 * c2 * cos2) + self.inertia;
        let d3 = m2 * c2 * c2 + self.inertia;
        let motion = 0.5 * d1 * spin1 * spin1 + d2 * spin1 * spin2 + 0.5 * d3 * spin2 * spin2;
        let height = -(m1 * c1 + m2 * l1) * angle1.cos() - m2 * c2 * (angle1 + angle2).cos();
        motion + GRAVITY * height
    }

    /// The joints and the end, in pixels of the surface.
    fn joints(&self, &[angle1, angle2, ..]: &[f64; 4]) -> [[f64; 2]; 3] {
        let [l1, l2] = self.lengths;
        let turn = angle1 + angle2;
        let [x1, y1] = [l1 * angle1.sin() * self.scale, -l1 * angle1.cos() * self.scale];
        let [x2, y2] = [x1 + l2 * turn.sin() * self.scale, y1 - l2 * turn.cos() * self.scale];
        [[0.0, 0.0], [x1, y1], [x2, y2]].map(|joint| joint.map(|coordinate| coordinate + MIDDLE_PX))
    }
}

/// Whether the end is above the line, at the height of one unit above the fixed joint, for links of length 1.
fn is_up(&[angle1, angle2, ..]: &[f64; 4]) -> bool {
    -angle1.cos() - (angle2 + angle1).cos() > 1.0
}

/// An angle brought into [-π, π] by whole turns.
fn wrapped(mut angle: f64) -> f64 {
    let turn = PI - -PI;
    while angle > PI {
        angle -= turn;
    }
    while angle < -PI {
        angle += turn;
    }
    angle
}

impl Task for Acrobot {
    const ID: &'static str = "swm/AcrobotControl-v1";
    const SUMMARY: &'static str = "swing the end of two links above a line by a torque at their joint";
    const SUCCESS: &'static str = "the tip above the line";
    const PLANNER: &'static str = "categorical-cem:samples=64,elites=8,iterations=3,horizon=10,receding_horizon=2,\
                                   action_block=2";
    const TIME_LIMIT: u64 = 500;
    const TIME_STEP_S: f64 = STEP_S;
    const OBSERVATION_DIM: usize = 6;
    const STATE_DIM: usize = 4;
    const SURFACE: [usize; 2] = [500, 500];
    const COLORS: &'static [(Rgb, &'static str)] = &[
        ([255; 3], "visuals.bg"),
        (LINK, "visuals.link"),
        (JOINT, "visuals.joint"),
        (BLACK, "visuals.line"),
    ];
    type State = [f64; 4];

    fn action_space() -> Space {
        Space::Discrete { n: 3, start: 0 }
    }

    fn physics() -> Vec<Factor> {
        vec![
            constant("physics.link_com_pos_1", 0.25, 0.75, 0.5)
                .doc("distance of the first link's center of mass from its joint, m"),
            constant("physics.link_com_pos_2", 0.25, 0.75, 0.5)
                .doc("distance of the second link's center of mass from its joint, m"),
            constant("physics.link_length_1", 0.5, 1.5, 1.0).doc("length of the first link, m"),
            constant("physics.link_length_2", 0.5, 1.5, 1.0)
                .doc("length of the second link, m; only in images, as the dynamics do not depend on it"),
            constant("physics.link_mass_1", 0.5, 1.5, 1.0).doc("mass of the first link, kg"),
            constant("physics.link_mass_2", 0.5, 1.5, 1.0).doc("mass of the second link, kg"),
            constant("physics.link_moi", 0.5, 1.5, 1.0).doc("moment of inertia of either link, kg m²"),
        ]
    }

    fn new(fov: &Fov) -> Self {
        let pair = |name: &str| [1, 2].map(|link| value(fov, &format!("physics.{name}_{link}")));
        let lengths = pair("link_length");
        Self {
            lengths,
            masses: pair("link_mass"),
            centers: pair("link_com_pos"),
            inertia: value(fov, "physics.link_moi"),
            scale: SIDE_PX / ((lengths[0] + lengths[1] + 0.2) * 2.0),
        }
    }

    fn start(&self, stream: &mut Stream) -> [f64; 4] {
        [(); 4].map(|()| f64::from(uniform(stream, -0.1, 0.1) as f32))
    }

    fn step(&self, state: &mut [f64; 4], action: f32, _: bool) -> Step {
        let torque = f64::from(action) - 1.0;
        let y = *state;
        let after = |time: f64, k: [f64; 4]| std::array::from_fn(|i| y[i] + time * k[i]);
        let k1 = self.derivative(torque, y);
        let k2 = self.derivative(torque, after(STEP_S / 2.0, k1));
        let k3 = self.derivative(torque, after(STEP_S / 2.0, k2));
        let k4 = self.derivative(torque, after(STEP_S, k3));
        let next: [f64; 4] =
            std::array::from_fn(|i| y[i] + STEP_S / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        *state = [
            wrapped(next[0]),
            wrapped(next[1]),
            next[2].clamp(-MAX_SPIN[0], MAX_SPIN[0]),
            next[3].clamp(-MAX_SPIN[1], MAX_SPIN[1]),
        ];
        let terminated = is_up(state);
        Step { reward: if terminated { 0.0 } else { -1.0 }, terminated }
    }

    fn observe(&self, &[angle1, angle2, spin1, spin2]: &[f64; 4], out: &mut [f32]) {
        let values = [angle1.cos(), angle1.sin(), angle2.cos(), angle2.sin(), spin1, spin2];
        out.copy_from_slice(&values.map(|value| value as f32));
    }

    fn observed(&self, observation: &[f64]) -> [f64; 4] {
        let [cos1, sin1, cos2, sin2, spin1, spin2] =
            observation.try_into().expect("the caller checks its dims");
        [f64::atan2(sin1, cos1), f64::atan2(sin2, cos2), spin1, spin2]
    }

    fn is_success(&self, state: &[f64; 4], _: u64) -> bool {
        is_up(state)
    }

    fn cost(&self, state: &[f64; 4]) -> f64 {
        if is_up(state) {
            return -1.0;
        }
        let straight_up = self.energy(&[PI, 0.0, 0.0, 0.0]);
        let hanging = self.energy(&[0.0; 4]);
        let lacking = ((straight_up - self.energy(state)) / (straight_up - hanging)).max(0.0);
        let height = -state[0].cos() - (state[0] + state[1]).cos();
        lacking + 0.1 * (1.0 - height)
    }

    /// Turns the joint the way that it turns: the torque does work on it.
    fn act(&self, &[.., spin2]: &[f64; 4]) -> f32 {
        if spin2 >= 0.0 { 2.0 } else { 0.0 }
    }

    fn render_background(&self, painter: &mut dyn Painter) {
        painter.fill([255; 3]);
        let height = self.scale + MIDDLE_PX;
        let end = |side: f64| [side * 2.2 * self.scale + MIDDLE_PX, height];
        painter.axis_line(end(-1.0), end(1.0), BLACK);
    }

    fn render(&self, state: &[f64; 4], _: f32, painter: &mut dyn Painter) {
        let joints = self.joints(state);
        let half = 0.1 * self.scale;
        let turns = [state[0] - FRAC_PI_2, state[0] + state[1] - FRAC_PI_2];
        for ((joint, turn), length) in joints.into_iter().zip(turns).zip(self.lengths) {
            let link = turned_rectangle([0.0, length * self.scale], [-half, half], turn, joint);
            painter.smooth_polygon(&link, LINK);
            painter.smooth_disc(joint, half, JOINT);
        }
    }

    fn place(&self, state: &[f64; 4]) -> (&'static str, [f64; 2]) {
        ("end", self.joints(state)[2])
    }
}
