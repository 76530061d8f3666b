//! The 16 factors of PushT, and what an assignment means for physics and images.

use swm_fov::{Factor, Fov, FovSpace};

use super::engine::Engine;
use super::physics::{BodySetup, Setup, Shape};
use super::settings::Settings;

/// The factor table, in sampling order. Bounds and defaults are the reference's (August 2026; the default
/// block scale of January was 40, which its T ignored).
pub fn factors() -> FovSpace {
    let angle = std::f64::consts::TAU;
    FovSpace::new(vec![
        Factor::rgb("background.color", [255, 255, 255]).doc("color of the table").visual(),
        Factor::scalar("goal.angle", -angle, angle, std::f64::consts::FRAC_PI_4)
            .doc("angle of the rendered goal, rad; the rewarded goal is goal_state")
            .visual(),
        Factor::rgb("goal.color", [144, 238, 144]).doc("color of the rendered goal").visual(),
        Factor::vector("goal.position", 50.0, 450.0, &[256.0, 256.0])
            .doc("position of the rendered goal, px")
            .visual(),
        Factor::scalar_f32("goal.scale", 20.0, 60.0, 40.0)
            .doc("size of the rendered goal, px per cell; the block's size unless sampled or set")
            .visual(),
        Factor::scalar("block.angle", -angle, angle, 0.0)
            .doc("start angle of the block, rad")
            .sampled_by_default(),
        Factor::rgb("block.color", [119, 136, 153]).doc("color of the block").visual(),
        Factor::scalar_f32("block.scale", 20.0, 60.0, 30.0).doc("size of the block, px per cell"),
        Factor::integer("block.shape", 1, 7, 2)
            .choices(&["L", "T", "Z", "square", "I", "small T", "+"])
            .doc("1 L, 2 T, 3 Z, 4 square, 5 I, 6 small T, 7 +"),
        Factor::vector("block.start_position", 100.0, 400.0, &[400.0, 100.0])
            .doc("start position of the block's origin, px")
            .sampled_by_default(),
        Factor::scalar("agent.angle", -angle, angle, 0.0)
            .doc("start angle of the agent, rad; a disc has none")
            .shows_with("agent.shape", 1),
        Factor::rgb("agent.color", [65, 105, 225]).doc("color of the agent").visual(),
        Factor::scalar_f32("agent.scale", 20.0, 60.0, 40.0).doc("size of the agent, px per cell"),
        Factor::integer("agent.shape", 0, 7, 0)
            .choices(&["disc", "L", "T", "Z", "square", "I", "small T", "+"])
            .doc("0 disc (pushes with full strength), 1 to 7 as block.shape (pushed back)"),
        Factor::vector("agent.start_position", 50.0, 450.0, &[256.0, 400.0])
            .doc("start position of the agent, px")
            .sampled_by_default(),
        Factor::vector("agent.velocity", 0.0, 512.0, &[0.0, 0.0]).doc("start velocity of the agent, px/s"),
    ])
}

/// The physical world that an assignment describes.
pub(super) fn setup<E: Engine>(fov: &Fov, settings: &Settings) -> Setup {
    let shape = |name| {
        let index = usize::try_from(fov.i64(name)).ok().and_then(Shape::from_index);
        index.expect("the factor's bounds are the shapes")
    };
    Setup {
        agent: BodySetup {
            shape: shape("agent.shape"),
            scale: fov.f32("agent.scale"),
            position: fov.vector("agent.start_position"),
            angle: fov.f64("agent.angle"),
        },
        block: BodySetup {
            shape: shape("block.shape"),
            scale: fov.f32("block.scale"),
            position: fov.vector("block.start_position"),
            angle: fov.f64("block.angle"),
        },
        damping: settings.damping,
        block_cog: settings.block_cog,
        friction: settings.friction.unwrap_or(E::FRICTION),
    }
}
