//! `swm/ManipulatorDMControl-v0`: a planar arm with a hand that brings a ball to a place. Source: `dm_control`'s
//! `suite/manipulator.py` and `manipulator.xml`, for the task with the ball.

use std::f64::consts::PI;

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::{
    Control, Domain, Effect, GAUSSIAN, Place, Stage, Target, Task, TaskEntry, distance, entry, factors,
    listed, make, planner, recall_touch, tolerance, uniform, until_free_of_contacts,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape, Spec};

/// The table entry.
pub const MANIPULATOR: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/ManipulatorDMControl-v0",
    summary: "bring a ball to a place with a planar arm; four torques and a grasp",
    success: "the ball within 1 cm of the target",
    model: "manipulator.xml",
    substeps: 10,
    time_limit_s: 10.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=20,samples=16,iterations=2,elites=4,sigma=0.7,aggregate=mean"),
    policies: &[],
    infos: &[("ball_pos", 3)],
    targets: &[
        Target { column: "target_pos", place: Place::BodyPosition("target_ball") },
        Target { column: "target_quat", place: Place::BodyQuaternion("target_ball") },
    ],
    start_columns: &["qpos", "qvel", "time", "qacc_warmstart", "target_pos", "target_quat"],
    compose: |spec, _| {
        for body in ["cup", "peg", "target_peg", "slot"] {
            spec.delete(Object::Body, body)?;
        }
        Ok(())
    },
    factors: controls,
};

/// Indices into the domain's targets.
const POSITION: usize = 0;
const ORIENTATION: usize = 1;

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[TaskEntry::new(
    "bring_ball",
    "the ball within 1 cm of its place, falling off over 2 cm",
    BringBall::new,
)
.goal_columns(&["ball_pos"])];

/// Length of the upper arm, m.
const UPPER_ARM: f64 = 0.18;

fn controls(stock: bool) -> Vec<Control> {
    let arm_density = if stock { 500.0 } else { 1000.0 };
    let density = |name: &str, doc: &str, effect: Effect| {
        factors::scalar(name, [500.0, 1500.0], arm_density, doc, effect)
    };
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        density(
            "agent.hand_density",
            "density of the hand without the palm, kg/m³",
            Effect::Density(&["hand"]),
        ),
        density(
            "agent.upper_arm_density",
            "density of the upper arm, kg/m³",
            Effect::Density(&["upper_arm"]),
        ),
        factors::density(
            "agent.upper_arm_length",
            "length of the upper arm: 0.18 m at 1000",
            Effect::Spec(|spec, values| {
                let length = UPPER_ARM * values[0] / 1000.0;
                spec.geom("upper_arm")?.set_from_to([0.0, 0.0, 0.0, 0.0, 0.0, length]);
                spec.body("middle_arm")?.set_position([0.0, 0.0, length]);
                Ok(())
            }),
        ),
        factors::floor_color(),
        factors::light_intensity("light", if stock { 0.6 } else { 0.7 }),
        factors::color("target.color", [0.6, 0.3, 0.3], "color of the target", Effect::Material("target")),
        factors::target_shape(
            "1: the target is a ball; 0: a cube as wide. The reward counts the distance either way",
            Effect::Spec(if stock {
                |spec, values| shape_target(spec, values, 0.02)
            } else {
                |spec, values| shape_target(spec, values, 0.015)
            }),
        ),
    ]
}

fn shape_target(spec: &mut Spec, values: &[f64], radius: f64) -> Result<(), MujocoError> {
    let shape = if values[0] == 0.0 { Shape::Box } else { Shape::Sphere };
    spec.geom("target_ball")?.set_shape(shape).set_size([radius; 3]);
    Ok(())
}

/// Distance that counts as there, m.
const CLOSE: f64 = 0.01;
/// Shares of episodes that begin with the ball in the hand and at its place.
const IN_HAND: f64 = 0.1;
const IN_TARGET: f64 = 0.1;
/// Tries of placing everything where nothing touches; the suite tries without end.
const TRIES: u32 = 100_000;

struct BringBall {
    /// Position and velocity of each joint of arm and hand.
    arm: [(usize, usize); 8],
    /// Limits of each; a full turn without.
    ranges: [[f64; 2]; 8],
    /// Of the ball: x, z, angle.
    ball_joints: [(usize, usize); 3],
    touch_sensors: [usize; 5],
    hand: usize,
    ball: usize,
    target: usize,
    grasp_site: usize,
    ball_site: usize,
    target_site: usize,
}

const ARM_JOINTS: [&str; 8] =
    ["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist", "finger", "fingertip", "thumb", "thumbtip"];
/// Indices into [`ARM_JOINTS`].
const FINGER: usize = 4;
const THUMB: usize = 6;

impl BringBall {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model) -> Result<Box<dyn Task>, MujocoError> {
        let (mut arm, mut ranges) = ([(0, 0); 8], [[-PI, PI]; 8]);
        for ((joint, range), name) in arm.iter_mut().zip(&mut ranges).zip(ARM_JOINTS) {
            let id = model.id(Object::Joint, name)?;
            *joint = model.joint_addresses(id);
            *range = model.joint_limits(id).unwrap_or(*range);
        }
        let mut ball_joints = [(0, 0); 3];
        for (joint, name) in ball_joints.iter_mut().zip(["ball_x", "ball_z", "ball_y"]) {
            *joint = model.joint_addresses(model.id(Object::Joint, name)?);
        }
        let mut touch_sensors = [0; 5];
        let names = ["palm_touch", "finger_touch", "thumb_touch", "fingertip_touch", "thumbtip_touch"];
        for (sensor, name) in touch_sensors.iter_mut().zip(names) {
            *sensor = model.id(Object::Sensor, name)?;
        }
        Ok(Box::new(Self {
            arm,
            ranges,
            ball_joints,
            touch_sensors,
            hand: model.id(Object::Body, "hand")?,
            ball: model.id(Object::Body, "ball")?,
            target: model.id(Object::Body, "target_ball")?,
            grasp_site: model.id(Object::Site, "grasp")?,
            ball_site: model.id(Object::Site, "ball")?,
            target_site: model.id(Object::Site, "target_ball")?,
        }))
    }

    fn to_target(&self, stage: &Stage) -> f64 {
        distance(stage.sim.site_xpos(self.ball_site), stage.sim.site_xpos(self.target_site))
    }

    /// One draw of everything; it may touch.
    fn place(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        for ((position, _), [low, high]) in self.arm.iter().zip(self.ranges) {
            stage.sim.qpos_mut()[*position] = uniform(stream, low, high);
        }
        let (finger, thumb) = (self.arm[FINGER].0, self.arm[THUMB].0);
        stage.sim.qpos_mut()[finger] = stage.sim.qpos()[thumb];
        let (x, z) = (uniform(stream, -0.4, 0.4), uniform(stream, 0.1, 0.4));
        let angle = uniform(stream, -PI, PI);
        let depth = stage.target(POSITION)[1];
        stage.set_target(POSITION, &[x, depth, z]);
        stage.set_target(ORIENTATION, &[(angle / 2.0).cos(), 0.0, (angle / 2.0).sin(), 0.0]);
        let choice = uniform(stream, 0.0, 1.0);
        let pose = if choice < IN_HAND {
            stage.sim.forward_without_actuation()?;
            let (grasp, frame) = (stage.sim.site_xpos(self.grasp_site), stage.sim.site_xmat(self.grasp_site));
            [grasp[0], grasp[2], PI - frame[6].atan2(frame[0])]
        } else if choice < IN_HAND + IN_TARGET {
            [x, z, angle]
        } else {
            let pose =
                [uniform(stream, -0.5, 0.5), uniform(stream, 0.0, 0.7), uniform(stream, 0.0, 2.0 * PI)];
            stage.sim.qvel_mut()[self.ball_joints[0].1] = uniform(stream, -5.0, 5.0);
            pose
        };
        for ((position, _), value) in self.ball_joints.iter().zip(pose) {
            stage.sim.qpos_mut()[*position] = value;
        }
        Ok(())
    }
}

impl Task for BringBall {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        until_free_of_contacts(stage, TRIES, |stage, _| self.place(stage, stream))
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        let sim = &stage.sim;
        let pose = |body: usize| {
            let (position, orientation) = (sim.xpos(body), sim.xquat(body));
            [position[0], position[2], orientation[0], orientation[2]]
        };
        for (position, _) in self.arm {
            let (sin, cos) = sim.qpos()[position].sin_cos();
            out.extend([sin, cos]);
        }
        out.extend(self.arm.map(|(_, velocity)| sim.qvel()[velocity]));
        out.extend(self.touch_sensors.map(|sensor| sim.sensor(sensor)[0].ln_1p()));
        out.extend(pose(self.hand));
        out.extend(pose(self.ball));
        out.extend(self.ball_joints.map(|(_, velocity)| sim.qvel()[velocity]));
        out.extend(pose(self.target));
    }

    fn recall(&self, stage: &mut Stage, observation: &[f64]) {
        // Behind a sine, a cosine and a velocity of each joint of the arm.
        recall_touch(stage, &self.touch_sensors, &observation[3 * self.arm.len()..]);
    }

    fn reward(&self, stage: &Stage) -> f64 {
        tolerance(self.to_target(stage), [0.0, CLOSE], 2.0 * CLOSE, GAUSSIAN)
    }

    /// The way of the ball to its place, and that of the hand to the ball.
    fn cost(&self, stage: &Stage) -> Option<f64> {
        let grasp = distance(stage.sim.site_xpos(self.grasp_site), stage.sim.site_xpos(self.ball_site));
        Some(self.to_target(stage) + 0.5 * grasp)
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        Some(self.to_target(stage) <= CLOSE)
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend(stage.sim.site_xpos(self.ball_site));
    }

    fn set_goal(&self, stage: &mut Stage, _column: &str, values: &[f64]) {
        stage.set_target(POSITION, values);
    }
}
