//! What AntSoccer adds to the ant's maze: the ball in the model, its factors, its place, and what planners minimize.

use super::factors::uniform;
use super::layout::{Leg, Maze, cell_at, distance};
use crate::suite::{Control, Effect};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape, Simulation, Spec};

/// Body, geom and material of the ball.
const BALL: &str = "ball";
/// Radius, m.
const RADIUS: f64 = 0.25;
/// The file's density, kg/m³: 0.33 kg.
const DENSITY: f64 = 5.0;
/// How far behind the ball, as seen from where it has to go, the ant is to stand, m.
const BEHIND: f64 = 0.6;
/// What a meter between the ant and that place costs; a meter of the ball's way costs 1.
const APPROACH: f64 = 0.3;

/// Adds the ball, as the reference does behind everything else.
pub(super) fn add_ball(spec: &mut Spec) -> Result<(), MujocoError> {
    spec.add_body("world", BALL, [0.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.0])?;
    spec.add_free_joint(BALL, "ball_root")?;
    spec.add_geom(BALL, BALL, (Shape::Sphere, [0.0; 3], [RADIUS, 0.0, 0.0]), BALL, true)?;
    spec.geom(BALL)?.set_priority(1).set_contact_dimensions(6);
    spec.add_following_light(BALL, "ball_light", [0.0, 0.0, 4.0])
}

/// Where the ball is: x, y, m. `qpos` `[nq]` ends with its free joint.
pub(super) fn ball_place(qpos: &[f64]) -> [f64; 2] {
    let first = qpos.len() - 7;
    [qpos[first], qpos[first + 1]]
}

/// Puts the ball somewhere else; its height and velocity stay.
pub(super) fn put_ball(sim: &mut Simulation, place: [f64; 2]) {
    let first = sim.model().nq() - 7;
    sim.qpos_mut()[first..first + 2].copy_from_slice(&place);
}

/// The factors of the ball.
pub(super) fn controls() -> Vec<Control> {
    let color = "color of the ball; its pattern is black and white times this";
    vec![
        Control {
            factor: uniform("ball.color", &[3], [0.0, 1.0], &[1.0; 3], color),
            effect: Effect::Material(BALL),
        },
        Control {
            factor: uniform(
                "ball.density",
                &[1],
                [1.0, 50.0],
                &[DENSITY],
                "density of the ball, kg/m³; 5 makes 0.33 kg",
            ),
            effect: Effect::Model(|model, density| set_density(model, density[0])),
        },
        Control {
            factor: uniform(
                "ball.friction",
                &[1],
                [0.2, 1.0],
                &[1.0],
                "sliding friction between the ball and everything else",
            ),
            effect: Effect::Model(|model, friction| {
                let ball = model.id(Object::Geom, BALL)?;
                model.geom_friction_mut()[3 * ball] = friction[0];
                Ok(())
            }),
        },
    ]
}

/// What a recompile with this density would give.
fn set_density(model: &mut Model, density: f64) -> Result<(), MujocoError> {
    if density == DENSITY {
        return Ok(());
    }
    let ball = model.id(Object::Body, BALL)?;
    let scale = density / DENSITY;
    model.body_mass_mut()[ball] *= scale;
    model.body_inertia_mut()[3 * ball..][..3].iter_mut().for_each(|inertia| *inertia *= scale);
    model.set_constants()
}

/// Where the ant is to stand to push the ball on to `aim`: x, y, m.
fn place_behind(ball: [f64; 2], aim: [f64; 2], distance_m: f64) -> [f64; 2] {
    let length = distance(ball, aim).max(f64::MIN_POSITIVE);
    [0, 1].map(|k| ball[k] - distance_m * (aim[k] - ball[k]) / length)
}

/// The ball's way to the goal over the middles of cells, and a part of the ant's way to behind the ball, m.
pub(super) fn cost(maze: Maze, ways: &[Option<u32>], [ant, ball, goal]: [[f64; 2]; 3]) -> f64 {
    let Some(Leg { to, .. }) = maze.leg(ways, ball, goal) else { return f64::INFINITY };
    let behind = place_behind(ball, to, BEHIND);
    let to_ball = if cell_at(ant) == cell_at(ball) {
        distance(ant, behind)
    } else {
        maze.way_left(&maze.ways(cell_at(ball)), ant, behind)
    };
    maze.way_left(ways, ball, goal) + APPROACH * to_ball
}

#[cfg(test)]
mod tests {
    use super::*;
    use swm_mujoco::assets::maze_model;

    fn with_ball(density: f64) -> Model {
        let mut spec = Spec::read(&maze_model("ant.xml").unwrap()).unwrap();
        add_ball(&mut spec).unwrap();
        spec.geom(BALL).unwrap().set_density(density);
        spec.compile().unwrap()
    }

    #[test]
    fn another_density_is_that_of_a_recompile() {
        let mut edited = with_ball(DENSITY);
        set_density(&mut edited, 20.0).unwrap();
        let compiled = with_ball(20.0);
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-14 * b.abs());
        assert!(near(edited.body_mass(), compiled.body_mass()));
        assert!(near(edited.body_inertia(), compiled.body_inertia()));
        let fall = |model: Model| {
            let mut sim = Simulation::new(std::sync::Arc::new(model)).unwrap();
            sim.forward().unwrap();
            (0..20).for_each(|_| sim.control_step(5).unwrap());
            sim.qpos().to_vec()
        };
        let (edited, compiled) = (fall(edited), fall(compiled));
        assert!(edited.iter().zip(&compiled).all(|(a, b)| (a - b).abs() < 1e-9), "{edited:?} {compiled:?}");
        assert_ne!(edited, fall(with_ball(DENSITY)));
    }

    #[test]
    fn the_ant_is_to_be_behind_the_ball() {
        let (ball, goal) = ([4.0, 4.0], [12.0, 4.0]);
        let ways = Maze::Arena.ways(cell_at(goal));
        let cost = |ant| cost(Maze::Arena, &ways, [ant, ball, goal]);
        assert!(cost([3.4, 4.0]) < cost([4.6, 4.0]));
        assert!((cost([3.4, 4.0]) - 8.0).abs() < 1e-9, "{}", cost([3.4, 4.0]));
        assert!(cost([20.0, 20.0]) > cost([8.0, 8.0]));
        assert_eq!(place_behind(ball, goal, 0.5), [3.5, 4.0]);
    }
}
