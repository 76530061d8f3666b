//! The light that a surface sends to the eye: the fixed-function lighting equation (OpenGL 1.5, section 2.14.1) with a
//! local viewer, for eight points at a time.

use super::description::{Light, LightKind, Material};
use super::lanes::{Lanes, Lanes3, power, splat};
use super::vector::{Vector, scale, sub};

/// A light, counted from the eye.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    light: Light,
    /// Toward a sun; the place of a spot, from the eye.
    place: Vector,
    /// The cosine of a spot's cutoff; `None`: it shines everywhere.
    spot: Option<f32>,
}

/// What of a material the equation needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    pub(super) color: [f32; 3],
    pub(super) specular: f32,
    pub(super) shininess: f32,
    pub(super) emission: f32,
}

impl Surface {
    pub(super) fn of(material: &Material) -> Self {
        let [r, g, b, _] = material.color;
        Self {
            color: [r, g, b],
            specular: material.specular,
            shininess: material.shininess,
            emission: material.emission,
        }
    }
}

impl Lamp {
    pub(super) fn new(light: &Light, eye: Vector) -> Self {
        let (place, spot) = match light.kind {
            LightKind::Sun => (scale(light.direction, -1.0), None),
            // OpenGL refuses cutoffs between 90 and 180 degrees and goes on without.
            LightKind::Spot { cutoff, .. } => {
                (sub(light.position, eye), (cutoff <= 90.0).then(|| cosine(cutoff)))
            }
        };
        Self { light: *light, place, spot }
    }

    pub(super) fn casts_shadows(&self) -> bool {
        self.light.shadow.is_some()
    }

    /// The light that points `point` (counted from the eye) with outward directions `normal` send along `to_eye`, both
    /// of length 1. Not limited to 1.
    #[inline]
    pub(super) fn light(&self, surface: &Surface, point: Lanes3, normal: Lanes3, to_eye: Lanes3) -> Lanes3 {
        let (zero, one) = (splat(0.0), splat(1.0));
        let (toward, strength) = match self.light.kind {
            LightKind::Sun => (Lanes3::splat(self.place), one),
            LightKind::Spot { exponent, attenuation, .. } => {
                let way = Lanes3::splat(self.place) - point;
                let toward = way.normalized();
                let mut strength = one;
                if attenuation != [1.0, 0.0, 0.0] {
                    let [k0, k1, k2] = attenuation.map(splat);
                    let squared = way.dot(way);
                    strength = one / (k0 + k1 * squared.sqrt() + k2 * squared);
                }
                if let Some(cutoff) = self.spot {
                    let cosine = -toward.dot(Lanes3::splat(self.light.direction));
                    let lit = power(cosine.max(zero).min(one), exponent);
                    strength *= cosine.simd_gt(splat(cutoff)).select(lit, zero);
                }
                (toward, strength)
            }
        };
        let facing = normal.dot(toward);
        let is_lit = facing.simd_gt(zero);
        let diffuse = is_lit.select(facing, zero) * strength;
        let shines = surface.specular > 0.0 && self.light.specular != [0.0; 3];
        let gloss = if shines && is_lit.to_bitmask() != 0 {
            let half = (toward + to_eye).normalized();
            let shine = power(normal.dot(half).max(zero).min(one), surface.shininess);
            is_lit.select(shine, zero) * splat(surface.specular) * strength
        } else {
            zero
        };
        let part = |i: usize| {
            let scattered = splat(self.light.ambient[i]) * strength + splat(self.light.diffuse[i]) * diffuse;
            splat(surface.color[i]) * scattered + splat(self.light.specular[i]) * gloss
        };
        Lanes3 { x: part(0), y: part(1), z: part(2) }
    }
}

/// The sum of the lamps that cast no shadows (or of all, if `shadows` is off) and what the surface shines by itself.
#[inline]
pub(super) fn base(
    lamps: &[Lamp],
    shadows: bool,
    surface: &Surface,
    point: Lanes3,
    normal: Lanes3,
    to_eye: Lanes3,
) -> Lanes3 {
    let shine = |i: usize| splat(surface.emission * surface.color[i]);
    let mut sum = Lanes3 { x: shine(0), y: shine(1), z: shine(2) };
    for lamp in lamps.iter().filter(|lamp| !(shadows && lamp.casts_shadows())) {
        sum = sum + lamp.light(surface, point, normal, to_eye);
    }
    limited(sum)
}

/// Between 0 and 1.
#[inline]
pub(super) fn limited(color: Lanes3) -> Lanes3 {
    let limit = |value: Lanes| value.max(splat(0.0)).min(splat(1.0));
    Lanes3 { x: limit(color.x), y: limit(color.y), z: limit(color.z) }
}

/// The cosine of an angle of 0 to 90 degrees. A series, because the system's cosine differs from machine to machine.
fn cosine(degrees: f32) -> f32 {
    let x = f64::from(degrees).to_radians();
    let square = x * x;
    let mut sum = 0.0;
    for k in (1..=10).rev() {
        let k = f64::from(k);
        sum = -square / ((2.0 * k - 1.0) * (2.0 * k)) * (1.0 + sum);
    }
    (1.0 + sum) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lanes(v: [f32; 3]) -> Lanes3 {
        Lanes3 { x: splat(v[0]), y: splat(v[1]), z: splat(v[2]) }
    }

    const LIGHT: Light = Light {
        kind: LightKind::Sun,
        direction: [0.0, 0.0, -1.0],
        position: [0.0, 0.0, 2.0],
        ambient: [0.1, 0.0, 0.0],
        diffuse: [0.0, 0.5, 0.0],
        specular: [0.0, 0.0, 0.25],
        shadow: None,
    };
    const SURFACE: Surface =
        Surface { color: [1.0, 0.5, 1.0], specular: 0.5, shininess: 64.0, emission: 0.0 };

    #[test]
    fn each_term_of_the_equation_is_there() {
        let up = lanes([0.0, 0.0, 1.0]);
        let lamp = Lamp::new(&LIGHT, [0.0; 3]);
        let color = lamp.light(&SURFACE, lanes([0.0, 0.0, -1.0]), up, up);
        let found = [color.x, color.y, color.z].map(|lanes| lanes.to_array()[0]);
        assert!((found[0] - 0.1).abs() < 1e-6 && (found[1] - 0.25).abs() < 1e-6, "{found:?}");
        assert!((found[2] - 0.125).abs() < 1e-4, "{found:?}");
        let below = lamp.light(&SURFACE, lanes([0.0, 0.0, -1.0]), -up, up);
        assert!((below.x.to_array()[0] - 0.1).abs() < 1e-6 && below.y.to_array()[0] == 0.0);
    }

    #[test]
    fn spots_darken_to_the_side() {
        let kind = LightKind::Spot { cutoff: 45.0, exponent: 10.0, attenuation: [1.0, 0.0, 0.0] };
        let lamp = Lamp::new(&Light { kind, ..LIGHT }, [0.0; 3]);
        let up = lanes([0.0, 0.0, 1.0]);
        let at = |x: f32| lamp.light(&SURFACE, lanes([x, 0.0, 0.0]), up, up).x.to_array()[0];
        assert!((at(0.0) - 0.1).abs() < 1e-5);
        let slanted = 2.0 / (2.0f32 * 2.0 + 1.0).sqrt();
        assert!((at(1.0) - 0.1 * slanted.powi(10)).abs() < 1e-5);
        assert_eq!(at(2.1), 0.0);
    }

    #[test]
    fn the_series_is_the_cosine() {
        for degrees in 0..=90 {
            let exact = f64::from(degrees).to_radians().cos() as f32;
            assert!((cosine(degrees as f32) - exact).abs() < 1e-7);
        }
    }
}
