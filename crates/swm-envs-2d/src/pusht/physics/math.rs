//! Plane geometry in `f64`: vectors, rotations, bounding boxes and the sine.
//!
//! Everything here is plain IEEE arithmetic, the sine included, so that a trajectory has the same bits on every
//! machine. (A platform's own `sin` may pick fused instructions where the CPU has them.)

use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_2_PI, TAU};
use std::ops::{Add, Mul, Neg, Sub};

/// A vector in the plane: x to the right, y down, in pixels unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Vec2 {
    pub(crate) x: f64,
    pub(crate) y: f64,
}

/// Short for [`Vec2`] from its two components.
pub(crate) const fn vec2(x: f64, y: f64) -> Vec2 {
    Vec2 { x, y }
}

impl Vec2 {
    pub(crate) const ZERO: Vec2 = vec2(0.0, 0.0);

    pub(crate) fn dot(self, other: Vec2) -> f64 {
        self.x * other.x + self.y * other.y
    }

    /// The z component of the cross product.
    pub(crate) fn cross(self, other: Vec2) -> f64 {
        self.x * other.y - self.y * other.x
    }

    pub(crate) fn norm(self) -> f64 {
        self.dot(self).sqrt()
    }

    pub(crate) fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite()
    }

    pub(crate) fn to_array(self) -> [f64; 2] {
        [self.x, self.y]
    }
}

impl From<[f64; 2]> for Vec2 {
    fn from([x, y]: [f64; 2]) -> Vec2 {
        vec2(x, y)
    }
}

impl Add for Vec2 {
    type Output = Vec2;
    fn add(self, other: Vec2) -> Vec2 {
        vec2(self.x + other.x, self.y + other.y)
    }
}

impl Sub for Vec2 {
    type Output = Vec2;
    fn sub(self, other: Vec2) -> Vec2 {
        vec2(self.x - other.x, self.y - other.y)
    }
}

impl Neg for Vec2 {
    type Output = Vec2;
    fn neg(self) -> Vec2 {
        vec2(-self.x, -self.y)
    }
}

impl Mul<f64> for Vec2 {
    type Output = Vec2;
    fn mul(self, factor: f64) -> Vec2 {
        vec2(self.x * factor, self.y * factor)
    }
}

/// A rotation by an angle; turns body coordinates into world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rotation {
    pub(crate) cos: f64,
    pub(crate) sin: f64,
}

impl Rotation {
    pub(crate) fn new(angle_rad: f64) -> Rotation {
        let (sin, cos) = sin_cos(angle_rad);
        Rotation { cos, sin }
    }

    pub(crate) fn world_from_body(self, q: Vec2) -> Vec2 {
        vec2(self.cos * q.x - self.sin * q.y, self.sin * q.x + self.cos * q.y)
    }

    pub(crate) fn body_from_world(self, q: Vec2) -> Vec2 {
        vec2(self.cos * q.x + self.sin * q.y, self.cos * q.y - self.sin * q.x)
    }
}

/// A box with sides along the axes; its border belongs to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Aabb {
    pub(crate) min: Vec2,
    pub(crate) max: Vec2,
}

impl Aabb {
    /// The box around `center` that reaches `half` to each side.
    pub(crate) fn around(center: Vec2, half: Vec2) -> Aabb {
        Aabb { min: center - half, max: center + half }
    }

    /// True if the boxes share a point. A box with a NaN shares none.
    pub(crate) fn intersects(&self, other: &Aabb) -> bool {
        (self.min.x <= other.max.x)
            & (other.min.x <= self.max.x)
            & (self.min.y <= other.max.y)
            & (other.min.y <= self.max.y)
    }

    pub(crate) fn contains(&self, other: &Aabb) -> bool {
        (self.min.x <= other.min.x)
            & (other.max.x <= self.max.x)
            & (self.min.y <= other.min.y)
            & (other.max.y <= self.max.y)
    }

    pub(crate) fn union(&self, other: &Aabb) -> Aabb {
        Aabb {
            min: vec2(self.min.x.min(other.min.x), self.min.y.min(other.min.y)),
            max: vec2(self.max.x.max(other.max.x), self.max.y.max(other.max.y)),
        }
    }

    pub(crate) fn area(&self) -> f64 {
        (self.max.x - self.min.x) * (self.max.y - self.min.y)
    }

    /// How far apart the centers of two boxes are: twice the distance in the 1-norm.
    pub(crate) fn proximity(&self, other: &Aabb) -> f64 {
        ((self.min.x + self.max.x) - (other.min.x + other.max.x)).abs()
            + ((self.min.y + self.max.y) - (other.min.y + other.max.y)).abs()
    }
}

/// The larger of a number and zero; zero for NaN. One instruction, which `f64::max` is not.
pub(super) fn positive_part(x: f64) -> f64 {
    if x > 0.0 { x } else { 0.0 }
}

/// Sine and cosine, to within one unit in the last place of 1.
///
/// The angle is reduced to [-pi/4, pi/4] by subtracting a multiple of pi/2 that is held in two parts (the first has 33
/// bits, so that its product with a count below 2^20 is exact); then come the minimax polynomials of fdlibm.
fn sin_cos(angle: f64) -> (f64, f64) {
    const HALF_PI_HIGH: f64 = 1.570_796_326_734_125_6;
    const HALF_PI_LOW: f64 = 6.077_100_506_506_192e-11;
    // Adding 1.5 * 2^52 leaves no bits for a fraction: the sum is rounded to an integer.
    const ROUNDER: f64 = 6_755_399_441_055_744.0;
    const LARGEST: f64 = 1.0e6;

    let angle = if angle.abs() <= LARGEST { angle } else { angle % TAU };
    let shifted = angle * FRAC_2_PI + ROUNDER;
    let turns = shifted - ROUNDER;
    let high = angle - turns * HALF_PI_HIGH;
    let low = turns * HALF_PI_LOW;
    let x = high - low;
    let rest = (high - x) - low;

    let z = x * x;
    let sin_tail = 8.333_333_333_322_49e-3
        + z * (-1.984_126_982_985_795e-4
            + z * (2.755_731_370_707_006_8e-6
                + z * (-2.505_076_025_340_686_3e-8 + z * 1.589_690_995_211_55e-10)));
    let sin = x - ((z * (0.5 * rest - z * x * sin_tail) - rest) - z * x * -1.666_666_666_666_663_2e-1);
    let cos_tail = z
        * (4.166_666_666_666_66e-2
            + z * (-1.388_888_888_887_411e-3
                + z * (2.480_158_728_947_673e-5
                    + z * (-2.755_731_435_139_066_3e-7
                        + z * (2.087_572_321_298_175e-9 + z * -1.135_964_755_778_819_5e-11)))));
    let half_z = 0.5 * z;
    let head = 1.0 - half_z;
    let cos = head + (((1.0 - head) - half_z) + (z * cos_tail - x * rest));

    // The last two bits of the shifted sum are the quadrant.
    match shifted.to_bits() & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_agrees_with_the_platform() {
        let mut worst: f64 = 0.0;
        for i in -40_000..=40_000_i32 {
            for angle in
                [f64::from(i) * 1.0e-3, f64::from(i) * 0.731, f64::from(i) * std::f64::consts::FRAC_PI_4]
            {
                let (sin, cos) = sin_cos(angle);
                worst = worst.max((sin - angle.sin()).abs()).max((cos - angle.cos()).abs());
            }
        }
        assert!(worst <= f64::EPSILON, "worst difference {worst:e}");
    }

    #[test]
    fn sine_of_extreme_angles() {
        assert_eq!(sin_cos(0.0), (0.0, 1.0));
        let (sin, cos) = sin_cos(1.0e9);
        assert!((sin - 1.0e9_f64.sin()).abs() < 1.0e-7 && (cos - 1.0e9_f64.cos()).abs() < 1.0e-7);
        assert!(sin_cos(f64::INFINITY).0.is_nan());
    }

    #[test]
    fn boxes_touch_on_their_border_and_never_with_nan() {
        let unit = Aabb { min: vec2(0.0, 0.0), max: vec2(1.0, 1.0) };
        let next = Aabb { min: vec2(1.0, 1.0), max: vec2(2.0, 2.0) };
        let broken = Aabb { min: vec2(f64::NAN, 0.0), max: vec2(f64::NAN, 1.0) };
        assert!(unit.intersects(&next) && unit.contains(&unit));
        assert!(!unit.intersects(&broken) && !unit.contains(&broken));
    }
}
