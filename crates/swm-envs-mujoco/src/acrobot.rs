//! `swm/AcrobotDMControl-v0`: two links, driven at the joint between them. Source: `dm_control`'s `suite/acrobot.py` and
//! `acrobot.xml`.

use std::f64::consts::PI;

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::{
    Control, Domain, Effect, GAUSSIAN, START_COLUMNS, Stage, Task, TaskEntry, distance, entry, factors,
    listed, make, planner, tolerance, unchanged, uniform,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape};

/// The table entry.
pub const ACROBOT: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/AcrobotDMControl-v0",
    summary: "swing two links up with one torque at the elbow",
    success: "the tip within 0.2 m of the point 4 m up",
    model: "acrobot.xml",
    substeps: 1,
    time_limit_s: 10.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=50,samples=48,iterations=2,elites=6,sigma=0.7,aggregate=mean"),
    policies: &[],
    infos: &[],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("swingup_sparse", "the tip within 0.2 m of the point above", |model| {
        SwingUp::new(model, 0.0)
    }),
    TaskEntry::new("swingup", "the tip near the point above, falling off over 1 m", |model| {
        SwingUp::new(model, 1.0)
    }),
];

/// Half the width of the target, m.
const TARGET: f64 = 0.2;

fn controls(_stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.lower_arm_density",
            "mass of the lower arm: 1 kg at 1000",
            Effect::Mass { geoms: &["lower_arm"], kg: 1.0 },
        ),
        factors::density(
            "agent.upper_arm_density",
            "mass of the upper arm: 1 kg at 1000",
            Effect::Mass { geoms: &["upper_arm"], kg: 1.0 },
        ),
        factors::locked("agent.upper_arm_locked", "shoulder"),
        factors::floor_color(),
        factors::light_intensity("light", 0.7),
        factors::hidden_target_color(),
        factors::target_shape(
            "1: the target is a ball, not rendered by default; 0: a cube. The reward counts the distance either way",
            Effect::Model(|model, values| {
                if values[0] == 0.0 {
                    let site = factors::show_site(model, "target")?;
                    model.set_site_shape(site, Shape::Box);
                    model.site_size_mut()[3 * site..][..3].fill(TARGET);
                }
                Ok(())
            }),
        ),
    ]
}

struct SwingUp {
    /// Distance over which the reward falls off; 0: at once, m.
    margin: f64,
    upper_arm: usize,
    lower_arm: usize,
    target: usize,
    tip: usize,
}

impl SwingUp {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, margin: f64) -> Result<Box<dyn Task>, MujocoError> {
        Ok(Box::new(Self {
            margin,
            upper_arm: model.id(Object::Body, "upper_arm")?,
            lower_arm: model.id(Object::Body, "lower_arm")?,
            target: model.id(Object::Site, "target")?,
            tip: model.id(Object::Site, "tip")?,
        }))
    }

    fn to_target(&self, stage: &Stage) -> f64 {
        distance(stage.sim.site_xpos(self.target), stage.sim.site_xpos(self.tip))
    }
}

impl Task for SwingUp {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        for angle in stage.sim.qpos_mut() {
            *angle = uniform(stream, -PI, PI);
        }
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        let (upper, lower) = (stage.sim.xmat(self.upper_arm), stage.sim.xmat(self.lower_arm));
        out.extend([upper[2], lower[2], upper[8], lower[8]]);
        out.extend_from_slice(stage.sim.qvel());
    }

    fn reward(&self, stage: &Stage) -> f64 {
        tolerance(self.to_target(stage), [0.0, TARGET], self.margin, GAUSSIAN)
    }

    fn cost(&self, stage: &Stage) -> Option<f64> {
        Some(self.to_target(stage))
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        Some(self.to_target(stage) <= TARGET)
    }
}
