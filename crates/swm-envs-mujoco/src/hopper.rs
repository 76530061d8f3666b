//! `swm/HopperDMControl-v0`: a planar one-legged hopper. Source: `dm_control`'s `suite/hopper.py` and `hopper.xml`; tasks
//! beyond `hop` and `stand` are the reference's of August 2026.

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::{
    Control, Domain, Effect, Falloff, GAUSSIAN, START_COLUMNS, Stage, Task, TaskEntry, entry, factors,
    listed, make, mean, planner, randomize_joints, recall_touch, tolerance, unchanged,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object};

/// The table entry.
pub const HOPPER: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/HopperDMControl-v0",
    summary: "a planar one-legged hopper that moves on; four torques",
    success: "",
    model: "hopper.xml",
    substeps: 4,
    time_limit_s: 20.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=25,samples=24,iterations=2,elites=5,sigma=0.7,aggregate=mean"),
    policies: &[],
    infos: &[("speed", 0), ("height", 0), ("angmomentum", 0)],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("hop", "stand and hop forwards at 2 m/s", |model| Hopper::new(model, Goal::Hop)),
    TaskEntry::new("stand", "stand with little effort", |model| Hopper::new(model, Goal::Stand)),
    TaskEntry::new("hop-backward", "stand and hop backwards at 1 m/s", |model| {
        Hopper::new(model, Goal::HopBackward)
    }),
    TaskEntry::new("flip", "turn over forwards", |model| Hopper::new(model, Goal::Flip(1.0))),
    TaskEntry::new("flip-backward", "turn over backwards", |model| Hopper::new(model, Goal::Flip(-1.0))),
];

fn controls(_stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density("agent.foot_density", "density of the foot, kg/m³", Effect::Density(&["foot"])),
        factors::locked("agent.foot_locked", "ankle"),
        factors::density(
            "agent.torso_density",
            "density of the torso without the nose, kg/m³",
            Effect::Density(&["torso"]),
        ),
        factors::floor_color(),
        factors::floor_friction("floor", 1.0),
        factors::light_intensity("top", 0.7),
    ]
}

/// Heights of the torso over the foot that count as standing, m.
const STANDING: [f64; 2] = [0.6, 2.0];
/// Speed at which hopping is rewarded in full, m/s.
const HOP_SPEED: f64 = 2.0;

struct Hopper {
    goal: Goal,
    torso: usize,
    foot: usize,
    velocity_sensor: usize,
    touch_sensors: [usize; 2],
}

/// What is rewarded.
#[derive(Clone, Copy)]
enum Goal {
    Hop,
    Stand,
    HopBackward,
    Flip(f64),
}

impl Hopper {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, goal: Goal) -> Result<Box<dyn Task>, MujocoError> {
        let sensor = |name: &str| model.id(Object::Sensor, name);
        Ok(Box::new(Self {
            goal,
            torso: model.id(Object::Body, "torso")?,
            foot: model.id(Object::Body, "foot")?,
            velocity_sensor: sensor("torso_subtreelinvel")?,
            touch_sensors: [sensor("touch_toe")?, sensor("touch_heel")?],
        }))
    }

    /// Forward speed of the center of mass, m/s.
    fn speed(&self, stage: &Stage) -> f64 {
        stage.sim.sensor(self.velocity_sensor)[0]
    }

    /// Height of the torso's center of mass over the foot's, m.
    fn height(&self, stage: &Stage) -> f64 {
        stage.sim.xipos(self.torso)[2] - stage.sim.xipos(self.foot)[2]
    }

    /// What is rewarded while it stands, 0 to 1.
    fn beside_standing(&self, stage: &Stage) -> f64 {
        let speed = self.speed(stage);
        match self.goal {
            Goal::Hop => {
                let fast = [HOP_SPEED, f64::INFINITY];
                tolerance(speed, fast, HOP_SPEED / 2.0, Falloff::Linear(0.5))
            }
            Goal::HopBackward => tolerance(speed, [f64::NEG_INFINITY, -1.0], 0.5, Falloff::Linear(0.5)),
            Goal::Stand => small_control(stage.sim.ctrl()),
            Goal::Flip(_) => 0.0,
        }
    }

    /// Angular momentum about the y axis, kg m²/s.
    fn angular_momentum(&self, stage: &Stage) -> f64 {
        stage.sim.subtree_angmom(self.torso)[1]
    }
}

/// How little is done: 1 for nothing, 0.8 for full torques.
pub(crate) fn small_control(controls: &[f64]) -> f64 {
    let calm = |control: &f64| tolerance(*control, [0.0, 0.0], 1.0, Falloff::Quadratic(0.0));
    // At most as many as the humanoid's.
    let mut each = [0.0; 32];
    let each = &mut each[..controls.len()];
    each.iter_mut().zip(controls).for_each(|(each, control)| *each = calm(control));
    (4.0 + mean(each)) / 5.0
}

impl Task for Hopper {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        randomize_joints(&mut stage.sim, stream);
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend_from_slice(&stage.sim.qpos()[1..]);
        out.extend_from_slice(stage.sim.qvel());
        out.extend(self.touch_sensors.map(|sensor| stage.sim.sensor(sensor)[0].ln_1p()));
    }

    fn recall(&self, stage: &mut Stage, observation: &[f64]) {
        let first = observation.len() - self.touch_sensors.len();
        recall_touch(stage, &self.touch_sensors, &observation[first..]);
    }

    fn reward(&self, stage: &Stage) -> f64 {
        let standing = tolerance(self.height(stage), STANDING, 0.0, GAUSSIAN);
        match self.goal {
            Goal::Flip(direction) => {
                let turning = direction * self.angular_momentum(stage);
                tolerance(turning, [5.0, f64::INFINITY], 2.5, Falloff::Linear(0.0))
            }
            _ => standing * self.beside_standing(stage),
        }
    }

    /// Standing is rewarded all or nothing: here a torso that rises counts too, and standing before what comes on top.
    fn cost(&self, stage: &Stage) -> Option<f64> {
        let rising = tolerance(self.height(stage), STANDING, STANDING[0], Falloff::Linear(0.0));
        match self.goal {
            Goal::Flip(_) => None,
            _ => Some(1.0 - rising * (1.0 + 3.0 * self.beside_standing(stage)) / 4.0),
        }
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend([self.speed(stage), self.height(stage), self.angular_momentum(stage)]);
    }
}
