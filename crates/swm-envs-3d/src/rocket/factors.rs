//! The factors of rocket landing, and what an assignment means.

use swm_fov::{Factor, Fov, FovSpace};

use super::body::{DRY_MASS, Kind};
use super::flight::Conditions;

/// The factor table, in sampling order: the reference's, then fuel, dry mass and wind.
pub(super) fn factors() -> FovSpace {
    FovSpace::new(vec![
        Factor::rgb("environment.sky_color", [255, 255, 255])
            .doc("color of the sky; the reference lists (135, 206, 235) and renders white"),
        Factor::scalar("environment.start_height_ratio", 0.7, 0.95, 0.9)
            .doc("start height as a share of 500 m"),
        Factor::vector_f32("environment.start_horizontal_offset", -2.0, 2.0, &[0.0, 0.0])
            .doc("start x, y from the axis of the pad, m")
            .sampled_by_default(),
        Factor::vector_f32("environment.start_tilt", -f64::from(0.2_f32), f64::from(0.2_f32), &[0.0, 0.0])
            .doc("start roll and pitch, rad")
            .sampled_by_default(),
        Factor::rgb("rocket.body_color", [255, 204, 0]).doc("color of the hull"),
        Factor::rgb("rocket.booster_color", [51, 51, 51]).doc("color of the booster"),
        Factor::rgb("rocket.fin_color", [51, 51, 51]).doc("color of the fins"),
        Factor::rgb("rocket.leg_color", [0, 0, 0]).doc("color of the legs"),
        Factor::rgb("pad.color", [200, 200, 200]).doc("color of the pad"),
        Factor::scalar("rocket.fuel", 0.02, 1.0, 0.05).doc("share of a full tank (410.9 kg) at the start"),
        Factor::scalar("rocket.dry_mass", 100.0, 200.0, DRY_MASS)
            .doc("mass without fuel, kg; inertia scales with it"),
        Factor::vector("environment.wind", -8.0, 8.0, &[0.0, 0.0])
            .doc("velocity of the air along x and y, m/s"),
    ])
}

/// The conditions of an assignment.
pub(super) fn conditions(fov: &Fov) -> Conditions {
    Conditions { dry_mass: fov.f64("rocket.dry_mass"), wind: fov.vector("environment.wind") }
}

/// The color of the parts of a kind.
pub(super) fn color(fov: &Fov, kind: Kind) -> [u8; 3] {
    fov.rgb(match kind {
        Kind::Hull => "rocket.body_color",
        Kind::Fin => "rocket.fin_color",
        Kind::Leg => "rocket.leg_color",
        Kind::Booster => "rocket.booster_color",
    })
}
