//! The arm and its gripper in the simulation: what they feel, and how actions move them. OGBench's control law: an action
//! moves the effector's present pose, inverse kinematics turn that into joint targets, and servos follow.

use super::arm::{self, Angles, Arm, FLANGE, HOME, JOINTS};
use super::layout::WORKSPACE;
use super::pose::{self, Pose};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// Where the arm's and the gripper's values are.
#[derive(Clone, Debug)]
pub(super) struct Robot {
    arm: Arm,
    /// The flange, seen from between the fingers.
    flange: Pose,
    pinch: usize,
    qpos: [usize; 6],
    qvel: [usize; 6],
    ctrl: [usize; 6],
    gripper_ctrl: usize,
    finger_qpos: usize,
    finger_qvel: usize,
    pad: usize,
}

/// The point between the fingers, and how the gripper is turned about the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Effector {
    /// m.
    pub(super) position: [f64; 3],
    /// rad.
    pub(super) yaw: f64,
}

/// What an action of 1 does: m along x, y, z, rad, and the gripper from open to closed.
pub(super) const ACTION_SCALE: [f64; 5] = [0.05, 0.05, 0.05, 0.3, 1.0];
/// The angle of a finger that is closed, rad.
const CLOSED: f64 = 0.8;
/// The control of a gripper that closes.
const GRIP: f64 = 255.0;
/// The force that counts as a contact of 1, N.
const FIRM: f64 = 50.0;

impl Robot {
    /// Finds everything in a model. The simulation stands at its reference position, computed.
    pub(super) fn new(sim: &Simulation) -> Result<Self, MujocoError> {
        let model: &Model = sim.model();
        let finger = model.id(Object::Joint, "ur5e/robotiq/right_driver_joint")?;
        let (finger_qpos, finger_qvel) = model.joint_addresses(finger);
        let (mut qpos, mut qvel, mut ctrl) = ([0; 6], [0; 6], [0; 6]);
        for (index, joint) in JOINTS.iter().enumerate() {
            (qpos[index], qvel[index]) = model.joint_addresses(model.id(Object::Joint, joint)?);
            ctrl[index] = model.id(Object::Actuator, joint.trim_end_matches("_joint"))?;
        }
        let pinch = model.id(Object::Site, "ur5e/robotiq/pinch")?;
        let site = |index| Pose {
            position: sim.site_xpos(index),
            rotation: pose::from_matrix(sim.site_xmat(index)),
        };
        Ok(Self {
            arm: Arm::new(model)?,
            flange: site(pinch).inverse().then(site(model.id(Object::Site, FLANGE)?)),
            pinch,
            qpos,
            qvel,
            ctrl,
            gripper_ctrl: model.id(Object::Actuator, "ur5e/robotiq/fingers_actuator")?,
            finger_qpos,
            finger_qvel,
            pad: model.id(Object::Body, "ur5e/robotiq/right_pad")?,
        })
    }

    /// The joints' angles, rad.
    pub(super) fn angles(&self, sim: &Simulation) -> Angles {
        self.qpos.map(|index| sim.qpos()[index])
    }

    /// The joints' velocities, rad/s.
    pub(super) fn velocities(&self, sim: &Simulation) -> Angles {
        self.qvel.map(|index| sim.qvel()[index])
    }

    /// Where the effector is, as last computed.
    pub(super) fn effector(&self, sim: &Simulation) -> Effector {
        let rotation = pose::from_matrix(sim.site_xmat(self.pinch));
        Effector { position: sim.site_xpos(self.pinch), yaw: pose::yaw(rotation) }
    }

    /// 0: open, 1: closed.
    pub(super) fn gripper_opening(&self, sim: &Simulation) -> f64 {
        (sim.qpos()[self.finger_qpos] / CLOSED).clamp(0.0, 1.0)
    }

    /// How fast the right finger closes, rad/s.
    pub(super) fn gripper_velocity(&self, sim: &Simulation) -> f64 {
        sim.qvel()[self.finger_qvel]
    }

    /// How firmly the right finger touches something, 0..1.
    pub(super) fn gripper_contact(&self, sim: &Simulation) -> f64 {
        let norm = sim.cfrc_ext(self.pad).iter().map(|x| x * x).sum::<f64>().sqrt();
        (norm / FIRM).clamp(0.0, 1.0)
    }

    /// Sets how firmly the right finger touches something, which the next physics step computes anew.
    pub(super) fn set_gripper_contact(&self, sim: &mut Simulation, contact: f64) {
        sim.set_cfrc_ext(self.pad, [contact * FIRM, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    /// Sets the servos' targets for an action, `[5]`: x, y, z, turn, gripper. Not clipped, as in the reference; the
    /// effector's target is kept in the workspace.
    pub(super) fn command(&self, sim: &mut Simulation, action: [f32; 5]) {
        self.command_from(sim, self.effector(sim), action);
    }

    /// As [`Robot::command`], where the effector is known from elsewhere.
    pub(super) fn command_from(&self, sim: &mut Simulation, effector: Effector, action: [f32; 5]) {
        // The reference's order of operations and types, for its rounding.
        let moved: [f64; 5] = std::array::from_fn(|k| {
            let share = f64::from(0.5 * (action[k] + 1.0));
            share * (ACTION_SCALE[k] + ACTION_SCALE[k]) - ACTION_SCALE[k]
        });
        let Effector { position, yaw } = effector;
        let opening = self.gripper_opening(sim);
        let position =
            std::array::from_fn(|k| (position[k] + moved[k]).clamp(WORKSPACE[0][k], WORKSPACE[1][k]));
        let turned = pose::multiply(pose::about_z(moved[3]), pose::about_z(yaw));
        let turned = pose::yaw(pose::multiply(turned, pose::inverse(arm::DOWN)));
        let target = Pose { position, rotation: arm::downward(turned) };
        let angles = self.arm.reach(target.then(self.flange), self.angles(sim));
        let ctrl = sim.ctrl_mut();
        for (index, angle) in self.ctrl.iter().zip(angles) {
            ctrl[*index] = angle;
        }
        ctrl[self.gripper_ctrl] = GRIP * (opening + moved[4]).clamp(0.0, 1.0);
    }

    /// Puts the effector to a pose, from the home position on. Computes nothing.
    pub(super) fn place(&self, sim: &mut Simulation, effector: Effector) {
        let target = Pose { position: effector.position, rotation: arm::downward(effector.yaw) };
        let angles = self.arm.reach(target.then(self.flange), HOME);
        for (index, angle) in self.qpos.iter().zip(angles) {
            sim.qpos_mut()[*index] = angle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::compose::{description, finish};
    use super::super::layout::Kind;
    use super::*;
    use std::sync::Arc;

    #[test]
    fn the_chain_agrees_with_the_simulation_and_reaches_what_it_is_asked_to() {
        let mut spec = description(Kind::Cubes(1)).unwrap();
        spec.shrink_meshes();
        let mut model = spec.compile().unwrap();
        finish(&mut model, true).unwrap();
        let mut sim = Simulation::new(Arc::new(model)).unwrap();
        sim.reset();
        sim.forward().unwrap();
        let robot = Robot::new(&sim).unwrap();
        assert!((robot.flange.position[2] + 0.1558).abs() < 1e-4, "{:?}", robot.flange);
        for (k, yaw) in [-3.0f64, -1.0, 0.3, 2.5].into_iter().enumerate() {
            let position = [0.3 + 0.07 * k as f64, 0.2 - 0.1 * k as f64, 0.25];
            robot.place(&mut sim, Effector { position, yaw });
            sim.forward().unwrap();
            let flange = robot.arm.flange(&robot.angles(&sim));
            let site = sim.site_xpos(sim.model().id(Object::Site, FLANGE).unwrap());
            assert!(pose::distance(flange.position, site) < 1e-12);
            let found = robot.effector(&sim);
            assert!(pose::distance(found.position, position) < 1e-3, "{found:?}");
            assert!((found.yaw - yaw).abs() < 1e-3, "{found:?}");
        }
    }
}
