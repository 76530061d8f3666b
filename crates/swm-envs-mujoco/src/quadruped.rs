//! `swm/QuadrupedDMControl-v0`: a four-legged robot with position servos. Source: `dm_control`'s `suite/quadruped.py` and
//! `quadruped.xml`, for its tasks on flat ground.

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::{
    Control, Domain, Effect, Falloff, Stage, Task, TaskEntry, direction, entry, factors, listed, make,
    planner, tolerance,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{JointKind, Model, Object, Spec};

/// The table entry.
pub const QUADRUPED: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/QuadrupedDMControl-v0",
    summary: "a four-legged robot that walks; twelve position servos",
    success: "",
    model: "quadruped.xml",
    substeps: 4,
    time_limit_s: TIME_LIMIT_S,
    // The side view, as in the reference; the first is a view of the whole floor.
    camera: 2,
    tasks: TASKS,
    planner: planner!("horizon=16,samples=16,iterations=2,elites=4,sigma=0.7"),
    policies: &[],
    infos: &[("torso_velocity", 3)],
    targets: &[],
    start_columns: &["qpos", "qvel", "act", "time", "qacc_warmstart"],
    compose,
    factors: controls,
};

const TIME_LIMIT_S: f64 = 20.0;
const WALK_SPEED: f64 = 0.5;
const RUN_SPEED: f64 = 5.0;

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("walk", "upright at 0.5 m/s", |model| Move::new(model, WALK_SPEED)),
    TaskEntry::new("run", "upright at 5 m/s", |model| Move::new(model, RUN_SPEED)),
];

/// Leaves the robot on a floor that it cannot walk off in an episode.
fn compose(spec: &mut Spec, task: &str) -> Result<(), MujocoError> {
    let size = TIME_LIMIT_S * if task == "run" { RUN_SPEED } else { WALK_SPEED };
    spec.geom("floor")?.set_size([size, size, 0.5]);
    spec.delete_rangefinders()?;
    for wall in ["wall_px", "wall_py", "wall_nx", "wall_ny", "terrain"] {
        spec.delete(Object::Geom, wall)?;
    }
    spec.delete(Object::Body, "ball")?;
    spec.delete(Object::Site, "target")
}

fn controls(stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color(if stock { [0.7, 0.5, 0.3] } else { [0.6, 0.3, 0.3] }),
        factors::scalar(
            "agent.foot_back_left_density",
            [500.0, 1500.0],
            if stock { 500.0 } else { 1000.0 },
            "density of the back left foot, kg/m³; the other feet have 500",
            Effect::Density(&["foot_back_left"]),
        ),
        factors::locked("agent.knee_back_left_locked", "knee_back_left"),
        factors::density("agent.torso_density", "density of the torso, kg/m³", Effect::Density(&["torso"])),
        factors::floor_color(),
        factors::floor_friction("floor", 1.0),
        factors::light_intensity("light", 0.7),
    ]
}

/// Tries of lifting the robot out of the ground, 1 cm each, as in the suite.
const TRIES: u32 = 10_000;

struct Move {
    /// Rewarded speed, m/s.
    speed: f64,
    torso: usize,
    /// Where the hinges' values are in positions and velocities.
    hinges: Vec<(usize, usize)>,
    velocity_sensor: usize,
    imu_sensors: [usize; 2],
    /// Forces, then torques, at the four toes.
    toe_sensors: [usize; 8],
}

impl Move {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, speed: f64) -> Result<Box<dyn Task>, MujocoError> {
        let hinges = (0..model.njnt()).filter(|joint| model.joint_kind(*joint) == JointKind::Hinge);
        let mut toe_sensors = [0; 8];
        let toes = ["front_left", "front_right", "back_right", "back_left"];
        let names = ["force", "torque"].iter().flat_map(|kind| toes.map(|toe| format!("{kind}_toe_{toe}")));
        for (sensor, name) in toe_sensors.iter_mut().zip(names) {
            *sensor = model.id(Object::Sensor, &name)?;
        }
        Ok(Box::new(Self {
            speed,
            torso: model.id(Object::Body, "torso")?,
            hinges: hinges.map(|joint| model.joint_addresses(joint)).collect(),
            velocity_sensor: model.id(Object::Sensor, "velocimeter")?,
            imu_sensors: [model.id(Object::Sensor, "imu_accel")?, model.id(Object::Sensor, "imu_gyro")?],
            toe_sensors,
        }))
    }

    /// The cosine of the torso's angle from upright.
    fn upright(&self, stage: &Stage) -> f64 {
        stage.sim.xmat(self.torso)[8]
    }
}

impl Task for Move {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        let orientation = direction::<4>(stream);
        for attempt in 0..TRIES {
            let sim = &mut stage.sim;
            sim.reset();
            let root = [0.0, 0.0, 0.01 * f64::from(attempt)];
            sim.qpos_mut()[..3].copy_from_slice(&root);
            sim.qpos_mut()[3..7].copy_from_slice(&orientation);
            match sim.forward_without_actuation() {
                Ok(()) if sim.contacts() == 0 => return Ok(()),
                // Deep in the ground there may be more contacts than there is room for: higher up there are not.
                Ok(()) | Err(MujocoError::Diverged { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Err(MujocoError::Start(format!("in {TRIES} tries something always touched")))
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        let sim = &stage.sim;
        out.extend(self.hinges.iter().map(|(position, _)| sim.qpos()[*position]));
        out.extend(self.hinges.iter().map(|(_, velocity)| sim.qvel()[*velocity]));
        out.extend_from_slice(sim.act());
        out.extend_from_slice(sim.sensor(self.velocity_sensor));
        out.push(self.upright(stage));
        for sensor in self.imu_sensors {
            out.extend_from_slice(sim.sensor(sensor));
        }
        for sensor in self.toe_sensors {
            out.extend(sim.sensor(sensor).iter().map(|value| value.asinh()));
        }
    }

    fn recall(&self, stage: &mut Stage, observation: &[f64]) {
        // Behind hinges, activations, the torso's velocity and its angle; the gyroscope follows from the state.
        let mut rest = &observation[2 * self.hinges.len() + stage.sim.act().len() + 4..];
        for (sensor, is_force) in self
            .imu_sensors
            .iter()
            .map(|sensor| (sensor, false))
            .chain(self.toe_sensors.iter().map(|sensor| (sensor, true)))
        {
            let values = stage.sim.sensor_mut(*sensor);
            let (known, behind) = rest.split_at(values.len());
            for (value, known) in values.iter_mut().zip(known) {
                *value = if is_force { known.sinh() } else { *known };
            }
            rest = behind;
        }
    }

    fn reward(&self, stage: &Stage) -> f64 {
        let upright = tolerance(self.upright(stage), [1.0, f64::INFINITY], 2.0, Falloff::Linear(0.0));
        let speed = stage.sim.sensor(self.velocity_sensor)[0];
        upright * tolerance(speed, [self.speed, f64::INFINITY], self.speed, Falloff::Linear(0.5))
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend_from_slice(stage.sim.sensor(self.velocity_sensor));
    }
}
