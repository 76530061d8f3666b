//! What the rocket is made of: masses, inertia and shapes. PyFlyt's `rocket.urdf` and `rocket.yaml`, as constants.
//!
//! The body frame has its origin at the center of the hull and z towards the nose. Lengths in m, masses in kg.

use nalgebra::Vector3;

/// Mass without fuel, kg.
pub(super) const DRY_MASS: f64 = 138.2;
/// Mass of a full tank, kg.
pub(super) const TANK_MASS: f64 = 410.9;
/// The engine, in the body frame.
pub(super) const BOOSTER: [f64; 3] = [0.0, 0.0, -2.0];
/// Height of the origin over the ground when the rocket stands on the pad.
pub(super) const STANDING_HEIGHT: f64 = 2.575;
/// No part is farther than this from the origin.
pub(super) const RADIUS: f64 = 2.55;

/// Mass of the hull, and its moments of inertia.
const HULL: (f64, [f64; 3]) = (91.0, [372.6, 372.6, 1.55]);
const BOOSTER_BODY: (f64, [f64; 3]) = (47.0, [192.43, 192.43, 0.81]);
/// Moments of inertia of a full tank, which is at the origin.
const TANK_INERTIA: [f64; 3] = [1678.0, 1678.0, 7.01];
const FIN_MASS: f64 = 0.05;
/// Distance of fins from the axis, and their height.
pub(super) const FIN_PLACE: [f64; 2] = [0.35, 2.051];

/// Mass properties of the whole, symmetric about z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MassProperties {
    pub(super) mass: f64,
    /// Height of the center of mass in the body frame.
    pub(super) center_z: f64,
    /// Moments of inertia about the center of mass.
    pub(super) inertia: [f64; 3],
}

impl MassProperties {
    /// Of a rocket whose dry parts have the mass `dry_mass` in all, with this share of a full tank.
    pub(super) fn new(dry_mass: f64, fuel: f64) -> Self {
        let scale = dry_mass / DRY_MASS;
        let (hull, booster, fin) = (HULL.0 * scale, BOOSTER_BODY.0 * scale, FIN_MASS * scale);
        let tank = TANK_MASS * fuel;
        let mass = hull + tank + booster + 4.0 * fin;
        let center_z = (booster * BOOSTER[2] + 4.0 * fin * FIN_PLACE[1]) / mass;
        let at = |z: f64| (z - center_z) * (z - center_z);
        // Parallel axes: the shift across z, and along it.
        let across = (hull + tank) * at(0.0)
            + booster * at(BOOSTER[2])
            + fin * (4.0 * at(FIN_PLACE[1]) + 2.0 * FIN_PLACE[0] * FIN_PLACE[0]);
        let along = 4.0 * fin * FIN_PLACE[0] * FIN_PLACE[0];
        let own =
            [0, 1, 2].map(|axis| scale * (HULL.1[axis] + BOOSTER_BODY.1[axis]) + fuel * TANK_INERTIA[axis]);
        Self { mass, center_z, inertia: [own[0] + across, own[1] + across, own[2] + along] }
    }

    /// The center of mass in the body frame.
    pub(super) fn center(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, self.center_z)
    }
}

/// One part of the rocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) kind: Kind,
    pub(super) solid: Solid,
    /// Its center in the body frame.
    pub(super) place: [f64; 3],
    /// Rotation about z, radians.
    pub(super) turn_rad: f64,
}

/// What a part is: parts of one kind have one color.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Hull,
    Fin,
    Leg,
    Booster,
}

/// The shape of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Solid {
    /// A cylinder along z.
    Cylinder { radius: f64, half: f64 },
    /// A box.
    Box { half: [f64; 3] },
}

const HULL_SOLID: Solid = Solid::Cylinder { radius: 0.185, half: 2.385 };
const BOOSTER_SOLID: Solid = Solid::Cylinder { radius: 0.25, half: 0.25 };
/// Fins on the x axis; those on the y axis are turned by a quarter.
const FIN_SOLIDS: [Solid; 2] =
    [Solid::Box { half: [0.15, 0.015, 0.15] }, Solid::Box { half: [0.015, 0.15, 0.15] }];
const LEG_SOLID: Solid = Solid::Box { half: [0.025, 0.25, 0.025] };
/// A third of a turn, as the URDF has it, twice.
const LEG_TURN_RAD: f64 = 4.188;

const fn part(kind: Kind, solid: Solid, place: [f64; 3], turn_rad: f64) -> Part {
    Part { kind, solid, place, turn_rad }
}

/// The parts that touch and are seen. The tank is inside of the hull.
pub(super) const PARTS: [Part; 9] = [
    part(Kind::Hull, HULL_SOLID, [0.0; 3], 0.0),
    part(Kind::Booster, BOOSTER_SOLID, BOOSTER, 0.0),
    part(Kind::Fin, FIN_SOLIDS[0], [FIN_PLACE[0], 0.0, FIN_PLACE[1]], 0.0),
    part(Kind::Fin, FIN_SOLIDS[0], [-FIN_PLACE[0], 0.0, FIN_PLACE[1]], 0.0),
    part(Kind::Fin, FIN_SOLIDS[1], [0.0, FIN_PLACE[0], FIN_PLACE[1]], 0.0),
    part(Kind::Fin, FIN_SOLIDS[1], [0.0, -FIN_PLACE[0], FIN_PLACE[1]], 0.0),
    part(Kind::Leg, LEG_SOLID, [0.0, 0.35, -2.4], 0.0),
    part(Kind::Leg, LEG_SOLID, [0.3031, -0.175, -2.4], LEG_TURN_RAD),
    part(Kind::Leg, LEG_SOLID, [-0.3031, -0.175, -2.4], -LEG_TURN_RAD),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mass_is_that_of_the_reference_at_the_start() {
        let properties = MassProperties::new(DRY_MASS, 0.05);
        assert!((properties.mass - 158.745).abs() < 1e-9, "{properties:?}");
        assert!((properties.center_z + 0.5896).abs() < 1e-4, "{properties:?}");
    }

    #[test]
    fn no_part_reaches_beyond_the_radius() {
        for Part { solid, place: [x, y, z], .. } in PARTS {
            let (across, along) = match solid {
                Solid::Cylinder { radius, half } => (radius, half),
                Solid::Box { half: [a, b, c] } => (a.hypot(b), c),
            };
            assert!((x.hypot(y) + across).hypot(z.abs() + along) < RADIUS, "{solid:?}");
        }
    }
}
