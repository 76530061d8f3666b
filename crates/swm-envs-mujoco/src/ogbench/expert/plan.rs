//! The expert that follows a plan: OGBench's plan oracles. Poses at times, interpolated, with smoothed noise; the action is
//! what is missing from the present pose to the planned one.

use swm_core::seed::Stream;

use super::super::pose::{self, Quaternion, distance};
use super::super::robot::ACTION_SCALE;
use super::sight::{Handle, Sight, Target, nearest_turn};
use crate::suite::{normal, uniform};

/// Seconds per control step.
const STEP_S: f64 = 0.05;
/// The unit of the plan's times, s.
const SEGMENT_S: f64 = 0.4;

/// A pose to be at.
#[derive(Clone, Copy, Debug)]
struct Pose {
    at: [f64; 3],
    yaw: f64,
}

impl Pose {
    fn above(self, height: f64) -> Self {
        Self { at: [self.at[0], self.at[1], self.at[2] + height], ..self }
    }
}

/// A pose, when to be there, and the gripper there.
#[derive(Clone, Copy, Debug)]
struct Keyframe {
    pose: Pose,
    time: f64,
    grasp: f64,
}

/// A plan to one target.
pub(super) struct Plan {
    began_s: f64,
    /// For each control step: x, y, z, turn, gripper.
    steps: Vec<[f64; 5]>,
}

impl Plan {
    /// A plan from the present row; `noise`: its size, and how many steps it is smoothed over.
    pub(super) fn new(sight: &Sight, bounds: [[f64; 3]; 2], noise: [f64; 2], stream: &mut Stream) -> Self {
        let [low, high] = bounds;
        let rest = Pose {
            at: [0, 1, 2].map(|k| uniform(stream, low[k], high[k])),
            yaw: uniform(stream, -std::f64::consts::PI, std::f64::consts::PI),
        };
        let now = Pose { at: sight.effector, yaw: sight.yaw };
        let frames = match sight.target {
            Target::Cube { at, yaw, goal, goal_yaw, .. } => {
                cube(now, Pose { at, yaw }, Pose { at: goal, yaw: goal_yaw }, rest, stream)
            }
            Target::Button { top, .. } => button(now, top, rest, stream),
            Target::Drawer(handle) => slide(now, handle, 0.12, rest, stream),
            Target::Window(handle) => slide(now, handle, 0.06, rest, stream),
        };
        let mut steps = sampled(&frames);
        add_noise(&mut steps, noise, stream);
        Self { began_s: sight.time_s, steps }
    }

    fn index(&self, sight: &Sight) -> usize {
        // The time is a sum of many small steps.
        ((sight.time_s - self.began_s + 1e-7) / STEP_S).floor() as usize
    }

    /// Whether the plan is at its end.
    pub(super) fn is_done(&self, sight: &Sight) -> bool {
        self.index(sight) + 1 > self.steps.len()
    }

    /// The action that leads to where the plan is now.
    pub(super) fn action(&self, sight: &Sight) -> [f64; 5] {
        let index = self.index(sight).min(self.steps.len().saturating_sub(1));
        let Some([x, y, z, yaw, grasp]) = self.steps.get(index).copied() else { return [0.0; 5] };
        let off = [
            x - sight.effector[0],
            y - sight.effector[1],
            z - sight.effector[2],
            yaw - sight.yaw,
            grasp - sight.opening,
        ];
        std::array::from_fn(|k| (off[k] / ACTION_SCALE[k]).clamp(-1.0, 1.0))
    }
}

/// The angle in 0..2π.
fn positive(yaw: f64) -> f64 {
    yaw.rem_euclid(std::f64::consts::TAU)
}

/// Picks a cube up, and places it.
fn cube(now: Pose, cube: Pose, goal: Pose, rest: Pose, stream: &mut Stream) -> Vec<Keyframe> {
    let facing =
        |from: Pose, to: Pose| Pose { yaw: nearest_turn(positive(from.yaw), positive(to.yaw), 4), ..to };
    let at = facing(now, cube);
    let pick = at.above(0.1 + uniform(stream, 0.0, 0.1));
    let goal = facing(pick, goal);
    let place = goal.above(0.1 + uniform(stream, 0.0, 0.1));
    let aside = [uniform(stream, -0.1, 0.1), uniform(stream, -0.1, 0.1), uniform(stream, 0.0, 0.2)];
    let middle = [0, 1].map(|k| f64::midpoint(pick.at[k], place.at[k]) + aside[k]);
    let clearance = Pose {
        at: [middle[0], middle[1], now.at[2] + aside[2]],
        yaw: pose::yaw(between(pose::about_z(pick.yaw), pose::about_z(place.yaw), 0.5)),
    };
    let frames = [
        (now, 0.0, 0.0),
        (pick, 1.0, 0.0),
        (at, 1.5, 0.0),
        (at, 1.0, 1.0),
        (pick, 1.0, 1.0),
        (clearance, 1.0, 1.0),
        (place, 1.0, 1.0),
        (goal, 1.5, 1.0),
        (goal, 1.0, 0.0),
        (place, 1.0, 0.0),
        (rest, 1.0, 0.0),
    ];
    timed(&frames, 0.2, stream)
}

/// Presses a button, closed.
fn button(now: Pose, top: [f64; 3], rest: Pose, stream: &mut Stream) -> Vec<Keyframe> {
    // The reference turns the gripper by the button's x coordinate, which is as good as any angle.
    let top = Pose { at: top, yaw: top[0] };
    let over = top.above(0.06);
    let approach = 0.5 + 4.0 * distance(now.at, over.at);
    let frames = [
        (now, 0.0, 0.0),
        (over, approach, 1.0),
        (top.above(-0.025), 0.8, 1.0),
        (over, 0.8, 1.0),
        (rest, 1.25, 0.0),
    ];
    timed(&frames, 0.1, stream)
}

/// Takes a handle to where it belongs.
fn slide(now: Pose, handle: Handle, clear: f64, rest: Pose, stream: &mut Stream) -> Vec<Keyframe> {
    let yaw = nearest_turn(positive(now.yaw), positive(handle.yaw), 2);
    let (from, to) = (Pose { at: handle.at, yaw }, Pose { at: handle.goal, yaw });
    let frames = [
        (now, 0.0, 0.0),
        (from.above(clear), 1.0, 0.0),
        (from, 0.5, 0.0),
        (from, 0.5, 1.0),
        (to, 0.5, 1.0),
        (to, 0.5, 0.0),
        (to.above(clear), 0.5, 0.0),
        (rest, 1.0, 0.0),
    ];
    timed(&frames, 0.1, stream)
}

/// Keyframes from poses, durations in segments, and grips; each time but the first is off by up to `jitter` segments.
fn timed(frames: &[(Pose, f64, f64)], jitter: f64, stream: &mut Stream) -> Vec<Keyframe> {
    let mut time = 0.0;
    let mut keyframes = Vec::with_capacity(frames.len());
    for (index, &(pose, duration, grasp)) in frames.iter().enumerate() {
        time += duration * SEGMENT_S;
        let off = if index == 0 { 0.0 } else { uniform(stream, -1.0, 1.0) * SEGMENT_S * jitter };
        keyframes.push(Keyframe { pose, time: time + off, grasp });
    }
    keyframes
}

/// A rotation between two, the short way.
fn between(a: Quaternion, b: Quaternion, share: f64) -> Quaternion {
    let turn = pose::to_vector(pose::multiply(b, pose::inverse(a)));
    let angle = turn.iter().map(|x| x * x).sum::<f64>().sqrt();
    if angle == 0.0 {
        return a;
    }
    pose::multiply(pose::about(turn.map(|x| x / angle), share * angle), a)
}

/// The plan at every control step.
fn sampled(frames: &[Keyframe]) -> Vec<[f64; 5]> {
    let end = frames.last().map_or(0.0, |frame| frame.time);
    let count = (end / STEP_S).ceil() as usize;
    let at = |step: usize| {
        let time = step as f64 * STEP_S;
        let next = frames.partition_point(|frame| frame.time <= time).clamp(1, frames.len() - 1);
        let (a, b) = (frames[next - 1], frames[next]);
        let share = ((time - a.time) / (b.time - a.time)).clamp(0.0, 1.0);
        let mix = |a: f64, b: f64| a + share * (b - a);
        let [x, y, z] = [0, 1, 2].map(|k| mix(a.pose.at[k], b.pose.at[k]));
        let turn = between(pose::about_z(a.pose.yaw), pose::about_z(b.pose.yaw), share);
        [x, y, z, pose::yaw(turn), mix(a.grasp, b.grasp)]
    };
    (0..count).map(at).collect()
}

/// Adds normal noise, smoothed by a Gaussian over the steps; beyond the ends it is mirrored.
fn add_noise(steps: &mut [[f64; 5]], [size, smoothing]: [f64; 2], stream: &mut Stream) {
    if size == 0.0 || steps.is_empty() {
        return;
    }
    let raw: Vec<[f64; 5]> =
        steps.iter().map(|_| std::array::from_fn(|k| size * ACTION_SCALE[k] * normal(stream))).collect();
    let reach = (4.0 * smoothing + 0.5) as i64;
    let weight = |off: i64| match smoothing {
        0.0 => 1.0,
        spread => (-0.5 * (off as f64 / spread) * (off as f64 / spread)).exp(),
    };
    let total: f64 = (-reach..=reach).map(weight).sum();
    let count = steps.len() as i64;
    let mirrored = |index: i64| {
        let index = index.rem_euclid(2 * count);
        if index < count { index } else { 2 * count - 1 - index }
    };
    for (index, step) in steps.iter_mut().enumerate() {
        for off in -reach..=reach {
            let other = raw[mirrored(index as i64 + off) as usize];
            for (value, noise) in step.iter_mut().zip(other) {
                *value += noise * weight(off) / total;
            }
        }
    }
}
