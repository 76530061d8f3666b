//! `swm/WalkerDMControl-v0`: a planar walker on two legs. Source: `dm_control`'s `suite/walker.py` and `walker.xml`; tasks
//! beyond `walk`, `stand` and `run` are the reference's of August 2026.

use swm_core::seed::Stream;
use swm_core::{Dtype, EnvEntry, EnvTask, Space, Value};
use swm_fov::Factor;

use crate::suite::learned::learned_expert;
use crate::suite::{
    Control, Domain, Effect, Falloff, GAUSSIAN, START_COLUMNS, Stage, Task, TaskEntry, entry, factors,
    listed, make, planner, randomize_joints, tolerance, unchanged,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Spec};

/// The table entry.
pub const WALKER: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/WalkerDMControl-v0",
    summary: "a planar walker on two legs; six torques",
    success: "",
    model: "walker.xml",
    substeps: 10,
    time_limit_s: 25.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=20,samples=16,iterations=2,elites=4,sigma=0.7"),
    policies: &[learned_expert!("walker", TASKS, "walk")],
    infos: &[
        ("speed", 0),
        ("torso_height", 0),
        ("torso_upright", 0),
        ("left_foot_height", 0),
        ("right_foot_height", 0),
        ("left_thigh_height", 0),
        ("right_thigh_height", 0),
    ],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("walk", "upright at 1 m/s", |model| Walker::new(model, Goal::Move(1.0))),
    TaskEntry::new("stand", "upright", |model| Walker::new(model, Goal::Stand)),
    TaskEntry::new("run", "upright at 8 m/s", |model| Walker::new(model, Goal::Move(8.0))),
    TaskEntry::new("walk-backward", "upright at -1 m/s", |model| Walker::new(model, Goal::MoveBackward)),
    TaskEntry::new("arabesque", "on the left foot, the right one up", |model| {
        Walker::new(model, Goal::Arabesque)
    }),
    TaskEntry::new("lie_down", "torso and thighs on the ground", |model| Walker::new(model, Goal::LieDown)),
    TaskEntry::new("legs_up", "on the back, feet up", |model| Walker::new(model, Goal::LegsUp)),
    TaskEntry::new("flip", "feet and thighs up", |model| Walker::new(model, Goal::Flip)),
];

fn controls(stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.left_foot_density",
            "density of the left foot, kg/m³",
            Effect::Density(&["left_foot"]),
        ),
        factors::locked("agent.right_knee_locked", "right_knee"),
        factors::density("agent.torso_density", "density of the torso, kg/m³", Effect::Density(&["torso"])),
        factors::floor_color(),
        factors::floor_friction("floor", if stock { 0.7 } else { 1.0 }),
        Control {
            factor: Factor::new(
                "floor.rotation_y",
                Space::uniform_box(Dtype::F64, &[1], -10.0, 10.0),
                Value::vector(&[0.0]),
            )
            .doc("slope of the floor along the way, degrees; it goes down for positive ones, through the origin"),
            effect: Effect::Spec(slope_floor),
        },
        factors::light_intensity("light", 0.7),
    ]
}

/// How far ahead the middle of the floor is, m.
const FLOOR_AHEAD: f64 = 248.0;

/// Turns the floor about the origin, where the walker begins, and not about its own middle.
fn slope_floor(spec: &mut Spec, values: &[f64]) -> Result<(), MujocoError> {
    let (sin, cos) = values[0].to_radians().sin_cos();
    let mut floor = spec.geom("floor")?;
    floor.set_z_axis([sin, 0.0, cos]).set_position([FLOOR_AHEAD * cos, 0.0, -FLOOR_AHEAD * sin]);
    Ok(())
}

struct Walker {
    goal: Goal,
    /// Torso, then thigh, leg and foot of the right and of the left.
    bodies: [usize; 7],
    velocity_sensor: usize,
}

/// Indices into [`Walker::bodies`].
const TORSO: usize = 0;
const THIGHS: [usize; 2] = [1, 4];
const FEET: [usize; 2] = [3, 6];
const RIGHT: usize = 0;
const LEFT: usize = 1;

/// What is rewarded.
#[derive(Clone, Copy)]
enum Goal {
    Move(f64),
    Stand,
    MoveBackward,
    Arabesque,
    LieDown,
    LegsUp,
    Flip,
}

impl Walker {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, goal: Goal) -> Result<Box<dyn Task>, MujocoError> {
        let names =
            ["torso", "right_thigh", "right_leg", "right_foot", "left_thigh", "left_leg", "left_foot"];
        let mut bodies = [0; 7];
        for (body, name) in bodies.iter_mut().zip(names) {
            *body = model.id(Object::Body, name)?;
        }
        let velocity_sensor = model.id(Object::Sensor, "torso_subtreelinvel")?;
        Ok(Box::new(Self { goal, bodies, velocity_sensor }))
    }

    /// Forward speed of the center of mass, m/s.
    fn speed(&self, stage: &Stage) -> f64 {
        stage.sim.sensor(self.velocity_sensor)[0]
    }

    fn height(&self, stage: &Stage, body: usize) -> f64 {
        stage.sim.xpos(self.bodies[body])[2]
    }

    fn mean_height(&self, stage: &Stage, bodies: [usize; 2]) -> f64 {
        (self.height(stage, bodies[0]) + self.height(stage, bodies[1])) / 2.0
    }

    /// The cosine of the torso's angle from upright.
    fn upright(&self, stage: &Stage) -> f64 {
        stage.sim.xmat(self.bodies[TORSO])[8]
    }

    fn stand(&self, stage: &Stage) -> f64 {
        let standing = tolerance(self.height(stage, TORSO), [1.2, f64::INFINITY], 0.6, GAUSSIAN);
        let upright = (1.0 + self.upright(stage)) / 2.0;
        (3.0 * standing + upright) / 4.0
    }
}

fn above(height: f64, bound: f64) -> f64 {
    tolerance(height, [bound, f64::INFINITY], bound / 2.0, GAUSSIAN)
}

fn below(height: f64, margin: f64) -> f64 {
    tolerance(height, [f64::NEG_INFINITY, 0.08], margin, GAUSSIAN)
}

impl Task for Walker {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        randomize_joints(&mut stage.sim, stream);
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        for body in self.bodies {
            let orientation = stage.sim.xmat(body);
            out.extend([orientation[0], orientation[2]]);
        }
        out.push(self.height(stage, TORSO));
        out.extend_from_slice(stage.sim.qvel());
    }

    fn reward(&self, stage: &Stage) -> f64 {
        let (torso, speed) = (self.height(stage, TORSO), self.speed(stage));
        let (feet, thighs) = (self.mean_height(stage, FEET), self.mean_height(stage, THIGHS));
        let on_back = (1.0 - self.upright(stage)) / 2.0;
        match self.goal {
            Goal::Stand => self.stand(stage),
            Goal::Move(at) => {
                let moving = tolerance(speed, [at, f64::INFINITY], at / 2.0, Falloff::Linear(0.5));
                self.stand(stage) * (5.0 * moving + 1.0) / 6.0
            }
            Goal::MoveBackward => {
                let moving = tolerance(speed, [f64::NEG_INFINITY, -1.0], 0.5, Falloff::Linear(0.5));
                self.stand(stage) * (5.0 * moving + 1.0) / 6.0
            }
            Goal::Arabesque => {
                let left = below(self.height(stage, FEET[LEFT]), 0.5);
                let right = above(self.height(stage, FEET[RIGHT]), 1.0);
                (3.0 * above(torso, 1.0) + left + right + on_back) / 6.0
            }
            Goal::LieDown => (3.0 * below(torso, 0.04) + below(thighs, 0.04) + on_back) / 5.0,
            Goal::LegsUp => {
                (3.0 * below(torso, 0.04) + 2.0 * above(feet, 1.1) + below(thighs, 0.04) + on_back) / 7.0
            }
            Goal::Flip => (3.0 * above(feet, 1.1) + 2.0 * above(thighs, 1.0)) / 5.0,
        }
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend([self.speed(stage), self.height(stage, TORSO), self.upright(stage)]);
        for body in [FEET[LEFT], FEET[RIGHT], THIGHS[LEFT], THIGHS[RIGHT]] {
            out.push(self.height(stage, body));
        }
    }
}
