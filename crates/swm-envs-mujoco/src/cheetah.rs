//! `swm/CheetahDMControl-v0`: a planar two-legged runner. Source: `dm_control`'s `suite/cheetah.py` and `cheetah.xml`;
//! tasks beyond `run` are those that the reference added in August 2026.

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::learned::learned_expert;
use crate::suite::{
    Control, Domain, Effect, Falloff, GAUSSIAN, START_COLUMNS, Stage, Task, TaskEntry, entry, factors,
    listed, make, planner, tolerance, unchanged, uniform,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object};

/// The table entry.
pub const CHEETAH: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/CheetahDMControl-v0",
    summary: "a planar two-legged runner that gains speed; six torques",
    success: "",
    model: "cheetah.xml",
    substeps: 1,
    // The reference's; dm_control's own episodes last 10 s.
    time_limit_s: 25.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=20,samples=32,iterations=2,elites=6,sigma=0.7"),
    policies: &[learned_expert!("cheetah", TASKS, "run")],
    infos: &[("speed", 0), ("torso_height", 0), ("bfoot_height", 0), ("ffoot_height", 0), ("angmomentum", 0)],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("run", "run forwards at 10 m/s", |model| Cheetah::new(model, Goal::Run(1.0))),
    TaskEntry::new("run-backward", "run backwards at 10 m/s", |model| Cheetah::new(model, Goal::Run(-1.0))),
    TaskEntry::new("stand-front", "stand still on the front foot", |model| {
        Cheetah::new(model, Goal::Stand(Legs::FRONT))
    }),
    TaskEntry::new("stand-back", "stand still on the back foot", |model| {
        Cheetah::new(model, Goal::Stand(Legs::BACK))
    }),
    TaskEntry::new("jump", "both feet and the torso in the air, without speed", |model| {
        Cheetah::new(model, Goal::Jump)
    }),
    TaskEntry::new("run-front", "run on the front foot at 5 m/s", |model| {
        Cheetah::new(model, Goal::RunOn(Legs::FRONT))
    }),
    TaskEntry::new("run-back", "run on the back foot at 5 m/s", |model| {
        Cheetah::new(model, Goal::RunOn(Legs::BACK))
    }),
    TaskEntry::new("lie-down", "torso and feet on the ground", |model| Cheetah::new(model, Goal::LieDown)),
    TaskEntry::new("legs-up", "torso on the ground, the back foot in the air", |model| {
        Cheetah::new(model, Goal::LegsUp)
    }),
    TaskEntry::new("flip", "turn over forwards", |model| Cheetah::new(model, Goal::Flip(1.0))),
    TaskEntry::new("flip-backward", "turn over backwards", |model| Cheetah::new(model, Goal::Flip(-1.0))),
];

fn controls(stock: bool) -> Vec<Control> {
    let body = if stock { [0.7, 0.5, 0.3] } else { [0.6, 0.3, 0.3] };
    let total = "; the total mass stays 14 kg";
    vec![
        factors::density(
            "agent.back_foot_density",
            &format!("density of the back foot, kg/m³{total}"),
            Effect::Density(&["bfoot"]),
        ),
        factors::locked("agent.back_foot_locked", "bfoot"),
        factors::agent_color(body),
        factors::density(
            "agent.torso_density",
            &format!("density of the torso without the head, kg/m³{total}"),
            Effect::Density(&["torso"]),
        ),
        factors::floor_color(),
        factors::floor_friction("ground", 1.0),
        factors::light_intensity("light", 0.7),
    ]
}

/// Physics steps after random joint angles, in which the body settles on the ground.
const SETTLING_STEPS: u32 = 200;
/// Speed at which `run` is rewarded in full, m/s.
const RUN_SPEED: f64 = 10.0;

struct Cheetah {
    goal: Goal,
    torso: usize,
    front_foot: usize,
    back_foot: usize,
    velocity_sensor: usize,
}

/// What is rewarded. The sign is the direction.
#[derive(Clone, Copy)]
enum Goal {
    Run(f64),
    Stand(Legs),
    Jump,
    RunOn(Legs),
    LieDown,
    LegsUp,
    Flip(f64),
}

/// On which legs it stands.
#[derive(Clone, Copy, PartialEq)]
struct Legs {
    front: bool,
}

impl Legs {
    const FRONT: Self = Self { front: true };
    const BACK: Self = Self { front: false };
}

impl Cheetah {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, goal: Goal) -> Result<Box<dyn Task>, MujocoError> {
        Ok(Box::new(Self {
            goal,
            torso: model.id(Object::Body, "torso")?,
            front_foot: model.id(Object::Body, "ffoot")?,
            back_foot: model.id(Object::Body, "bfoot")?,
            velocity_sensor: model.id(Object::Sensor, "torso_subtreelinvel")?,
        }))
    }

    /// Forward speed of the center of mass, m/s.
    fn speed(&self, stage: &Stage) -> f64 {
        stage.sim.sensor(self.velocity_sensor)[0]
    }

    fn height(stage: &Stage, body: usize) -> f64 {
        stage.sim.xpos(body)[2]
    }

    /// Angular momentum about the y axis, kg m²/s.
    fn angular_momentum(&self, stage: &Stage) -> f64 {
        stage.sim.subtree_angmom(self.torso)[1]
    }

    /// The foot in the air of a stand on the other.
    fn raised_foot(&self, legs: Legs) -> usize {
        if legs.front { self.back_foot } else { self.front_foot }
    }

    fn stand(&self, stage: &Stage, legs: Legs) -> f64 {
        let height = (Self::height(stage, self.torso) + Self::height(stage, self.raised_foot(legs))) / 2.0;
        let still = tolerance(self.speed(stage), [0.0, 0.0], 0.0, GAUSSIAN);
        (5.0 * up(height, 1.2, 0.6) + still) / 6.0
    }
}

fn up(height: f64, at_least: f64, margin: f64) -> f64 {
    tolerance(height, [at_least, f64::INFINITY], margin, GAUSSIAN)
}

fn faster(speed: f64, at_least: f64) -> f64 {
    tolerance(speed, [at_least, f64::INFINITY], at_least, Falloff::Linear(0.0))
}

fn low(height: f64) -> f64 {
    tolerance(height, [f64::NEG_INFINITY, 0.25], 0.25, Falloff::Linear(0.0))
}

impl Task for Cheetah {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        let sim = &mut stage.sim;
        for joint in 0..sim.model().njnt() {
            if let Some([low, high]) = sim.model().joint_limits(joint) {
                let (at, _) = sim.model().joint_addresses(joint);
                sim.qpos_mut()[at] = uniform(stream, low, high);
            }
        }
        sim.control_step(SETTLING_STEPS)?;
        sim.set_time(0.0);
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend_from_slice(&stage.sim.qpos()[1..]);
        out.extend_from_slice(stage.sim.qvel());
    }

    fn reward(&self, stage: &Stage) -> f64 {
        let torso = Self::height(stage, self.torso);
        match self.goal {
            Goal::Run(direction) => faster(direction * self.speed(stage), RUN_SPEED),
            Goal::Stand(legs) => self.stand(stage, legs),
            Goal::Jump => (self.stand(stage, Legs::FRONT) + self.stand(stage, Legs::BACK)) / 2.0,
            Goal::RunOn(legs) => {
                let foot = Self::height(stage, self.raised_foot(legs));
                let upright = (3.0 * up(foot, 1.2, 0.6) + 2.0 * up(torso, 1.2, 0.6)) / 5.0;
                upright * (5.0 * faster(self.speed(stage), 5.0) + 1.0) / 6.0
            }
            Goal::LieDown => {
                let feet = (Self::height(stage, self.front_foot) + Self::height(stage, self.back_foot)) / 2.0;
                (3.0 * low(torso) + low(feet)) / 4.0
            }
            Goal::LegsUp => {
                let lying = tolerance(torso, [f64::NEG_INFINITY, 0.25], 0.125, GAUSSIAN);
                (5.0 * lying + up(Self::height(stage, self.back_foot), 1.2, 0.6)) / 6.0
            }
            Goal::Flip(direction) => {
                let turning = faster(direction * self.angular_momentum(stage), 8.0);
                let moving = tolerance(direction * self.speed(stage), [0.0, f64::INFINITY], 0.0, GAUSSIAN);
                (2.0 * turning + moving) / 3.0
            }
        }
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend([
            self.speed(stage),
            Self::height(stage, self.torso),
            Self::height(stage, self.back_foot),
            Self::height(stage, self.front_foot),
            self.angular_momentum(stage),
        ]);
    }
}
