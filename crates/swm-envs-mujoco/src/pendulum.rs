//! `swm/PendulumDMControl-v0`: a pendulum that must swing before it can stand. Source: `dm_control`'s `suite/pendulum.py`
//! and `pendulum.xml`.

use std::f64::consts::PI;

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::learned::learned_expert;
use crate::suite::{
    Control, Domain, Effect, START_COLUMNS, Stage, Task, TaskEntry, entry, factors, listed, make, planner,
    unchanged, uniform,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape};

/// The table entry.
pub const PENDULUM: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/PendulumDMControl-v0",
    summary: "swing a pendulum up and hold it; one weak torque",
    success: "within 8° of upright",
    model: "pendulum.xml",
    substeps: 1,
    time_limit_s: 20.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=40,samples=32,iterations=2,elites=6,sigma=0.7,aggregate=mean"),
    policies: &[learned_expert!("pendulum", TASKS, "swingup")],
    infos: &[],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[TaskEntry::new("swingup", "within 8 degrees of upright", |model| {
    Ok(Box::new(SwingUp { pole: model.id(Object::Body, "pole")? }))
})];

fn controls(_stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.mass_density",
            "mass of the bob: 1 kg at 1000",
            Effect::Mass { geoms: &["mass"], kg: 1.0 },
        ),
        factors::switch(
            "agent.mass_shape",
            1,
            "1: the bob is a ball; 0: a cube as wide, of the same mass",
            Effect::Spec(|spec, values| {
                let shape = if values[0] == 0.0 { Shape::Box } else { Shape::Sphere };
                spec.geom("mass")?.set_shape(shape).set_size([BOB; 3]);
                Ok(())
            }),
        ),
        factors::density(
            "agent.pole_density",
            "density of the pole, kg/m³, as far as it differs from 1000, where the pole has no mass of its own",
            Effect::Model(weigh_pole),
        ),
        factors::floor_color(),
        factors::light_intensity("light", 0.7),
    ]
}

/// Half the width of the bob, m.
const BOB: f64 = 0.05;
/// Half the length of the pole without its round ends, its radius and the height of its middle, m.
const POLE: (f64, f64, f64) = (0.25, 0.02, 0.25);

/// Adds what the pole weighs more (or less) than at 1000 kg/m³ to its body, in which the bob is all else.
///
/// The model's pole has no mass: as if what it weighs at 1000 kg/m³ were part of the bob. So the default is the model's,
/// and the factor adds or takes the difference.
fn weigh_pole(model: &mut Model, values: &[f64]) -> Result<(), MujocoError> {
    let density = values[0] - 1000.0;
    if density == 0.0 {
        return Ok(());
    }
    let body = model.id(Object::Body, "pole")?;
    let (half, radius, height) = POLE;
    let (length, square) = (2.0 * half, radius * radius);
    let side = density * PI * square * length;
    let ends = density * 4.0 / 3.0 * PI * square * radius;
    let mass = side + ends;
    // A capsule about its middle, across and along.
    let across = side * (3.0 * square + length * length) / 12.0
        + ends * (2.0 * square / 5.0 + length * length / 4.0 + 3.0 * length * radius / 8.0);
    let along = square * (side / 2.0 + 2.0 * ends / 5.0);
    let (bob, bob_height) = (model.body_mass()[body], model.body_ipos()[3 * body + 2]);
    let total = bob + mass;
    let middle = (bob * bob_height + mass * height) / total;
    let shift = bob * (bob_height - middle).powi(2) + mass * (height - middle).powi(2);
    model.body_mass_mut()[body] = total;
    model.body_ipos_mut()[3 * body + 2] = middle;
    for (inertia, added) in
        model.body_inertia_mut()[3 * body..].iter_mut().zip([across + shift, across + shift, along])
    {
        *inertia += added;
    }
    model.set_constants()
}

/// What counts as upright, degrees.
const UPRIGHT_DEGREES: f64 = 8.0;

struct SwingUp {
    pole: usize,
}

impl SwingUp {
    /// The cosine of the angle from upright.
    fn upright(&self, stage: &Stage) -> f64 {
        stage.sim.xmat(self.pole)[8]
    }

    fn is_up(&self, stage: &Stage) -> bool {
        (UPRIGHT_DEGREES.to_radians().cos()..=1.0).contains(&self.upright(stage))
    }
}

impl Task for SwingUp {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        stage.sim.qpos_mut()[0] = uniform(stream, -PI, PI);
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        let orientation = stage.sim.xmat(self.pole);
        out.extend([orientation[8], orientation[2], stage.sim.qvel()[0]]);
    }

    fn reward(&self, stage: &Stage) -> f64 {
        if self.is_up(stage) { 1.0 } else { 0.0 }
    }

    /// The energy that is missing, and the speed that is left at the top.
    fn cost(&self, stage: &Stage) -> Option<f64> {
        let speed = stage.sim.qvel()[0];
        Some(1.0 - self.upright(stage) + 0.01 * speed * speed)
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        Some(self.is_up(stage))
    }
}
