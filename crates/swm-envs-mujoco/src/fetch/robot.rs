//! The arm at its table: where its parts are in the model, control steps, observations.

use super::task::{STRIDE, SUBSTEPS, Task};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// What the gripper's orientation is driven by: the original adds it to the present one.
const TURN: [f64; 4] = [1.0, 0.0, 1.0, 0.0];

/// Indices into the model.
struct Ids {
    grip: usize,
    gripper_link: usize,
    /// Of the right and the left finger: in `qpos`, and in `qvel`.
    fingers: [(usize, usize); 2],
    object: Option<ObjectIds>,
}

#[derive(Clone, Copy)]
struct ObjectIds {
    site: usize,
    qpos: usize,
    qvel: usize,
}

/// A simulation of one of the tasks.
pub(super) struct Robot {
    pub(super) sim: Simulation,
    task: Task,
    ids: Ids,
    jacobian: Vec<f64>,
}

impl Robot {
    /// Finds the parts of the robot in the simulation's model.
    pub(super) fn new(task: Task, sim: Simulation) -> Result<Self, MujocoError> {
        let ids = Ids::of(task, sim.model())?;
        Ok(Self { sim, task, ids, jacobian: Vec::new() })
    }

    /// One control step.
    ///
    /// After physics steps, positions are one step old. Where the fingers are blocked, they are computed anew before the
    /// observation is taken; with PickAndPlace behind it, where the reference draws.
    pub(super) fn advance(
        &mut self,
        action: [f32; 4],
        observation: &mut Vec<f64>,
    ) -> Result<(), MujocoError> {
        let action = action.map(|value| value.clamp(-1.0, 1.0));
        let (place, turn) = (self.sim.xpos(self.ids.gripper_link), self.sim.xquat(self.ids.gripper_link));
        let target: [f64; 3] = std::array::from_fn(|k| place[k] + f64::from(action[k] * STRIDE));
        let turned: [f64; 4] = std::array::from_fn(|k| turn[k] + TURN[k]);
        self.sim.mocap_pos_mut().copy_from_slice(&target);
        self.sim.mocap_quat_mut().copy_from_slice(&turned);
        let [right, left] = self.ids.fingers.map(|(qpos, _)| qpos);
        if self.task.blocks_gripper() {
            self.sim.steps(SUBSTEPS)?;
            self.sim.qpos_mut()[right] = 0.0;
            self.sim.qpos_mut()[left] = 0.0;
            self.sim.forward()?;
            self.observe(observation);
            return Ok(());
        }
        // The actuators stand the other way round than the joints.
        let opened = [left, right].map(|finger| self.sim.qpos()[finger] + f64::from(action[3]));
        self.sim.ctrl_mut().copy_from_slice(&opened);
        self.sim.steps(SUBSTEPS)?;
        self.observe(observation);
        self.sim.forward()
    }

    /// Writes the observation of the positions that were last computed and the present velocities.
    pub(super) fn observe(&mut self, out: &mut Vec<f64>) {
        let Self { sim, ids, jacobian, .. } = self;
        let dt = f64::from(SUBSTEPS) * sim.model().timestep_s();
        let scaled = |values: [f64; 3]| values.map(|value| value * dt);
        let grip = sim.site_xpos(ids.grip);
        let grip_velocity = scaled(sim.site_velocity(ids.grip, jacobian)[0]);
        let fingers = ids.fingers.map(|(qpos, _)| sim.qpos()[qpos]);
        let finger_velocities = ids.fingers.map(|(_, qvel)| sim.qvel()[qvel] * dt);
        out.clear();
        out.extend(grip);
        if let Some(object) = ids.object {
            let place = sim.site_xpos(object.site);
            let [linear, angular] = sim.site_velocity(object.site, jacobian).map(scaled);
            out.extend(place);
            out.extend(minus(place, grip));
            out.extend(fingers);
            out.extend(euler(sim.site_xmat(object.site)));
            out.extend(minus(linear, grip_velocity));
            out.extend(angular);
        } else {
            out.extend(fingers);
        }
        out.extend(grip_velocity);
        out.extend(finger_velocities);
    }

    /// Where the gripper is, m.
    pub(super) fn grip(&self) -> [f64; 3] {
        self.sim.site_xpos(self.ids.grip)
    }

    /// Where the object is, m; without one, the gripper.
    pub(super) fn achieved(&self) -> [f64; 3] {
        self.sim.site_xpos(self.ids.object.map_or(self.ids.grip, |object| object.site))
    }

    /// The linear velocity of the object's joint, m/s.
    pub(super) fn object_velocity(&self) -> [f64; 3] {
        self.ids.object.map_or([0.0; 3], |object| std::array::from_fn(|k| self.sim.qvel()[object.qvel + k]))
    }

    /// The position of the object's joint, x y z and quaternion, to be set.
    pub(super) fn object_pose_mut(&mut self) -> Option<&mut [f64]> {
        let object = self.ids.object?;
        Some(&mut self.sim.qpos_mut()[object.qpos..object.qpos + 7])
    }
}

impl Ids {
    fn of(task: Task, model: &Model) -> Result<Self, MujocoError> {
        let joint = |name: &str| Ok::<_, MujocoError>(model.joint_addresses(model.id(Object::Joint, name)?));
        let object = if task.has_object() {
            let (qpos, qvel) = joint("object0:joint")?;
            Some(ObjectIds { site: model.id(Object::Site, "object0")?, qpos, qvel })
        } else {
            None
        };
        Ok(Self {
            grip: model.id(Object::Site, "robot0:grip")?,
            gripper_link: model.id(Object::Body, "robot0:gripper_link")?,
            fingers: [joint("robot0:r_gripper_finger_joint")?, joint("robot0:l_gripper_finger_joint")?],
            object,
        })
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// The distance of two places, m.
pub(super) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    minus(a, b).iter().map(|difference| difference * difference).sum::<f64>().sqrt()
}

/// Euler angles of a row-major rotation matrix, as gymnasium-robotics defines them (`mat2euler`).
fn euler(r: [f64; 9]) -> [f64; 3] {
    let cosine = (r[8] * r[8] + r[5] * r[5]).sqrt();
    let second = -(-r[2]).atan2(cosine);
    if cosine > 4.0 * f64::EPSILON {
        [-r[5].atan2(r[8]), second, -r[1].atan2(r[0])]
    } else {
        [0.0, second, -(-r[3]).atan2(r[4])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_of_turns_about_one_axis() {
        let (sin, cos) = 0.3_f64.sin_cos();
        let near =
            |found: [f64; 3], expected: [f64; 3]| assert!(distance(found, expected) < 1e-15, "{found:?}");
        near(euler([1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos]), [0.3, 0.0, 0.0]);
        near(euler([cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos]), [0.0, 0.3, 0.0]);
        near(euler([cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0]), [0.0, 0.0, 0.3]);
        // Where the first and the third axis coincide, the third angle takes all.
        near(euler([0.0, 0.0, 1.0, sin, cos, 0.0, -cos, sin, 0.0]), [0.0, std::f64::consts::FRAC_PI_2, 0.3]);
    }
}
