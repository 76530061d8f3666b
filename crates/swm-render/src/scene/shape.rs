//! Solids that rays meet in closed form: where, and how the surface is turned there. Meshes are not among them.

use super::description::Shape;
use super::lanes::{Lanes, Lanes3, splat};

/// What a ray that misses has for its depth.
const MISS: f32 = f32::INFINITY;

/// Half lengths of a box around the shape; endless planes are as long as `far`.
pub(super) fn half_lengths(shape: &Shape, far: f32) -> [f32; 3] {
    let end = |half: f32| if half > 0.0 { half } else { far };
    match *shape {
        Shape::Plane { half, .. } => [end(half[0]), end(half[1]), 0.0],
        Shape::Ellipsoid { radii } => radii,
        Shape::Capsule { radius, half } => [radius, radius, half + radius],
        Shape::Cylinder { radius, half } => [radius, radius, half],
        Shape::Box { half } => half,
        Shape::Mesh(_) => [0.0; 3],
    }
}

/// The outward direction of the surface at `point`, of length 1, both in the shape's frame.
#[inline]
pub(super) fn outward(shape: &Shape, point: Lanes3) -> Lanes3 {
    let zero = splat(0.0);
    match *shape {
        Shape::Plane { .. } | Shape::Mesh(_) => Lanes3 { x: zero, y: zero, z: splat(1.0) },
        Shape::Ellipsoid { radii } => {
            let part = |value: Lanes, radius: f32| value * splat(1.0 / (radius * radius));
            Lanes3 { x: part(point.x, radii[0]), y: part(point.y, radii[1]), z: part(point.z, radii[2]) }
                .normalized()
        }
        Shape::Capsule { half, .. } => {
            let end = point.z.max(splat(-half)).min(splat(half));
            Lanes3 { x: point.x, y: point.y, z: point.z - end }.normalized()
        }
        Shape::Cylinder { radius, half } => {
            // Nearer to the mantle or to an end?
            let across = (point.x * point.x + point.y * point.y).sqrt();
            let is_end = (splat(half) - point.z.abs()).simd_lt((splat(radius) - across).abs());
            let side = Lanes3 { x: point.x, y: point.y, z: zero }.normalized();
            let end = sign(point.z);
            Lanes3 {
                x: is_end.select(zero, side.x),
                y: is_end.select(zero, side.y),
                z: is_end.select(end, zero),
            }
        }
        Shape::Box { half } => {
            let gap = |value: Lanes, half: f32| (splat(half) - value.abs()).abs();
            let (x, y, z) = (gap(point.x, half[0]), gap(point.y, half[1]), gap(point.z, half[2]));
            let is_x = x.simd_le(y) & x.simd_le(z);
            let is_y = y.simd_lt(x) & y.simd_le(z);
            let is_z = !(is_x | is_y);
            Lanes3 {
                x: is_x.select(sign(point.x), zero),
                y: is_y.select(sign(point.y), zero),
                z: is_z.select(sign(point.z), zero),
            }
        }
    }
}

#[inline]
fn sign(value: Lanes) -> Lanes {
    value.simd_lt(splat(0.0)).select(splat(-1.0), splat(1.0))
}

/// Where rays `place` + t × `direction` enter the plane z = 0 within half lengths, 0 for none: t, infinite for those that miss.
/// The other shapes are entered in the same way.
#[inline]
pub(super) fn plane(half: [f32; 2], place: Lanes3, direction: Lanes3) -> Lanes {
    let t = -place.z / direction.z;
    let inside = |half: f32, start: Lanes, step: Lanes| {
        let at = (start + t * step).abs();
        at.simd_le(splat(if half > 0.0 { half } else { f32::MAX }))
    };
    let hit = inside(half[0], place.x, direction.x) & inside(half[1], place.y, direction.y);
    hit.select(t, splat(MISS))
}

/// The unit ball.
#[inline]
pub(super) fn ball(place: Lanes3, direction: Lanes3) -> Lanes {
    let a = direction.dot(direction);
    let b = place.dot(direction);
    let c = place.dot(place) - splat(1.0);
    let square = b * b - a * c;
    let hit = square.simd_ge(splat(0.0));
    hit.select((-b - square.max(splat(0.0)).sqrt()) / a, splat(MISS))
}

/// The mantle of the endless cylinder along z: t where rays enter, and which do.
#[inline]
fn mantle(radius: f32, place: Lanes3, direction: Lanes3) -> (Lanes, Lanes) {
    let a = (direction.x * direction.x + direction.y * direction.y).max(splat(1e-20));
    let b = place.x * direction.x + place.y * direction.y;
    let c = place.x * place.x + place.y * place.y - splat(radius * radius);
    let square = b * b - a * c;
    let hit = square.simd_ge(splat(0.0));
    ((-b - square.max(splat(0.0)).sqrt()) / a, hit)
}

#[inline]
pub(super) fn capsule(radius: f32, half: f32, place: Lanes3, direction: Lanes3) -> Lanes {
    // The balls at the ends are as wide as the endless cylinder: what misses it misses them too.
    let (t, hit) = mantle(radius, place, direction);
    if hit.to_bitmask() == 0 {
        return splat(MISS);
    }
    let z = place.z + t * direction.z;
    let on_side = z.abs().simd_le(splat(half));
    let end = z.simd_lt(splat(0.0)).select(splat(-half), splat(half));
    let inverse = splat(1.0 / radius);
    let moved = Lanes3 { x: place.x, y: place.y, z: place.z - end };
    let at_end = ball(moved.scaled(inverse), direction.scaled(inverse));
    hit.select(on_side.select(t, at_end), splat(MISS))
}

#[inline]
pub(super) fn cylinder(radius: f32, half: f32, place: Lanes3, direction: Lanes3) -> Lanes {
    let (t, hit) = mantle(radius, place, direction);
    let z = place.z + t * direction.z;
    let on_side = hit & z.abs().simd_le(splat(half));
    let end = direction.z.simd_lt(splat(0.0)).select(splat(half), splat(-half));
    let flat = (end - place.z) / direction.z;
    let (x, y) = (place.x + flat * direction.x, place.y + flat * direction.y);
    let on_end = (x * x + y * y).simd_le(splat(radius * radius));
    on_side.select(t, on_end.select(flat, splat(MISS)))
}

#[inline]
pub(super) fn slabs(half: [f32; 3], place: Lanes3, direction: Lanes3) -> Lanes {
    let range = |half: f32, start: Lanes, step: Lanes| {
        let inverse = splat(1.0) / step;
        let (a, b) = ((splat(-half) - start) * inverse, (splat(half) - start) * inverse);
        (a.min(b), a.max(b))
    };
    let (x0, x1) = range(half[0], place.x, direction.x);
    let (y0, y1) = range(half[1], place.y, direction.y);
    let (z0, z1) = range(half[2], place.z, direction.z);
    let (enter, leave) = (x0.max(y0).max(z0), x1.min(y1).min(z1));
    enter.simd_gt(leave).select(splat(MISS), enter)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SHAPES: [Shape; 4] = [
        Shape::Ellipsoid { radii: [0.5, 1.0, 2.0] },
        Shape::Capsule { radius: 0.4, half: 0.8 },
        Shape::Cylinder { radius: 0.7, half: 0.3 },
        Shape::Box { half: [0.3, 0.6, 0.9] },
    ];

    /// How far outside of the surface a point is, roughly; 0 on it.
    fn outside(shape: &Shape, [x, y, z]: [f32; 3]) -> f32 {
        match *shape {
            Shape::Ellipsoid { radii: [a, b, c] } => {
                ((x / a).powi(2) + (y / b).powi(2) + (z / c).powi(2)).sqrt() - 1.0
            }
            Shape::Capsule { radius, half } => {
                (x * x + y * y + (z - z.clamp(-half, half)).powi(2)).sqrt() - radius
            }
            Shape::Cylinder { radius, half } => ((x * x + y * y).sqrt() - radius).max(z.abs() - half),
            Shape::Box { half: [a, b, c] } => (x.abs() - a).max(y.abs() - b).max(z.abs() - c),
            Shape::Plane { .. } | Shape::Mesh(_) => z,
        }
    }

    fn enter(shape: &Shape, place: Lanes3, direction: Lanes3) -> Lanes {
        match *shape {
            Shape::Ellipsoid { radii } => {
                let inverse = lanes(radii.map(|radius| 1.0 / radius));
                ball(place * inverse, direction * inverse)
            }
            Shape::Capsule { radius, half } => capsule(radius, half, place, direction),
            Shape::Cylinder { radius, half } => cylinder(radius, half, place, direction),
            Shape::Box { half } => slabs(half, place, direction),
            Shape::Plane { .. } | Shape::Mesh(_) => splat(MISS),
        }
    }

    fn lanes(v: [f32; 3]) -> Lanes3 {
        Lanes3 { x: splat(v[0]), y: splat(v[1]), z: splat(v[2]) }
    }

    proptest! {
        #[test]
        fn rays_enter_on_the_surface_and_face_it(
            from in prop::array::uniform3(-3.0f32..3.0),
            to in prop::array::uniform3(-0.9f32..0.9),
        ) {
            for shape in SHAPES {
                prop_assume!(outside(&shape, from) > 0.1);
                let direction = [0, 1, 2].map(|i| to[i] - from[i]);
                let t = enter(&shape, lanes(from), lanes(direction)).to_array()[5];
                if outside(&shape, to) < -0.01 {
                    prop_assert!(t < 1.0, "the target is inside, so the ray enters before it");
                }
                if t.is_finite() {
                    let point = [0, 1, 2].map(|i| from[i] + t * direction[i]);
                    prop_assert!(outside(&shape, point).abs() < 2e-3, "{shape:?} {point:?}");
                    let normal = outward(&shape, lanes(point));
                    prop_assert!((normal.dot(normal).to_array()[0] - 1.0).abs() < 1e-4);
                    prop_assert!(normal.dot(lanes(direction)).to_array()[0] < 1e-2);
                } else {
                    prop_assert!(outside(&shape, to) > -0.01);
                }
            }
        }
    }
}
