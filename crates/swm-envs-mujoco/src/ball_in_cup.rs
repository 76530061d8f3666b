//! `swm/BallInCupDMControl-v0`: catch a ball on a string with a cup. Source: `dm_control`'s `suite/ball_in_cup.py` and
//! `ball_in_cup.xml`.

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::learned::learned_expert;
use crate::suite::{
    Control, Domain, Effect, START_COLUMNS, Stage, Task, TaskEntry, distance, entry, factors, listed, make,
    planner, unchanged, uniform, until_free_of_contacts,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape};

/// The table entry.
pub const BALL_IN_CUP: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/BallInCupDMControl-v0",
    summary: "catch a ball on a string with a cup; two forces",
    success: "the whole ball in the cup's opening",
    model: "ball_in_cup.xml",
    substeps: 10,
    time_limit_s: 20.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=20,samples=32,iterations=2,elites=6,sigma=0.7,aggregate=mean"),
    policies: &[learned_expert!("ball_in_cup", TASKS, "catch")],
    infos: &[],
    targets: &[],
    start_columns: START_COLUMNS,
    compose: unchanged,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[TaskEntry::new("catch", "the whole ball in the cup", |model| {
    Ok(Box::new(Catch {
        target: model.id(Object::Site, "target")?,
        ball: model.id(Object::Body, "ball")?,
        ball_geom: model.id(Object::Geom, "ball")?,
    }))
})];

fn controls(stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.density",
            "density of the cup, kg/m³",
            Effect::Density(&["cup_part_0", "cup_part_1", "cup_part_2", "cup_part_3", "cup_part_4"]),
        ),
        factors::color(
            "ball.color",
            [0.7, 0.4, 0.2],
            "color of the ball",
            Effect::Model(|model, values| factors::set_geom_color(model, &["ball"], values)),
        ),
        factors::density("ball.density", "density of the ball, kg/m³", Effect::Density(&["ball"])),
        factors::scalar(
            "ball.size",
            [0.01, 0.05],
            0.025,
            "radius of the ball, m; near 0.05 it cannot be inside of the cup's opening",
            Effect::Spec(|spec, values| {
                spec.geom("ball")?.set_size([values[0], 0.0, 0.0]);
                Ok(())
            }),
        ),
        factors::floor_color(),
        factors::light_intensity("light", if stock { 0.6 } else { 0.7 }),
        factors::hidden_target_color(),
        factors::target_shape(
            "1: the target is as the model has it, not rendered; 0: a rendered box. The reward counts the same opening",
            Effect::Model(|model, values| {
                if values[0] == 0.0 {
                    let site = factors::show_site(model, "target")?;
                    model.set_site_shape(site, Shape::Box);
                }
                Ok(())
            }),
        ),
    ]
}

/// Tries of placing the ball where it touches nothing.
const TRIES: u32 = 10_000;

struct Catch {
    target: usize,
    ball: usize,
    ball_geom: usize,
}

impl Catch {
    fn is_caught(&self, stage: &Stage) -> bool {
        let (target, ball) = (stage.sim.site_xpos(self.target), stage.sim.xpos(self.ball));
        let model: &Model = stage.sim.model();
        let (size, radius) = (&model.site_size()[3 * self.target..], model.geom_size()[3 * self.ball_geom]);
        [0, 2].into_iter().all(|axis| (target[axis] - ball[axis]).abs() < size[axis] - radius)
    }
}

impl Task for Catch {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        until_free_of_contacts(stage, TRIES, |stage, _| {
            let (x, z) = (uniform(stream, -0.2, 0.2), uniform(stream, 0.2, 0.5));
            stage.sim.qpos_mut()[2..4].copy_from_slice(&[x, z]);
            Ok(())
        })
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.extend_from_slice(stage.sim.qpos());
        out.extend_from_slice(stage.sim.qvel());
    }

    fn reward(&self, stage: &Stage) -> f64 {
        if self.is_caught(stage) { 1.0 } else { 0.0 }
    }

    /// How far the ball is from the target, counted around the cup: a ball below the rim must come up and over first.
    fn cost(&self, stage: &Stage) -> Option<f64> {
        let (target, ball) = (stage.sim.site_xpos(self.target), stage.sim.xpos(self.ball));
        let above = [target[0], target[1], target[2] + 0.15];
        let direct = distance(target, ball);
        let is_beside = ball[2] < target[2] + 0.05 && !self.is_caught(stage);
        Some(if is_beside { distance(above, ball) + 0.15 } else { direct })
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        Some(self.is_caught(stage))
    }
}
