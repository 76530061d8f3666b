//! Random starts: draws, random joints, and trying again until nothing touches.

use std::f64::consts::PI;

use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use swm_core::seed::Stream;

use super::Stage;
use swm_mujoco::MujocoError;
use swm_mujoco::{JointKind, Simulation};

/// A number in `low..high`, uniform.
pub fn uniform(stream: &mut Stream, low: f64, high: f64) -> f64 {
    low + (high - low) * stream.random::<f64>()
}

/// A standard normal number.
pub fn normal(stream: &mut Stream) -> f64 {
    StandardNormal.sample(stream)
}

/// A vector of the length 1 with the direction of `N` standard normal values: uniform over directions.
pub fn direction<const N: usize>(stream: &mut Stream) -> [f64; N] {
    normalized(std::array::from_fn(|_| normal(stream)))
}

fn normalized<const N: usize>(vector: [f64; N]) -> [f64; N] {
    let norm = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    // All of them zero: as good a direction as any other, and as rare.
    if norm == 0.0 { std::array::from_fn(|i| f64::from(u8::from(i == 0))) } else { vector.map(|v| v / norm) }
}

/// Draws every joint, as `dm_control`'s `randomize_limited_and_rotational_joints`: limited joints over their range,
/// hinges without limits over a full turn, rotations of ball joints uniformly; slides without limits stay. The rotation
/// of a free joint is four values from 0 to 1, normalized: always in the positive orthant, a bias of the suite.
pub fn randomize_joints(sim: &mut Simulation, stream: &mut Stream) {
    for joint in 0..sim.model().njnt() {
        let (kind, limits) = (sim.model().joint_kind(joint), sim.model().joint_limits(joint));
        let (at, _) = sim.model().joint_addresses(joint);
        match (kind, limits) {
            (JointKind::Hinge | JointKind::Slide, Some([low, high])) => {
                sim.qpos_mut()[at] = uniform(stream, low, high);
            }
            (JointKind::Hinge, None) => sim.qpos_mut()[at] = uniform(stream, -PI, PI),
            (JointKind::Slide, None) => {}
            (JointKind::Ball, Some([_, high])) => {
                let axis: [f64; 3] = direction(stream);
                let half = uniform(stream, 0.0, 1.0) * high / 2.0;
                let (sin, cos) = half.sin_cos();
                sim.qpos_mut()[at..at + 4].copy_from_slice(&[
                    cos,
                    sin * axis[0],
                    sin * axis[1],
                    sin * axis[2],
                ]);
            }
            (JointKind::Ball, None) => {
                sim.qpos_mut()[at..at + 4].copy_from_slice(&direction::<4>(stream));
            }
            (JointKind::Free, _) => {
                let rotation = normalized(std::array::from_fn::<f64, 4, _>(|_| uniform(stream, 0.0, 1.0)));
                sim.qpos_mut()[at + 3..at + 7].copy_from_slice(&rotation);
            }
        }
    }
}

/// Places things by `place` until nothing touches, at most `tries` times.
///
/// # Errors
///
/// [`MujocoError::Start`]: something touched in all of them; and whatever `place` meets.
pub fn until_free_of_contacts(
    stage: &mut Stage,
    tries: u32,
    mut place: impl FnMut(&mut Stage, u32) -> Result<(), MujocoError>,
) -> Result<(), MujocoError> {
    for attempt in 0..tries {
        place(stage, attempt)?;
        stage.sim.forward_without_actuation()?;
        if stage.sim.contacts() == 0 {
            return Ok(());
        }
    }
    Err(MujocoError::Start(format!("in {tries} tries something always touched")))
}
