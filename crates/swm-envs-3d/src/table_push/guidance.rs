//! The expert's rule: around the object to the side away from the goal, then push, steering against sideways drift.

use super::physics::Conditions;
use super::state::State;

/// Room that the pusher leaves to the object while it goes around it, m.
const CLEARANCE: f64 = 0.02;
/// Rate at which it corrects its distance from the object, and from the line through object and goal, 1/s.
const RADIAL_RATE: f64 = 5.0;
const SIDEWAYS_RATE: f64 = 8.0;
/// Speed of the push at the goal, m/s, and how much faster it is per meter before.
const LAST_SPEED: f64 = 0.06;
const SPEED_PER_M: f64 = 3.0;
/// Speed at which the pusher meets the object, m/s, and how much faster it comes per meter before.
const MEETING_SPEED: f64 = 0.12;
const APPROACH_PER_M: f64 = 4.0;
/// The push begins within this share of the object's reach from the line, and ends beyond the other.
const ALIGNED: f64 = 0.35;
const LOST: f64 = 0.7;

type Vector = [f64; 2];

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

fn unit(a: Vector) -> Vector {
    let length = length(a);
    if length > 0.0 { a.map(|part| part / length) } else { [1.0, 0.0] }
}

fn turned_left([x, y]: Vector) -> Vector {
    [-y, x]
}

/// What the expert remembers between steps.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pilot {
    is_pushing: bool,
}

impl Pilot {
    /// The action, `[2]` in -1..1, that brings the object to a goal.
    pub(super) fn act(&mut self, conditions: &Conditions, state: &State, goal: Vector) -> Vector {
        let object = state.object();
        let to_goal = minus(goal, object);
        let ahead = unit(to_goal);
        let from_object = minus(state.pusher, object);
        let (along, aside) = (dot(from_object, ahead), dot(from_object, turned_left(ahead)));
        let reach = conditions.object.reach();
        let limit = if self.is_pushing { LOST } else { ALIGNED };
        self.is_pushing = along < 0.0 && aside.abs() < limit * reach;
        let velocity = if self.is_pushing {
            let gap = (-along - reach - conditions.radius).max(0.0);
            let push = LAST_SPEED + SPEED_PER_M * length(to_goal);
            let approach = if gap > 0.0 { MEETING_SPEED + APPROACH_PER_M * gap } else { push };
            let speed = push.min(approach).min(conditions.speed);
            let [left_x, left_y] = turned_left(ahead);
            let sideways = -SIDEWAYS_RATE * aside;
            [ahead[0] * speed + left_x * sideways, ahead[1] * speed + left_y * sideways]
        } else {
            around(conditions, from_object, ahead)
        };
        let action = velocity.map(|part| part / conditions.speed);
        let excess = length(action).max(1.0);
        action.map(|part| part / excess)
    }
}

/// The velocity that leads around the object to its side away from the goal.
fn around(conditions: &Conditions, from_object: Vector, ahead: Vector) -> Vector {
    let clear = conditions.object.reach() + conditions.radius + CLEARANCE;
    let behind = ahead.map(|part| -clear * part);
    let to_behind = minus(behind, from_object);
    // The nearest that the straight way comes to the object.
    let share = (-dot(from_object, to_behind) / dot(to_behind, to_behind).max(1e-12)).clamp(0.0, 1.0);
    let nearest = [0, 1].map(|axis| from_object[axis] + share * to_behind[axis]);
    if length(nearest) >= clear - 0.25 * CLEARANCE {
        return to_behind.map(|part| part * 10.0);
    }
    let outward = unit(from_object);
    let left = turned_left(outward);
    let side = if dot(left, behind) >= 0.0 { 1.0 } else { -1.0 };
    let correction = RADIAL_RATE * (clear - length(from_object));
    [0, 1].map(|axis| side * conditions.speed * left[axis] + correction * outward[axis])
}

/// How far a state is from success, for planners, m: the object's way to the goal, and a share of the pusher's way to the place
/// behind the object.
pub(super) fn cost(conditions: &Conditions, state: &State, goal: Vector) -> f64 {
    let object = state.object();
    let to_goal = minus(goal, object);
    let behind = unit(to_goal).map(|part| -part * (conditions.object.reach() + conditions.radius));
    length(to_goal) + 0.2 * length(minus(minus(state.pusher, object), behind))
}
