//! `swm/HumanoidDMControl-v0`: a humanoid with 21 torques. Source: `dm_control`'s `suite/humanoid.py` and `humanoid.xml`.

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::hopper::small_control;
use crate::suite::{
    Control, Domain, Effect, Falloff, GAUSSIAN, START_COLUMNS, Stage, Task, TaskEntry, entry, factors,
    listed, make, planner, randomize_joints, tolerance, unchanged, until_free_of_contacts,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// The table entry.
pub const HUMANOID: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/HumanoidDMControl-v0",
    summary: "a humanoid that stands up and walks; 21 torques",
    success: "",
    model: "humanoid.xml",
    substeps: 5,
    time_limit_s: 25.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=16,samples=20,iterations=2,elites=5,sigma=0.7"),
    policies: &[],
    infos: &[("speed", 0), ("torso_upright", 0), ("head_height", 0)],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("walk", "stand and move at 1 m/s", |model| Humanoid::new(model, 1.0)),
    TaskEntry::new("stand", "stand still", |model| Humanoid::new(model, 0.0)),
    TaskEntry::new("run", "stand and move at 10 m/s", |model| Humanoid::new(model, 10.0)),
];

fn controls(_stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::locked("agent.left_knee_locked", "left_knee"),
        factors::density(
            "agent.right_lower_arm_density",
            "density of the right lower arm, kg/m³",
            Effect::Density(&["right_lower_arm"]),
        ),
        factors::density(
            "agent.torso_density",
            "density of the torso without the waist, kg/m³",
            Effect::Density(&["torso"]),
        ),
        factors::floor_color(),
        factors::floor_friction("floor", 1.0),
        factors::light_intensity("top", 0.7),
    ]
}

/// Height of the head that counts as standing, m.
const STAND_HEIGHT: f64 = 1.4;
/// Tries of placing the joints where nothing touches; the suite tries without end.
pub(crate) const TRIES: u32 = 100_000;

/// Where the parts that are observed lie in a model with `dm_control`'s humanoid, OGBench's too.
pub(crate) struct Anatomy {
    torso: usize,
    head: usize,
    /// Hand and foot of the left, then of the right.
    limbs: [usize; 4],
    velocity_sensor: usize,
}

impl Anatomy {
    /// Values that [`Anatomy::observe`] gives.
    pub(crate) const OBSERVED: usize = 67;

    /// # Errors
    ///
    /// [`MujocoError::NoObject`]: the model has no such humanoid.
    pub(crate) fn new(model: &Model) -> Result<Self, MujocoError> {
        let body = |name: &str| model.id(Object::Body, name);
        Ok(Self {
            torso: body("torso")?,
            head: body("head")?,
            limbs: [body("left_hand")?, body("left_foot")?, body("right_hand")?, body("right_foot")?],
            velocity_sensor: model.id(Object::Sensor, "torso_subtreelinvel")?,
        })
    }

    /// Appends joint angles (21), the height of the head, hands and feet in the torso's frame (12), the torso's vertical (3), the
    /// velocity of the center of mass (3), and all velocities (27).
    pub(crate) fn observe(&self, sim: &Simulation, out: &mut Vec<f64>) {
        let (torso, frame) = (sim.xpos(self.torso), sim.xmat(self.torso));
        out.extend_from_slice(&sim.qpos()[7..]);
        out.push(sim.xpos(self.head)[2]);
        for limb in self.limbs {
            let limb = sim.xpos(limb);
            let offset = [0, 1, 2].map(|i| limb[i] - torso[i]);
            // Into the torso's frame.
            out.extend([0, 1, 2].map(|column| {
                offset[0] * frame[column] + offset[1] * frame[3 + column] + offset[2] * frame[6 + column]
            }));
        }
        out.extend_from_slice(&frame[6..9]);
        out.extend_from_slice(sim.sensor(self.velocity_sensor));
        out.extend_from_slice(sim.qvel());
    }
}

struct Humanoid {
    /// Rewarded speed, m/s; 0: stand still.
    speed: f64,
    anatomy: Anatomy,
}

impl Humanoid {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, speed: f64) -> Result<Box<dyn Task>, MujocoError> {
        Ok(Box::new(Self { speed, anatomy: Anatomy::new(model)? }))
    }

    /// The cosine of the torso's angle from upright.
    fn upright(&self, stage: &Stage) -> f64 {
        stage.sim.xmat(self.anatomy.torso)[8]
    }

    fn head_height(&self, stage: &Stage) -> f64 {
        stage.sim.xpos(self.anatomy.head)[2]
    }

    /// Velocity of the center of mass in the plane, m/s.
    fn velocity(&self, stage: &Stage) -> [f64; 2] {
        let velocity = stage.sim.sensor(self.anatomy.velocity_sensor);
        [velocity[0], velocity[1]]
    }

    /// Its length.
    fn horizontal_speed(&self, stage: &Stage) -> f64 {
        let [x, y] = self.velocity(stage);
        (x * x + y * y).sqrt()
    }
}

impl Task for Humanoid {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        until_free_of_contacts(stage, TRIES, |stage, _| {
            randomize_joints(&mut stage.sim, stream);
            Ok(())
        })
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        self.anatomy.observe(&stage.sim, out);
    }

    fn reward(&self, stage: &Stage) -> f64 {
        let head = [STAND_HEIGHT, f64::INFINITY];
        let standing = tolerance(self.head_height(stage), head, STAND_HEIGHT / 4.0, GAUSSIAN);
        let upright = tolerance(self.upright(stage), [0.9, f64::INFINITY], 1.9, Falloff::Linear(0.0));
        let stand = standing * upright;
        let small_control = small_control(stage.sim.ctrl());
        if self.speed == 0.0 {
            let still = self.velocity(stage).map(|v| tolerance(v, [0.0, 0.0], 2.0, GAUSSIAN));
            return small_control * stand * ((still[0] + still[1]) / 2.0);
        }
        let fast = [self.speed, f64::INFINITY];
        let moving = tolerance(self.horizontal_speed(stage), fast, self.speed, Falloff::Linear(0.0));
        small_control * stand * ((5.0 * moving + 1.0) / 6.0)
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend([self.horizontal_speed(stage), self.upright(stage), self.head_height(stage)]);
    }
}
