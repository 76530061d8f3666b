//! `swm/CartpoleDMControl-v0`: a cart on rails that carries a pole. Source: `dm_control`'s `suite/cartpole.py` and
//! `cartpole.xml`, with one pole.

use std::f64::consts::PI;

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::learned::learned_expert;
use crate::suite::{
    Control, Domain, Effect, Falloff, GAUSSIAN, START_COLUMNS, Stage, Task, TaskEntry, entry, factors,
    listed, make, normal, planner, tolerance, unchanged, uniform,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape};

/// The table entry.
pub const CARTPOLE: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/CartpoleDMControl-v0",
    summary: "swing a pole up on a cart and hold it; one force",
    success: "the cart within 0.25 m of the center, the pole upright",
    model: "cartpole.xml",
    substeps: 1,
    time_limit_s: 10.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=80,samples=24,iterations=2,elites=5,sigma=0.7,noise_beta=2.5,aggregate=mean"),
    policies: &[learned_expert!("cartpole", TASKS, "swingup")],
    infos: &[],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("swingup_sparse", "from below: pole upright, cart in the middle", |model| {
        Balance::new(model, true, true)
    }),
    TaskEntry::new("swingup", "from below: pole up, cart in the middle, calm", |model| {
        Balance::new(model, true, false)
    }),
    TaskEntry::new("balance", "from above: pole up, cart in the middle, calm", |model| {
        Balance::new(model, false, false)
    }),
    TaskEntry::new("balance_sparse", "from above: pole upright, cart in the middle", |model| {
        Balance::new(model, false, true)
    }),
];

/// Half lengths of the cart, m.
const CART: [f64; 3] = [0.2, 0.15, 0.1];
/// Radius of a ball with its volume, m.
const CART_RADIUS: f64 = 0.178_940_1;

fn controls(_stock: bool) -> Vec<Control> {
    vec![
        factors::scalar(
            "agent.cart_mass",
            [0.5, 1.5],
            1.0,
            "mass of the cart, kg",
            Effect::Spec(|spec, values| {
                spec.geom("cart")?.set_mass(values[0]);
                Ok(())
            }),
        ),
        factors::switch(
            "agent.cart_shape",
            1,
            "1: the cart is a box; 0: a ball of the same volume and mass",
            Effect::Spec(|spec, values| {
                let (shape, size) =
                    if values[0] == 0.0 { (Shape::Sphere, [CART_RADIUS; 3]) } else { (Shape::Box, CART) };
                spec.geom("cart")?.set_shape(shape).set_size(size);
                Ok(())
            }),
        ),
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.pole_density",
            "mass of the pole: 0.1 kg at 1000",
            Effect::Mass { geoms: &["pole_1"], kg: 0.1 },
        ),
        factors::floor_color(),
        factors::light_intensity("light", 0.7),
    ]
}

/// Where the cart may be for the sparse reward, m.
const CART_RANGE: [f64; 2] = [-0.25, 0.25];
/// What counts as upright: the cosine of the pole's angle.
const ANGLE_COSINE_RANGE: [f64; 2] = [0.995, 1.0];

struct Balance {
    from_below: bool,
    sparse: bool,
    pole: usize,
}

impl Balance {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, from_below: bool, sparse: bool) -> Result<Box<dyn Task>, MujocoError> {
        Ok(Box::new(Self { from_below, sparse, pole: model.id(Object::Body, "pole_1")? }))
    }

    fn cart(stage: &Stage) -> f64 {
        stage.sim.qpos()[0]
    }

    /// The cosine of the pole's angle from upright.
    fn upright(&self, stage: &Stage) -> f64 {
        stage.sim.xmat(self.pole)[8]
    }

    fn balanced(&self, stage: &Stage) -> f64 {
        tolerance(Self::cart(stage), CART_RANGE, 0.0, GAUSSIAN)
            * tolerance(self.upright(stage), ANGLE_COSINE_RANGE, 0.0, GAUSSIAN)
    }

    fn smooth(&self, stage: &Stage) -> f64 {
        let upright = (self.upright(stage) + 1.0) / 2.0;
        let centered = (1.0 + tolerance(Self::cart(stage), [0.0, 0.0], 2.0, GAUSSIAN)) / 2.0;
        let control = tolerance(stage.sim.ctrl()[0], [0.0, 0.0], 1.0, Falloff::Quadratic(0.0));
        let small_control = (4.0 + control) / 5.0;
        let velocity = tolerance(stage.sim.qvel()[1], [0.0, 0.0], 5.0, GAUSSIAN);
        let small_velocity = (1.0 + velocity) / 2.0;
        upright * small_control * small_velocity * centered
    }
}

impl Task for Balance {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        let (cart, pole) = if self.from_below {
            (0.01 * normal(stream), PI + 0.01 * normal(stream))
        } else {
            (uniform(stream, -0.1, 0.1), uniform(stream, -0.034, 0.034))
        };
        stage.sim.qpos_mut().copy_from_slice(&[cart, pole]);
        for velocity in stage.sim.qvel_mut() {
            *velocity = 0.01 * normal(stream);
        }
        Ok(())
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        let orientation = stage.sim.xmat(self.pole);
        out.extend([Self::cart(stage), orientation[8], orientation[2]]);
        out.extend_from_slice(stage.sim.qvel());
    }

    fn reward(&self, stage: &Stage) -> f64 {
        if self.sparse { self.balanced(stage) } else { self.smooth(stage) }
    }

    fn cost(&self, stage: &Stage) -> Option<f64> {
        self.sparse.then(|| 1.0 - self.smooth(stage))
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        Some(self.balanced(stage) == 1.0)
    }
}
