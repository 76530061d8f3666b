//! Gaits for the ant, tuned by hand and by search: it walks in any direction without turning.
//!
//! Diagonal legs step together. On the ground a foot goes from ahead to behind, along the way: the hip turns it sideways, the
//! ankle pulls or pushes it. In the air it goes back, lifted. Joints are led there by a spring and a damper in each motor.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// How legs step.
pub(super) struct Gait {
    /// Control steps of one cycle, and the part of it that a foot is on the ground.
    period: f64,
    grounded: f64,
    /// How far hips turn and ankles stretch to each side, rad.
    stroke: f64,
    stretch: f64,
    /// Angle of the ankle on the ground and in the air, rad.
    down: f64,
    up: f64,
}

/// Walks at about 1.1 m/s.
pub(super) const WALK: Gait =
    Gait { period: 7.0, grounded: 0.676, stroke: 0.319, stretch: 0.764, down: 1.172, up: 0.715 };
/// Pushes a ball with the leg that is ahead.
pub(super) const PUSH: Gait =
    Gait { period: 6.407, grounded: 0.581, stroke: 0.295, stretch: 0.671, down: 1.124, up: 0.962 };

/// Action per rad, and per rad/s.
const STIFFNESS: f64 = 4.516;
const DAMPING: f64 = 0.476;
/// The action that moves each leg's hip; its ankle has the next.
const HIPS: [usize; 4] = [2, 4, 6, 0];
/// Ankles that turn the other way round.
const ANKLE_SIGNS: [f64; 4] = [1.0, -1.0, -1.0, 1.0];

/// How far the body is turned about the vertical, rad: qpos `[15]`.
fn yaw_rad(qpos: &[f64]) -> f64 {
    let [w, x, y, z] = [qpos[3], qpos[4], qpos[5], qpos[6]];
    // Correct for quaternions of any length.
    (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z)
}

/// Where leg `leg` points, rad from the body: 45°, 135°, 225° and 315°.
fn leg_rad(leg: usize) -> f64 {
    FRAC_PI_4 + leg as f64 * FRAC_PI_2
}

/// The direction of the leg that points most nearly to `heading_rad`, both in the world: x, y of length 1.
pub(super) fn nearest_leg(qpos: &[f64], heading_rad: f64) -> [f64; 2] {
    let yaw = yaw_rad(qpos);
    let directions = [0, 1, 2, 3].map(|leg| yaw + leg_rad(leg));
    let along = |direction: &f64| (direction - heading_rad).cos();
    let nearest = directions.into_iter().max_by(|a, b| along(a).total_cmp(&along(b)));
    let (sin, cos) = nearest.unwrap_or(yaw).sin_cos();
    [cos, sin]
}

/// The action that walks towards `heading_rad` (world frame) at control step `step`: qpos `[15]`, qvel `[14]`.
pub(super) fn walk(gait: &Gait, qpos: &[f64], qvel: &[f64], step: u64, heading_rad: f64) -> [f64; 8] {
    let Gait { period, grounded, stroke, stretch, down, up } = *gait;
    let yaw = yaw_rad(qpos);
    let mut action = [0.0; 8];
    for leg in 0..4 {
        let angle = heading_rad - yaw - leg_rad(leg);
        let cycle = (step as f64 / period + 0.5 * (leg % 2) as f64).fract();
        let (swing, ankle) = if cycle < grounded {
            (1.0 - 2.0 * cycle / grounded, down)
        } else {
            (2.0 * (cycle - grounded) / (1.0 - grounded) - 1.0, up)
        };
        let (sideways, outwards) = angle.sin_cos();
        let targets = [stroke * sideways * swing, ANKLE_SIGNS[leg] * (ankle - stretch * outwards * swing)];
        for (joint, target) in targets.into_iter().enumerate() {
            let (angle, velocity) = (qpos[7 + 2 * leg + joint], qvel[6 + 2 * leg + joint]);
            let wanted = STIFFNESS * (target - angle) - DAMPING * velocity;
            action[HIPS[leg] + joint] = wanted.clamp(-1.0, 1.0);
        }
    }
    action
}
