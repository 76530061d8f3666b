//! `swm/ReacherDMControl-v0`: a planar arm of two links that must reach a point. Source: `dm_control`'s `suite/reacher.py`
//! and `reacher.xml`; the task `qpos_match` is the reference's of August 2026.

use std::f64::consts::PI;

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::learned::learned_expert;
use crate::suite::{
    Control, Domain, Effect, Place, Stage, Target, Task, TaskEntry, entry, factors, listed, make, planner,
    randomize_joints, uniform,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape, Spec};

/// The table entry.
pub const REACHER: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/ReacherDMControl-v0",
    summary: "reach a point with a planar arm; two torques",
    success: "the finger touches the target",
    model: "reacher.xml",
    substeps: 1,
    time_limit_s: 20.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=15,samples=32,iterations=2,elites=6,sigma=0.5,aggregate=mean"),
    policies: &[learned_expert!("reacher", TASKS, "hard")],
    infos: &[("finger_pos", 3)],
    targets: &[
        Target { column: "target_pos", place: Place::GeomPosition("target") },
        Target { column: "target_qpos", place: Place::Memory(2) },
    ],
    start_columns: &["qpos", "qvel", "time", "qacc_warmstart", "target_pos"],
    compose: |spec, task| {
        // All three sizes: as many as any shape of the target needs.
        spec.geom("target")?.set_size([target_radius(task); 3]);
        Ok(())
    },
    factors: controls,
};

/// Indices into the domain's targets.
const POINT: usize = 0;
const ANGLES: usize = 1;

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("hard", "the finger touches a target of 1.5 cm", |model| Reach::new(model, false))
        .goal_columns(&["finger_pos"]),
    TaskEntry::new("easy", "the finger touches a target of 5 cm", |model| Reach::new(model, false))
        .goal_columns(&["finger_pos"]),
    TaskEntry::new(
        "qpos_match",
        "both joints within 0.05 rad of the goal's, which ends the episode",
        |model| Reach::new(model, true),
    )
    .goal_columns(&["qpos"]),
];

/// The radius of the target, m.
fn target_radius(task: &str) -> f64 {
    if task == "easy" { 0.05 } else { 0.015 }
}

fn controls(_stock: bool) -> Vec<Control> {
    vec![
        factors::density("agent.arm_density", "density of the arm, kg/m³", Effect::Density(&["arm"])),
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.finger_density",
            "density of the finger, kg/m³",
            Effect::Density(&["finger"]),
        ),
        factors::locked("agent.finger_locked", "wrist"),
        factors::floor_color(),
        factors::light_intensity("light", 0.7),
        factors::color("target.color", [0.6, 0.3, 0.3], "color of the target", Effect::Material("target")),
        factors::target_shape(
            "1: the target is a ball; 0: a cube as wide. The reward counts a disc either way",
            Effect::Spec(shape_target),
        ),
    ]
}

fn shape_target(spec: &mut Spec, values: &[f64]) -> Result<(), MujocoError> {
    let shape = if values[0] == 0.0 { Shape::Box } else { Shape::Sphere };
    spec.geom("target")?.set_shape(shape);
    Ok(())
}

/// Limit of the wrist, rad.
const WRIST: f64 = 160.0 * PI / 180.0;
/// How near every joint must be in `qpos_match`, rad.
const ANGLE_TOLERANCE: f64 = 0.05;

struct Reach {
    matches_angles: bool,
    target: usize,
    finger: usize,
    /// Distance at which the finger touches the target, m.
    radii: f64,
}

impl Reach {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, matches_angles: bool) -> Result<Box<dyn Task>, MujocoError> {
        let (target, finger) = (model.id(Object::Geom, "target")?, model.id(Object::Geom, "finger")?);
        let radii = model.geom_size()[3 * target] + model.geom_size()[3 * finger];
        Ok(Box::new(Self { matches_angles, target, finger, radii }))
    }

    /// From the finger to the target in the plane, m.
    fn to_target(&self, stage: &Stage) -> [f64; 2] {
        let (target, finger) = (stage.sim.geom_xpos(self.target), stage.sim.geom_xpos(self.finger));
        [target[0] - finger[0], target[1] - finger[1]]
    }

    fn distance(&self, stage: &Stage) -> f64 {
        let [x, y] = self.to_target(stage);
        (x * x + y * y).sqrt()
    }

    /// The largest difference of a joint from the goal's, rad.
    fn angle_error(stage: &Stage) -> f64 {
        let pairs = stage.sim.qpos().iter().zip(stage.target(ANGLES));
        pairs.map(|(angle, goal)| (angle - goal).abs()).fold(0.0, f64::max)
    }

    fn reached(&self, stage: &Stage) -> bool {
        if self.matches_angles {
            Self::angle_error(stage) < ANGLE_TOLERANCE
        } else {
            self.distance(stage) <= self.radii
        }
    }
}

impl Task for Reach {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        randomize_joints(&mut stage.sim, stream);
        let (angle, radius) = (uniform(stream, 0.0, 2.0 * PI), uniform(stream, 0.05, 0.2));
        let height = stage.target(POINT)[2];
        stage.set_target(POINT, &[radius * angle.sin(), radius * angle.cos(), height]);
        // The reference has no angles to match until somebody sets them; here they are drawn too.
        let angles = if self.matches_angles {
            [uniform(stream, -PI, PI), uniform(stream, -WRIST, WRIST)]
        } else {
            [0.0; 2]
        };
        stage.set_target(ANGLES, &angles);
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend_from_slice(stage.sim.qpos());
        out.extend(self.to_target(stage));
        out.extend_from_slice(stage.sim.qvel());
    }

    fn reward(&self, stage: &Stage) -> f64 {
        if self.distance(stage) <= self.radii { 1.0 } else { 0.0 }
    }

    fn cost(&self, stage: &Stage) -> Option<f64> {
        Some(if self.matches_angles { Self::angle_error(stage) } else { self.distance(stage) })
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        Some(self.reached(stage))
    }

    fn terminated(&self, stage: &Stage) -> bool {
        self.matches_angles && self.reached(stage)
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend(stage.sim.geom_xpos(self.finger));
    }

    fn goal_qpos<'a>(&self, stage: &'a Stage) -> Option<&'a [f64]> {
        self.matches_angles.then(|| stage.target(ANGLES))
    }

    fn set_goal(&self, stage: &mut Stage, column: &str, values: &[f64]) {
        match column {
            "qpos" => stage.set_target(ANGLES, values),
            _ => {
                let height = stage.target(POINT)[2];
                stage.set_target(POINT, &[values[0], values[1], height]);
            }
        }
    }
}
