//! The 17 factors of TwoRoom, their constraints, and what an assignment means for physics.

use serde_json::json;
use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::physics::{Axis, FloorPlan, INNER_PX, Setup, Vec2, WALL_AT_PX};
use super::settings::Settings;

/// Places where agent and goal may be, pixels.
const PLACES_PX: (f64, f64) = (9.0, 503.0);
/// A door fits an agent if it is this many times as long as the agent's radius.
const DOOR_PER_RADIUS: f64 = 2.5;

/// The factor table, in the reference's sampling order. Bounds, defaults and constraints are the reference's.
pub fn factors() -> FovSpace {
    let place =
        |name, at: [f32; 2]| Factor::vector_f32(name, PLACES_PX.0, PLACES_PX.1, &at).sampled_by_default();
    let number = |name, low, high, default| Factor::vector_f32(name, low, high, &[default]);
    let integers =
        |name, low, high, default| Factor::integers(name, low, high, &[default; 3]).sampled_by_default();
    FovSpace::new(vec![
        Factor::rgb("background.color", [255, 255, 255]).doc("color of the floor").visual(),
        Factor::rgb("wall.color", [115, 127, 145]).doc("color of the dividing wall").visual(),
        Factor::rgb("wall.border_color", [180, 189, 204]).doc("color of the borders").visual(),
        Factor::integer("wall.thickness", 9, 33, 19).doc("twice what the dividing wall is thick, px"),
        Factor::integer("wall.axis", 0, 1, 1)
            .choices(&["horizontal", "vertical"])
            .doc("0 horizontal, 1 vertical wall"),
        Factor::rgb("agent.color", [255, 0, 0]).doc("color of the agent").visual(),
        number("agent.radius", 15.0, 30.0, 15.0).doc("radius of the agent, px"),
        place("agent.position", [50.0, 50.0]).doc("start of the agent, px"),
        Factor::integer("agent.max_energy", 50, 199, 100).doc("actions after which the episode is cut off"),
        number("agent.speed", 10.0, 20.0, 10.0).doc("px per step and unit of action"),
        Factor::rgb("door.color", [255, 255, 255]).doc("color of the doors").visual(),
        Factor::integer("door.number", 1, 3, 1)
            .doc("how many of the three doors exist; those in one place are one")
            .shows_with("door.position", json!([100, 247, 400])),
        integers("door.size", 10, 99, 75).doc("lengths of the doors, px"),
        integers("door.position", 0, INNER_PX - 1, 247).doc("starts of the doors along the wall, px"),
        Factor::rgb("goal.color", [0, 255, 0]).doc("color of the goal").visual(),
        number("goal.radius", 15.0, 30.0, 15.0).doc("radius of the goal, px"),
        place("goal.position", [450.0, 450.0]).doc("the goal, px"),
    ])
    .with_constraints(vec![
        Constraint {
            owner: "agent.position",
            reads: &["agent.radius", "wall.axis", "wall.thickness"],
            words: "clear of wall and borders",
            holds: |fov| is_clear(fov, position(fov, "agent"), agent_radius(fov)),
        },
        Constraint {
            owner: "door.size",
            reads: &["agent.radius", "door.number"],
            words: "at least 2.5 times agent.radius in one of the first door.number entries",
            holds: |fov| a_door_fits(fov),
        },
        Constraint {
            owner: "goal.position",
            reads: &["goal.radius", "wall.axis", "wall.thickness"],
            words: "clear of wall and borders",
            holds: |fov| is_clear(fov, position(fov, "goal"), goal_radius(fov)),
        },
        Constraint {
            owner: "goal.position",
            reads: &["agent.position", "wall.axis"],
            words: "on the other side of the wall than agent.position",
            holds: |fov| {
                let across = |who| axis(fov).split(position(fov, who)).0 - WALL_AT_PX;
                across("agent") * across("goal") < 0.0
            },
        },
    ])
}

/// The reference's test: the wall's factor counts in full to either side, and the right and lower limit lacks the
/// border. Both leave more room than physics needs.
fn is_clear(fov: &Fov, at: Vec2, radius: f64) -> bool {
    let inside = |x: f64| x - radius > 9.0 && x + radius < INNER_PX as f64;
    let from_wall = (axis(fov).split(at).0 - WALL_AT_PX).abs();
    inside(at.x) && inside(at.y) && from_wall > fov.i64("wall.thickness") as f64 / 2.0 + radius
}

fn a_door_fits(fov: &Fov) -> bool {
    let needed = DOOR_PER_RADIUS * agent_radius(fov);
    doors(fov).iter().any(|&(_, length)| length as f64 >= needed)
}

/// The doors that exist, as `(start, length)` along the wall, pixels.
pub(super) fn doors(fov: &Fov) -> Vec<(i64, i64)> {
    let (starts, lengths): ([i64; 3], [i64; 3]) = (fov.vector("door.position"), fov.vector("door.size"));
    let number = usize::try_from(fov.i64("door.number")).unwrap_or(0);
    starts.into_iter().zip(lengths).take(number).collect()
}

/// The orientation of the wall.
pub(super) fn axis(fov: &Fov) -> Axis {
    if fov.i64("wall.axis") == 0 { Axis::Horizontal } else { Axis::Vertical }
}

/// Where `agent` starts or `goal` is, pixels.
pub(super) fn position(fov: &Fov, who: &str) -> Vec2 {
    let place: [f32; 2] = fov.vector(&format!("{who}.position"));
    Vec2::from(place.map(f64::from))
}

/// The radius of the agent, pixels.
pub(super) fn agent_radius(fov: &Fov) -> f64 {
    f64::from(fov.f32("agent.radius"))
}

/// The radius of the goal, pixels.
pub(super) fn goal_radius(fov: &Fov) -> f64 {
    f64::from(fov.f32("goal.radius"))
}

/// The physical world that an assignment describes.
pub(super) fn setup(fov: &Fov, settings: &Settings) -> Setup {
    Setup {
        plan: FloorPlan::new(axis(fov), fov.i64("wall.thickness"), &doors(fov)),
        radius: agent_radius(fov),
        speed: fov.f32("agent.speed"),
        solid: settings.solid_walls,
    }
}
