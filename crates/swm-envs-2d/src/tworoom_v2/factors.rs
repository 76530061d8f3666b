//! The 18 factors of TwoRoom and the two constraints between them. What they mean for the rooms is in `room.rs`, for
//! images in `rendering.rs`.

use swm_fov::{Constraint, Factor, FovSpace};

use super::room::{IMAGE_PX, Room};

/// A door lets an agent through, for the constraint and for the reference's expert, if its half extent is at least
/// this multiple of the agent's radius.
const DOOR_FIT: f64 = 1.1;

/// The factor table, in sampling order. Bounds, defaults and constraints are the reference's (August 2026).
pub fn factors() -> FovSpace {
    let last_px = (IMAGE_PX - 1) as i64;
    let position = |name: &str, default: [f32; 2]| Factor::vector_f32(name, 14.0, 209.0, &default);
    FovSpace::new(vec![
        Factor::rgb("background.color", [255, 255, 255]).doc("color of the floor").visual(),
        Factor::rgb("wall.color", [0, 0, 0]).doc("color of the walls").visual(),
        Factor::rgb("wall.border_color", [0, 0, 0])
            .doc("color of the border lines; the wall's color unless sampled or set")
            .visual(),
        Factor::integer("wall.thickness", 7, 41, 10).doc("the wall is 2 floor(thickness / 2) + 1 px wide"),
        // Where the agent starts by default, a horizontal wall would stand.
        Factor::integer("wall.axis", 0, 1, 1)
            .choices(&["horizontal", "vertical"])
            .doc("0: the wall is horizontal, 1: vertical")
            .shows_with("agent.position", vec![60.0, 60.0]),
        Factor::rgb("agent.color", [255, 0, 0]).doc("color of the agent").visual(),
        Factor::scalar_f32("agent.radius", 7.0, 14.0, 7.0)
            .doc("px that the agent keeps from walls, and the spread of its dot"),
        position("agent.position", [60.0, 112.0]).doc("start of the agent, px").sampled_by_default(),
        Factor::scalar_f32("agent.speed", 1.75, 10.5, 5.0).doc("px per step and axis at full action"),
        Factor::rgb("door.color", [255, 255, 255]).doc("color of the doors").visual(),
        Factor::integer("door.number", 1, 3, 1).doc("how many of the three doors exist"),
        Factor::integers("door.size", 1, 21, &[14; 3]).doc("half extents of the doors, px"),
        Factor::integers("door.position", 0, last_px, &[49; 3])
            .doc("centers of the doors along the wall, px; may lie outside of the rooms"),
        Factor::integer("task.min_steps", 15, 114, 25).doc(
            "if sampled or set, and the target is not set: the target is at least so many steps away, or as far as \
             the rooms allow",
        ),
        Factor::rgb("target.color", [0, 255, 0])
            .doc("color of the target")
            .visual()
            .shows_with("rendering.render_target", 1),
        Factor::scalar_f32("target.radius", 7.0, 14.0, 7.0)
            .doc("spread of the target's dot, px")
            .visual()
            .shows_with("rendering.render_target", 1),
        position("target.position", [164.0, 112.0])
            .doc("target, px; may lie in the same room, or in the wall")
            .sampled_by_default(),
        Factor::integer("rendering.render_target", 0, 1, 0).doc("1: the target is rendered").visual(),
    ])
    .with_constraints(vec![
        Constraint {
            owner: "agent.position",
            reads: &["wall.thickness", "wall.axis", "agent.radius"],
            words: "clear of the wall (doors do not count)",
            holds: |fov| {
                let room = Room::new(fov);
                let [low, high] = room.wall();
                let across = f64::from(room.across(fov.vector::<f32, 2>("agent.position")));
                across < low || across > high
            },
        },
        Constraint {
            owner: "door.size",
            reads: &["agent.radius", "door.number"],
            words: "at least 1.1 times agent.radius for one of the first door.number doors",
            holds: |fov| {
                let least = DOOR_FIT * f64::from(fov.f32("agent.radius"));
                Room::new(fov).doors().iter().any(|door| door.half_extent >= least)
            },
        },
    ])
}
