//! The expert that decides by the present row alone: OGBench's Markov oracles, one state machine for each kind of target.

use swm_core::seed::Stream;

use super::super::pose::distance;
use super::sight::{Handle, Sight, Target, nearest_turn};
use crate::suite::uniform;

/// The way to one target, and where the effector goes afterwards.
pub(super) struct Markov {
    rest: [f64; 3],
    rest_yaw: f64,
    min_norm: f64,
    steps: u32,
    most_steps: u32,
    has_arrived: bool,
}

/// What to do next: where to go, m, how far to turn, rad, and whether the gripper closes.
struct Move {
    to: [f64; 3],
    turn: f64,
    grip: f64,
}

const OPEN: f64 = -1.0;
const CLOSE: f64 = 1.0;
/// So near in the plane counts as above, m.
const ABOVE: f64 = 0.04;
/// Actions per m and per rad.
const GAINS: [f64; 2] = [5.0, 3.0];

impl Markov {
    pub(super) fn new(sight: &Sight, [low, high]: [[f64; 3]; 2], min_norm: f64, stream: &mut Stream) -> Self {
        let mut rest = [0, 1, 2].map(|k| uniform(stream, low[k], high[k]));
        let most_steps = match sight.target {
            Target::Cube { .. } => 200,
            Target::Button { .. } => 100,
            Target::Drawer(_) => 75,
            Target::Window(_) => {
                // Clear of the window's frame.
                rest[2] = uniform(stream, 0.3, high[2]);
                75
            }
        };
        let rest_yaw = uniform(stream, -std::f64::consts::PI, std::f64::consts::PI);
        Self { rest, rest_yaw, min_norm, steps: 0, most_steps, has_arrived: false }
    }

    /// Whether it has arrived, or has tried long enough.
    pub(super) fn is_done(&self) -> bool {
        self.has_arrived || self.steps >= self.most_steps
    }

    /// The action for a row.
    pub(super) fn action(&mut self, sight: &Sight) -> [f64; 5] {
        self.steps += 1;
        let next = match sight.target {
            Target::Cube { at, yaw, goal, goal_yaw, .. } => self.cube(sight, at, yaw, goal, goal_yaw),
            Target::Button { top, is_done, .. } => self.button(sight, top, is_done),
            Target::Drawer(handle) => self.slide(sight, handle, DRAWER),
            Target::Window(handle) => self.slide(sight, handle, WINDOW),
        };
        let off = [0, 1, 2].map(|k| next.to[k] - sight.effector[k]);
        let length = off.iter().map(|x| x * x).sum::<f64>().sqrt();
        let stretch = if length >= self.min_norm { 1.0 } else { self.min_norm / (length + 1e-6) };
        let [along, around] = GAINS;
        let [x, y, z] = off.map(|x| x * stretch * along);
        [x, y, z, next.turn * around, next.grip].map(|value| value.clamp(-1.0, 1.0))
    }

    fn cube(&mut self, sight: &Sight, at: [f64; 3], yaw: f64, goal: [f64; 3], goal_yaw: f64) -> Move {
        /// How high above a cube the gripper travels, m; and what counts as high.
        const CLEAR: f64 = 0.18;
        const HIGH: f64 = 0.16;
        let yaw = nearest_turn(sight.yaw, yaw, 4);
        let goal_yaw = nearest_turn(sight.yaw, goal_yaw, 4);
        let (to_cube, to_goal) = (yaw - sight.yaw, goal_yaw - yaw);
        let raised = |[x, y, z]: [f64; 3]| [x, y, z + CLEAR];
        let is_high = sight.effector[2] > HIGH;
        if distance(goal, at) > 0.02 {
            let is_over_goal = flat(goal, at) <= ABOVE;
            return if flat(at, sight.effector) > ABOVE {
                Move { to: raised(at), turn: to_cube, grip: OPEN }
            } else if distance(at, sight.effector) > 0.02 {
                Move { to: at, turn: to_cube, grip: OPEN }
            } else if sight.contact <= 0.5 {
                Move { to: at, turn: to_cube, grip: CLOSE }
            } else if is_over_goal {
                Move { to: goal, turn: to_goal, grip: CLOSE }
            } else if is_high {
                Move { to: raised(goal), turn: to_goal, grip: CLOSE }
            } else {
                Move { to: [at[0], at[1], 2.0 * CLEAR], turn: to_goal, grip: CLOSE }
            };
        }
        let next = if sight.contact >= 0.1 {
            Move { to: goal, turn: to_goal, grip: OPEN }
        } else if is_high {
            Move { to: self.rest, turn: self.rest_yaw - sight.yaw, grip: OPEN }
        } else {
            Move { to: [at[0], at[1], 2.0 * HIGH], turn: self.rest_yaw - sight.yaw, grip: OPEN }
        };
        self.look_whether_arrived(sight);
        next
    }

    fn button(&mut self, sight: &Sight, top: [f64; 3], is_done: bool) -> Move {
        const HIGH: f64 = 0.16;
        if !is_done {
            let is_over = flat(top, sight.effector) <= ABOVE;
            let height = if is_over { top[2] - 0.022 } else { top[2] + 0.06 };
            return Move { to: [top[0], top[1], height], turn: 0.0, grip: CLOSE };
        }
        let is_high = sight.effector[2] > HIGH;
        let to = if is_high { self.rest } else { [top[0], top[1], 2.0 * HIGH] };
        self.look_whether_arrived(sight);
        Move { to, turn: self.rest_yaw - sight.yaw, grip: OPEN }
    }

    fn slide(&mut self, sight: &Sight, handle: Handle, manner: Manner) -> Move {
        let [x, y, z] = handle.at;
        if distance(handle.goal, handle.at) > 0.01 {
            let turn = nearest_turn(sight.yaw, handle.yaw, 2) - sight.yaw;
            return if flat(handle.at, sight.effector) > ABOVE {
                Move { to: [x, y, z + manner.clear], turn, grip: OPEN }
            } else if distance(handle.at, sight.effector) > 0.03 {
                Move { to: handle.at, turn, grip: OPEN }
            } else {
                Move { to: handle.goal, turn, grip: manner.grip }
            };
        }
        let to = if sight.effector[2] > manner.high { self.rest } else { [x, y, 2.0 * manner.high] };
        self.look_whether_arrived(sight);
        Move { to, turn: self.rest_yaw - sight.yaw, grip: OPEN }
    }

    fn look_whether_arrived(&mut self, sight: &Sight) {
        self.has_arrived |= distance(self.rest, sight.effector) <= 0.04;
    }
}

/// How a drawer or a window is moved.
#[derive(Clone, Copy)]
struct Manner {
    /// How far above a handle the gripper arrives, m.
    clear: f64,
    /// What counts as high, m.
    high: f64,
    /// The gripper while it moves.
    grip: f64,
}

const DRAWER: Manner = Manner { clear: 0.12, high: 0.18, grip: OPEN };
const WINDOW: Manner = Manner { clear: 0.06, high: 0.28, grip: CLOSE };

/// The distance in the plane, m.
fn flat(a: [f64; 3], b: [f64; 3]) -> f64 {
    distance([a[0], a[1]], [b[0], b[1]])
}
