//! A gait for the ant, tuned by hand and by search: it walks in any direction without turning, at about 1.1 m/s.
//!
//! Diagonal legs step together. On the ground a foot goes from ahead to behind, along the way: the hip turns it sideways, the
//! ankle pulls or pushes it. In the air it goes back, lifted. Joints are led there by a spring and a damper in each motor.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Control steps of one cycle, and the part of it that a foot is on the ground.
const PERIOD: f64 = 7.0;
const GROUNDED: f64 = 0.676;
/// How far hips turn and ankles stretch to each side, rad.
const STROKE: f64 = 0.319;
const STRETCH: f64 = 0.764;
/// Angle of the ankle on the ground and in the air, rad.
const DOWN: f64 = 1.172;
const UP: f64 = 0.715;
/// Action per rad, and per rad/s.
const STIFFNESS: f64 = 4.516;
const DAMPING: f64 = 0.476;
/// The action that moves each leg's hip; its ankle has the next.
const HIPS: [usize; 4] = [2, 4, 6, 0];
/// Ankles that turn the other way round.
const ANKLE_SIGNS: [f64; 4] = [1.0, -1.0, -1.0, 1.0];

/// The action that walks towards `heading_rad` (world frame) at control step `step`: qpos `[15]`, qvel `[14]`.
pub(super) fn walk(qpos: &[f64], qvel: &[f64], step: u64, heading_rad: f64) -> [f64; 8] {
    let [w, x, y, z] = [qpos[3], qpos[4], qpos[5], qpos[6]];
    // Correct for quaternions of any length.
    let yaw = (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z);
    let mut action = [0.0; 8];
    for leg in 0..4 {
        // Legs point to 45°, 135°, 225° and 315° of the body.
        let angle = heading_rad - yaw - (FRAC_PI_4 + leg as f64 * FRAC_PI_2);
        let cycle = (step as f64 / PERIOD + 0.5 * (leg % 2) as f64).fract();
        let (swing, ankle) = if cycle < GROUNDED {
            (1.0 - 2.0 * cycle / GROUNDED, DOWN)
        } else {
            (2.0 * (cycle - GROUNDED) / (1.0 - GROUNDED) - 1.0, UP)
        };
        let (sideways, outwards) = angle.sin_cos();
        let targets = [STROKE * sideways * swing, ANKLE_SIGNS[leg] * (ankle - STRETCH * outwards * swing)];
        for (joint, target) in targets.into_iter().enumerate() {
            let (angle, velocity) = (qpos[7 + 2 * leg + joint], qvel[6 + 2 * leg + joint]);
            let wanted = STIFFNESS * (target - angle) - DAMPING * velocity;
            action[HIPS[leg] + joint] = wanted.clamp(-1.0, 1.0);
        }
    }
    action
}
