//! Rewards of metaworld 3.1.1, with their parts.
//!
//! Where the command of the fingers counts, NumPy goes on in single precision from there: [`Number`] has that rule.

use serde::{Deserialize, Serialize};

use super::robot::{Frame, JOINT, Origin, Robot, minus, norm};
use super::task::Reward;
use crate::suite::{Falloff, GAUSSIAN, tolerance};

/// The long tail by which most rewards fall off.
const LONG: Falloff = Falloff::LongTail(0.1);

/// What a state and an action are worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Worth {
    /// 0 to 10.
    pub(super) reward: f64,
    pub(super) success: bool,
    pub(super) parts: [f64; PARTS.len()],
}

/// The columns of [`Worth::parts`].
pub(super) const PARTS: [&str; 5] =
    ["near_object", "grasp_success", "grasp_reward", "in_place_reward", "obj_to_target"];

/// A number in double precision, or one in single precision, with which double ones become single: NumPy's `float32` among
/// Python's numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Number {
    value: f64,
    is_single: bool,
}

impl From<f64> for Number {
    fn from(value: f64) -> Self {
        Self { value, is_single: false }
    }
}

macro_rules! arithmetic {
    ($($trait:ident $name:ident $op:tt;)*) => {$(
        impl<T: Into<Number>> std::ops::$trait<T> for Number {
            type Output = Number;
            fn $name(self, other: T) -> Number {
                let other = other.into();
                let is_single = self.is_single || other.is_single;
                let value = if is_single {
                    f64::from(self.value as f32 $op other.value as f32)
                } else {
                    self.value $op other.value
                };
                Number { value, is_single }
            }
        }
    )*};
}

arithmetic! {
    Add add +;
    Sub sub -;
    Mul mul *;
    Div div /;
}

impl Number {
    /// How hard the fingers are told to close; a plain 0 where they are not.
    fn effort(closing: f32) -> Self {
        if closing > 0.0 { Self { value: closing.min(1.0).into(), is_single: true } } else { 0.0.into() }
    }

    /// The same value in double precision.
    fn double(self) -> Self {
        self.value.into()
    }
}

/// The Hamacher product: large where both are.
fn both(a: impl Into<Number>, b: impl Into<Number>) -> Number {
    let (a, b) = (a.into(), b.into());
    let rest = a + b - a * b;
    if rest.value > 0.0 { a * b / rest } else { 0.0.into() }
}

/// 1 up to `most`, and falling off over `margin`.
fn up_to(x: f64, most: f64, margin: f64, falloff: Falloff) -> f64 {
    tolerance(x, [0.0, most], margin, falloff)
}

/// The state of which a reward is.
struct State<'a> {
    robot: &'a Robot,
    origin: &'a Origin,
    hand: [f64; 3],
    gripper: f64,
    object: [f64; 3],
    tips: [f64; 3],
    /// The distance of object and tips, m.
    away: f64,
    closing: f32,
}

/// The worth of a state that was observed as `frame` after an action whose last value is `closing`.
pub(super) fn worth(robot: &Robot, origin: &Origin, frame: &Frame, closing: f32) -> Worth {
    let triple = |first: usize| [frame[first], frame[first + 1], frame[first + 2]];
    let (hand, object, tips) = (triple(0), triple(4), robot.tips());
    let away = norm(minus(object, tips));
    let state = State { robot, origin, hand, gripper: frame[3], object, tips, away, closing };
    match robot.task.reward {
        Reward::Reach => state.reach(),
        Reward::Push => state.push(),
        Reward::PickPlace => state.pick_place(),
        Reward::Peg => state.peg(),
        Reward::Door => state.door(),
        Reward::DrawerOpen => state.drawer_open(),
        Reward::Press => state.press(),
        Reward::CloseDrawer => state.slide((0.005, GAUSSIAN), true, [0.05 + 0.015, 0.01]),
        Reward::OpenWindow => state.slide((0.02, LONG), false, [0.05; 2]),
        Reward::CloseWindow => state.slide((0.02, GAUSSIAN), false, [0.05; 2]),
    }
}

fn told(
    reward: impl Into<Number>,
    success: bool,
    [near, grasped]: [bool; 2],
    grasp: impl Into<Number>,
    [in_place, left]: [f64; 2],
) -> Worth {
    let bit = |is: bool| f64::from(u8::from(is));
    let parts = [bit(near), bit(grasped), grasp.into().value, in_place, left];
    Worth { reward: reward.into().value, success, parts }
}

/// How near the object is enough for the reward of push, pick-place and reach, m.
const PLACED: f64 = 0.05;

impl State<'_> {
    fn reach(&self) -> Worth {
        let Origin { hand, target, .. } = *self.origin;
        let left = norm(minus(self.tips, target));
        let in_place = up_to(left, PLACED, norm(minus(hand, target)), LONG);
        let mut worth = told(10.0 * in_place, left <= PLACED, [false, true], left, [in_place, left]);
        worth.parts[0] = left;
        worth
    }

    /// How well the fingers hold the object, from how well each pad is beside it.
    fn caging(&self, pads: [f64; 2]) -> Number {
        const NEAR: f64 = 0.005;
        let flat = |v: [f64; 3]| norm([v[0], v[2]]);
        let Origin { object, tips, .. } = *self.origin;
        let over = up_to(flat(minus(self.tips, self.object)), NEAR, flat(minus(object, tips)) - NEAR, LONG);
        let caged = both(both(pads[0], pads[1]), over);
        let effort = if caged.value > 0.97 { Number::effort(self.closing) } else { 0.0.into() };
        (both(caged, effort) + caged) / 2.0
    }

    /// [`State::caging`] by distances from pads to the object, 1 between `radius` and `most`.
    fn caging_within(&self, radius: f64, most: f64) -> Number {
        let (y, y0) = (self.object[1], self.origin.object[1]);
        self.caging(self.robot.pads().map(|pad| {
            let margin = ((pad - y0).abs() - most).abs();
            tolerance((pad - y).abs(), [radius, most], margin, LONG)
        }))
    }

    /// Whether the object was lifted by more than `height`, between open fingers.
    fn is_lifted(&self, height: f64) -> bool {
        self.gripper > 0.0 && self.object[2] - height > self.origin.object[2]
    }

    /// Whether it is near and held, and how near the target it is.
    fn placed(&self) -> ([bool; 2], [f64; 2]) {
        let left = norm(minus(self.object, self.origin.target));
        let in_place = up_to(left, PLACED, norm(minus(self.origin.object, self.origin.target)), LONG);
        ([self.away <= 0.03, self.is_lifted(0.02) && self.robot.is_touched()], [in_place, left])
    }

    fn push(&self) -> Worth {
        let (held, [in_place, left]) = self.placed();
        let caging = self.caging_within(0.015, 0.05);
        let mut reward = caging * 2.0;
        if self.away < 0.02 && self.gripper > 0.0 {
            reward = reward + (reward + 1.0 + 5.0 * in_place);
        }
        if left < PLACED {
            reward = 10.0.into();
        }
        told(reward, left <= PLACED, held, caging, [in_place, left])
    }

    fn pick_place(&self) -> Worth {
        let (held, [in_place, left]) = self.placed();
        let (y, [l, r]) = (self.object[1], self.robot.pads());
        // Signed, and with margins by where the pads are now: the original means where they were at the start.
        let beside = |off: f64, pad: f64| tolerance(off, [0.015, 0.05], ((y - pad).abs() - 0.05).abs(), LONG);
        let caging = self.caging([beside(l - y, l), beside(y - r, r)]);
        let mut reward = both(caging, in_place);
        if self.away < 0.02 && self.is_lifted(0.01) {
            reward = reward + (1.0 + 5.0 * in_place);
        }
        if left < PLACED {
            reward = 10.0.into();
        }
        told(reward, left <= 0.07, held, caging, [in_place, left])
    }

    fn peg(&self) -> Worth {
        const REACHED: f64 = 0.07;
        let Origin { achieved: head0, target, .. } = *self.origin;
        let stretched = |v: [f64; 3]| norm([v[0], v[1] * 2.0, v[2] * 2.0]);
        let head = self.robot.achieved();
        let left = stretched(minus(head, target));
        let on_the_way = up_to(left, REACHED, stretched(minus(head0, target)), LONG);
        let [first, second] = self.robot.boxes().map(|corners| through(head, corners));
        let is_inside = first.is_some() || second.is_some();
        let in_place = both(on_the_way, both(second.unwrap_or(1.0), first.unwrap_or(1.0)));
        let mut caging = self.caging_within(0.0075, 0.03);
        let is_lifted = self.is_lifted(0.01);
        if self.away < 0.08 && is_lifted {
            caging = 1.0.into();
        }
        // In a box the original's number is a double one, and makes all others so.
        let mut reward = both(if is_inside { caging.double() } else { caging }, in_place);
        if self.away < 0.08 && is_lifted {
            reward = reward + (1.0 + 5.0 * in_place.value);
        }
        if left <= REACHED {
            reward = 10.0.into();
        }
        let held = [self.away <= 0.03, self.away < 0.02 && is_lifted];
        told(reward, left <= REACHED, held, caging, [in_place.value, left])
    }

    fn door(&self) -> Worth {
        use std::f64::consts::PI;
        let grasp = f64::from((self.closing + 1.0) / 2.0);
        let from = |v: [f64; 3], by: [f64; 3]| minus(v, by);
        let door = from(self.object, [0.05, 0.0, 0.0]);
        let off = minus(self.hand, door);
        let flat = norm([off[0], off[1]]);
        let floor = if flat <= 0.12 { 0.0 } else { 0.04 * (flat - 0.12).ln() + 0.4 };
        let height = self.hand[2];
        let above = if height >= floor { 1.0 } else { up_to(floor - height, 0.01, floor / 2.0, LONG) };
        let near = up_to(norm(from(off, [0.05, 0.03, -0.01])), 0.06, 0.5, LONG);
        let ready = both(above, near).value;
        let angle = self.robot.sim.qpos()[JOINT];
        let started = f64::from(u8::from(angle < -PI / 90.0));
        let opened = 0.2 * started + 0.8 * up_to(PI / 2.0 + PI / 6.0 + angle, 0.5, PI / 3.0, LONG);
        let success = (self.object[0] - self.origin.target[0]).abs() <= 0.08;
        let reward = if success { 10.0 } else { 2.0 * both(ready, grasp).value + 8.0 * opened };
        let mut worth = told(reward, success, [false, grasp >= 0.5], grasp, [opened, 0.0]);
        worth.parts[0] = ready;
        worth
    }

    fn drawer_open(&self) -> Worth {
        let Origin { target, tips, .. } = *self.origin;
        let stretched = |v: [f64; 3]| norm([v[0] * 3.0, v[1] * 3.0, v[2]]);
        let left = norm(minus(self.object, target));
        let in_place = up_to(left, 0.02, 0.2, LONG);
        let start = [target[0], target[1] + 0.2, target[2]];
        let off = minus(self.object, self.hand);
        let grasp = up_to(stretched(off), 0.01, stretched(minus(start, tips)), LONG);
        let held = [norm(off) <= 0.03, self.gripper > 0.0];
        told((grasp + in_place) * 5.0, left <= 0.03, held, grasp, [in_place, left])
    }

    fn press(&self) -> Worth {
        let Origin { target, tips, gap, .. } = *self.origin;
        let left = (target[2] - self.object[2]).abs();
        let near = up_to(self.away, 0.01, norm(minus(self.object, tips)), LONG);
        let pressed = up_to(left, 0.005, gap, LONG);
        let mut reward = 5.0 * both(1.0 - self.gripper, near).value;
        if self.away <= 0.03 {
            reward += 5.0 * pressed;
        }
        told(reward, left <= 0.024, [self.away <= 0.05, self.gripper > 0.0], near, [pressed, left])
    }

    /// Near × placed, for what slides. `grips`: whether the closing fingers count, and the whole distance (else that along x).
    fn slide(&self, (near, falloff): (f64, Falloff), grips: bool, [reached, touched]: [f64; 2]) -> Worth {
        let Origin { achieved: handle, target, tips, placed, .. } = *self.origin;
        let distance =
            |from: [f64; 3]| if grips { norm(minus(from, target)) } else { (from[0] - target[0]).abs() };
        let left = distance(self.object);
        let whole = distance(if self.robot.task.reward == Reward::OpenWindow { placed } else { handle });
        let in_place = up_to(left, 0.05, (whole - 0.05).abs(), LONG);
        let mut reached_for: Number =
            up_to(self.away, near, (norm(minus(handle, tips)) - near).abs(), falloff).into();
        if grips {
            reached_for = both(reached_for, Number::effort(self.closing));
        }
        let success = left <= reached;
        let share = if grips && success { 1.0.into() } else { both(reached_for, in_place) };
        told(share * 10.0, success, [self.away <= touched, true], reached_for, [in_place, left])
    }
}

/// How far a place is through a box, from one corner to the opposite one; `None` outside.
fn through(place: [f64; 3], [zero, one]: [[f64; 3]; 2]) -> Option<f64> {
    let is_inside = (0..3).all(|k| zero[k].min(one[k]) <= place[k] && place[k] <= zero[k].max(one[k]));
    let share = |k: usize| (place[k] - zero[k]) / (one[k] - zero[k]);
    is_inside.then(|| share(0) * share(1) * share(2))
}
