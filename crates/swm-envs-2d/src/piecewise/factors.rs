//! The factors of Piecewise. Bounds and defaults are the reference's (August 2026); their number follows the zones.

use std::f64::consts::TAU;

use swm_fov::{Factor, FovSpace};
use swm_render::Rgb;

use super::zones::SIDE_PX;
use crate::tworoom_v2::room::BORDER_PX;

/// Saturation of the zones' default colors.
const SATURATION: f64 = 0.25;
/// Length of the zones' default pushes, px per step.
const BIAS: f64 = 2.0;

/// The factor that pushes an agent in a zone.
pub(super) fn bias_name(zone: usize) -> String {
    format!("zones.bias_{zone}")
}

/// The factor that colors a zone.
pub(super) fn color_name(zone: usize) -> String {
    format!("zones.color_{zone}")
}

/// The factor table of `grid_n` × `grid_n` zones, in sampling order.
pub(super) fn factors(grid_n: usize) -> FovSpace {
    let position = |name: &str, default: [f32; 2]| Factor::vector_f32(name, 14.0, 209.0, &default);
    let mut factors = vec![
        Factor::rgb("background.color", [255, 255, 255]).doc("color of the floor"),
        Factor::rgb("border.color", [0, 0, 0]).doc("color of the border lines"),
        Factor::rgb("agent.color", [255, 0, 0]).doc("color of the agent"),
        Factor::scalar_f32("agent.radius", 7.0, 14.0, 7.0)
            .doc("px that the agent keeps from the border, and the spread of its dot"),
        position("agent.position", [60.0, 112.0]).doc("start of the agent, px").sampled_by_default(),
        Factor::scalar_f32("agent.speed", 1.75, 10.5, 5.0).doc("px per step and axis at full action"),
        Factor::integer("task.min_steps", 15, 114, 25).doc(
            "if sampled or set, and the target is not set: the target is at least so many steps away, or as far as \
             the room allows",
        ),
        Factor::rgb("target.color", [0, 255, 0])
            .doc("color of the target")
            .shows_with("rendering.render_target", 1),
        Factor::scalar_f32("target.radius", 7.0, 14.0, 7.0)
            .doc("spread of the target's dot, px")
            .shows_with("rendering.render_target", 1),
        position("target.position", [164.0, 112.0]).doc("target, px").sampled_by_default(),
        Factor::integer("rendering.render_target", 0, 1, 0).doc("1: the target is rendered"),
        Factor::integer("rendering.render_zones", 0, 1, 0).doc("1: the zones are rendered in their colors"),
        Factor::integer("rendering.render_bias_field", 0, 1, 0)
            .doc("1: an arrow in each zone shows where it pushes"),
    ];
    let zones = grid_n * grid_n;
    let share = |zone: usize| zone as f64 / zones as f64;
    factors.extend((0..zones).map(|zone| {
        let angle = TAU * share(zone);
        let default = [BIAS * angle.cos(), BIAS * angle.sin()].map(|value| value as f32);
        let doc = format!("push of zone {zone} along x and y, px per step");
        // Seen for sure by an agent that starts in the zone.
        Factor::vector_f32(&bias_name(zone), -4.0, 4.0, &default)
            .doc(&doc)
            .shows_with("agent.position", middle(zone, grid_n).to_vec())
    }));
    factors.extend((0..zones).map(|zone| {
        let doc = format!("color of zone {zone}");
        Factor::rgb(&color_name(zone), pastel(share(zone))).doc(&doc).shows_with("rendering.render_zones", 1)
    }));
    FovSpace::new(factors)
}

/// The middle of a zone, `[x, y]` in px.
fn middle(zone: usize, grid_n: usize) -> [f64; 2] {
    let side = f64::from(SIDE_PX) / grid_n as f64;
    [zone % grid_n, zone / grid_n].map(|cell| BORDER_PX + (cell as f64 + 0.5) * side)
}

/// A color of this hue, 0..1, of full value and low saturation.
fn pastel(hue: f64) -> Rgb {
    let sector = (6.0 * hue).floor();
    let part = 6.0 * hue - sector;
    let (low, falling) = (1.0 - SATURATION, 1.0 - SATURATION * part);
    let rising = 1.0 - SATURATION * (1.0 - part);
    let color = match sector as u32 % 6 {
        0 => [1.0, rising, low],
        1 => [falling, 1.0, low],
        2 => [low, 1.0, rising],
        3 => [low, falling, 1.0],
        4 => [rising, low, 1.0],
        _ => [1.0, low, falling],
    };
    color.map(|channel| (255.0 * channel) as u8)
}
