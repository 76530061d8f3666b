//! Forces of the air: drag of the body, lift and drag of four surfaces. PyFlyt's models; the surfaces follow Khan and
//! Nahon, *Real-time modeling of agile fixed-wing UAV aerodynamics* (2015).
//!
//! Two of the four surfaces act at tank and booster and not at fins: PyFlyt numbers its links that way, and dynamics of
//! the reference follow it.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;

use super::body::{BOOSTER, FIN_PLACE};
use crate::attitude::{atan2, sin_cos};

/// Half of the density of air, kg/m³.
pub(super) const HALF_DENSITY: f64 = 0.6125;
/// Drag coefficient times area along each axis, m².
pub(super) const DRAG_AREA: [f64; 3] = [1.16 * 1.7649, 1.16 * 1.7649, 2.0 * 0.1075];
/// Area of a surface, m²; its chord, m.
const AREA: f64 = 0.25;
const CHORD: f64 = 0.5;
/// Slope of the lift coefficient: of a thin plate, corrected for the aspect ratio.
#[expect(clippy::approx_constant, reason = "PyFlyt rounds the slope of a thin plate")]
const LIFT_SLOPE: f64 = 6.283 / (1.0 + 10.0 / 3.0);
/// Share of the flap's angle that acts on the lift.
const FLAP_EFFECT: f64 = 0.65;
/// Greatest angle of a flap, degrees.
const FLAP_LIMIT_DEG: f64 = 45.0;
/// Angle of attack at which the flow stalls, degrees.
const STALL_DEG: f64 = 20.0;
/// Skin friction before and after the stall.
const FRICTION: [f64; 2] = [0.01, 0.005];

/// A surface: where it acts in the body frame and which way its lift points. Forward is towards the ground.
struct Surface {
    place: [f64; 3],
    lift: [f64; 3],
}

const SURFACES: [Surface; 4] = [
    Surface { place: [0.0; 3], lift: [0.0, 1.0, 0.0] },
    Surface { place: BOOSTER, lift: [0.0, 1.0, 0.0] },
    Surface { place: [FIN_PLACE[0], 0.0, FIN_PLACE[1]], lift: [1.0, 0.0, 0.0] },
    Surface { place: [-FIN_PLACE[0], 0.0, FIN_PLACE[1]], lift: [1.0, 0.0, 0.0] },
];

/// Force and torque about the origin, in the body frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Load {
    pub(super) force: Vector3<f64>,
    pub(super) torque: Vector3<f64>,
}

/// Adds to `load`, which PyBullet rotates by `lag` first, the forces of the air. `air_velocity` gives the velocity of a
/// point of the body in the air, in the lagging frame.
pub(super) fn add_air_forces(
    load: &mut Load,
    fins: &[f64; 4],
    lag: &nalgebra::Matrix3<f64>,
    air_velocity: impl Fn(Vector3<f64>) -> Vector3<f64>,
) {
    let u = air_velocity(Vector3::zeros());
    let drag = |axis: usize| -u[axis].signum() * HALF_DENSITY * DRAG_AREA[axis] * u[axis] * u[axis];
    load.force += lag * Vector3::new(drag(0), drag(1), drag(2));
    for (surface, &fin) in SURFACES.iter().zip(fins) {
        let place = Vector3::from(surface.place);
        let (force, torque) = surface_load(air_velocity(place), surface.lift.into(), fin);
        let force = lag * force;
        load.force += force;
        load.torque += place.cross(&force) + lag * torque;
    }
}

/// Force and torque of a surface whose flap is deflected by the share `fin` of its limit.
fn surface_load(u: Vector3<f64>, lift: Vector3<f64>, fin: f64) -> (Vector3<f64>, Vector3<f64>) {
    let forward = -Vector3::z();
    let attack = atan2(-u.dot(&lift), u.dot(&forward));
    let pressure = HALF_DENSITY * u.norm_squared() * AREA;
    let [cl, cd, cm] = coefficients(attack, (FLAP_LIMIT_DEG * fin).to_radians());
    let (sin, cos) = sin_cos(attack);
    let force = pressure * ((cl * cos + cd * sin) * lift + (cl * sin - cd * cos) * forward);
    (force, pressure * cm * CHORD * lift.cross(&forward))
}

/// Coefficients of lift, drag and moment at an angle of attack, the flap deflected by `flap`, radians.
fn coefficients(attack: f64, flap: f64) -> [f64; 3] {
    let k = LIFT_SLOPE;
    let by_flap = FLAP_EFFECT * k * flap;
    let zero = -by_flap / k;
    let stall = [-1.0, 1.0].map(|side| zero + (side * k * STALL_DEG.to_radians() + by_flap) / k);
    if stall[0] < attack && attack < stall[1] {
        let cl = k * (attack - zero);
        let induced = cl / PI;
        let effective = attack - zero - induced;
        let (sin, cos) = sin_cos(effective);
        let ct = FRICTION[0] * cos;
        let cn = (cl + ct * sin) / cos;
        return [cl, cn * sin + ct * cos, -cn * (0.25 - 0.175 * (1.0 - 2.0 * effective / PI))];
    }
    // From the value at the stall to 0 at a right angle.
    let edge = if attack > 0.0 { 1 } else { 0 };
    let (at_stall, right) = (k * (stall[edge] - zero) / PI, [-FRAC_PI_2, FRAC_PI_2][edge]);
    let share = ((attack - stall[edge]) / (right - stall[edge])).clamp(0.0, 1.0);
    let effective = attack - zero - at_stall * (1.0 - share);
    let (sin, cos) = sin_cos(effective);
    let at_right_angle = -0.0426 * flap * flap + 0.21 * flap + 1.98;
    let cn = at_right_angle * sin * (1.0 / (0.56 + 0.44 * sin.abs()) - 0.41 * (1.0 - EXP_MINUS_17));
    let ct = FRICTION[1] * cos;
    [cn * cos - ct * sin, cn * sin + ct * cos, -cn * (0.25 - 0.175 * (1.0 - 2.0 * effective.abs() / PI))]
}

/// e to the power -17: 17 over the aspect ratio, which is 1.
const EXP_MINUS_17: f64 = 4.139_937_718_785_167e-8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_undeflected_surface_in_straight_flow_only_drags() {
        let (force, torque) = surface_load(Vector3::new(0.0, 0.0, -30.0), Vector3::y(), 0.0);
        assert!(force.z > 0.0 && force.y.abs() < 1e-9 && torque.norm() < 1e-9, "{force} {torque}");
        let (deflected, _) = surface_load(Vector3::new(0.0, 0.0, -30.0), Vector3::y(), 0.3);
        assert!(deflected.y > 20.0, "a positive flap lifts: {deflected}");
    }

    #[test]
    fn lift_is_odd_in_the_angle_of_attack() {
        for attack in [0.1, 0.3, 0.5, 1.0, 1.5] {
            let [[cl, cd, cm], [cl2, cd2, cm2]] = [attack, -attack].map(|attack| coefficients(attack, 0.0));
            assert!((cl + cl2).abs() < 1e-12 && (cd - cd2).abs() < 1e-12, "{attack}: {cl} {cl2} {cd} {cd2}");
            assert!(cd > 0.0 && cm.is_finite() && cm2.is_finite());
        }
    }
}
