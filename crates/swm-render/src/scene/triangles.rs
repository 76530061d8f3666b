//! Meshes by rasterization: which triangle is nearest at which sample.

use super::description::Instance;
use super::lanes::{LANES, Lanes, splat};
use super::mesh::Level;
use super::small;
use super::target::{Target, first};
use super::vector::{Vector, add, dot, length, rotate, scale, sub, wide};
use super::view::View;

/// Which sides of triangles are seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sides {
    Front,
    /// Of a mirrored view, where front faces look like backs.
    MirroredFront,
    Both,
}

/// Corners of a mesh in the image, kept between frames for their memory.
#[derive(Debug, Default)]
pub(super) struct Projected {
    corners: Vec<Corner>,
}

/// A corner in the image: x, y, nearness, depth.
pub(super) type Corner = [f32; 4];

/// Draws `level` of the mesh that `instance` is; `in_front`: no part of it can be nearer than the near plane.
#[expect(clippy::too_many_arguments, reason = "the inner loop's inputs")]
pub(super) fn draw<T: Target>(
    view: &View,
    instance: &Instance,
    owner: u16,
    level: &Level,
    sides: Sides,
    in_front: bool,
    projected: &mut Projected,
    target: &mut T,
) {
    project(view, instance, level, projected);
    let near = view.nearest();
    let (size, corners) = ([view.width as f32, view.height as f32], projected.corners.as_slice());
    if in_front {
        let grid = target.grid().copied();
        for (first, triangles) in (0..).step_by(LANES).zip(level.triangles.chunks(LANES)) {
            if let Some(grid) = &grid {
                small::draw(triangles, corners, sides, (owner, first), grid, target);
                continue;
            }
            let mut bits = candidates(triangles, corners, sides, size, target.density());
            while bits != 0 {
                let lane = bits.trailing_zeros();
                let triangle = triangles[lane as usize].map(|index| corners[index as usize]);
                fill(size, triangle, owner, first + lane, sides, target);
                bits &= bits - 1;
            }
        }
        return;
    }
    for (facet, &[a, b, c]) in (0..).zip(&level.triangles) {
        let (a, b, c) = (corners[a as usize], corners[b as usize], corners[c as usize]);
        let is_seen = |corner: Corner| corner[2] > 0.0 && corner[2] <= near;
        match [is_seen(a), is_seen(b), is_seen(c)] {
            [true, true, true] => fill(size, [a, b, c], owner, facet, sides, target),
            [false, false, false] => {}
            _ => clipped([a, b, c], 1.0 / near, |corners| fill(size, corners, owner, facet, sides, target)),
        }
    }
}

/// Which of up to eight triangles face the eye and can have a point of a target with so many points per pixel's length.
#[inline]
fn candidates(triangles: &[[u32; 3]], corners: &[Corner], sides: Sides, size: [f32; 2], density: f32) -> u32 {
    let mut places = [[0.0; LANES]; 6];
    for (lane, triangle) in triangles.iter().enumerate() {
        for (k, &index) in triangle.iter().enumerate() {
            let corner = &corners[index as usize];
            places[2 * k][lane] = corner[0];
            places[2 * k + 1][lane] = corner[1];
        }
    }
    let [ax, ay, bx, by, cx, cy] = places.map(Lanes::new);
    let (zero, half) = (splat(0.0), splat(0.5));
    let area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    let faces = match sides {
        Sides::Front => area.simd_lt(zero),
        Sides::MirroredFront => area.simd_gt(zero),
        Sides::Both => area.simd_ne(zero),
    };
    // Points lie at odd halves of their spacing.
    let meets = |a: Lanes, b: Lanes, c: Lanes, size: f32| {
        let low = a.fast_min(b).fast_min(c).fast_max(zero) * splat(density) + half;
        let high = a.fast_max(b).fast_max(c).fast_min(splat(size)) * splat(density) + half;
        Lanes::from_i32x8(high.fast_max(splat(-1.0)).fast_trunc_int()).simd_ge(low)
    };
    (faces & meets(ax, bx, cx, size[0]) & meets(ay, by, cy, size[1])).to_bitmask()
}

/// All points of the mesh, in the image.
fn project(view: &View, instance: &Instance, level: &Level, projected: &mut Projected) {
    let ([by_x, by_y, by_z], [from_x, from_y, from_z]) = homogeneous(view, instance);
    let perspective = view.is_perspective();
    projected.corners.clear();
    projected.corners.reserve(level.most);
    projected.corners.extend(level.points.iter().map(|&[x, y, z]| {
        let (across, down) = (
            by_x[0] * x + by_x[1] * y + by_x[2] * z + from_x,
            by_y[0] * x + by_y[1] * y + by_y[2] * z + from_y,
        );
        let depth = by_z[0] * x + by_z[1] * y + by_z[2] * z + from_z;
        if perspective {
            let nearness = 1.0 / depth;
            [across * nearness, down * nearness, nearness, depth]
        } else {
            [across, down, -depth, depth]
        }
    }));
}

/// The matrix and the offset that take a point of the instance to (x × w, y × w, depth).
fn homogeneous(view: &View, instance: &Instance) -> ([[f32; 3]; 3], [f32; 3]) {
    let [by_x, by_y, by_depth] = view.axes();
    let row = |axis: Vector| {
        let columns = [0, 1, 2].map(|k| [0, 1, 2].map(|i| instance.rotation[i][k]));
        columns.map(|column| dot(axis, column) as f32)
    };
    let (from, constant) = view.axes_origin();
    let moved = sub(instance.position, from);
    let offset = [dot(by_x, moved) + constant[0], dot(by_y, moved) + constant[1], dot(by_depth, moved)];
    ([row(by_x), row(by_y), row(by_depth)], offset.map(|value| value as f32))
}

/// Cuts a triangle at the near plane and gives on what is in front.
fn clipped(corners: [Corner; 3], near: f32, mut raster: impl FnMut([Corner; 3])) {
    // x × depth and y × depth are linear along edges, also through the eye.
    let flat = |[x, y, depth]: [f32; 3]| [x / depth, y / depth, 1.0 / depth, depth];
    let deep = |[x, y, _, depth]: Corner| [x * depth, y * depth, depth];
    let mut kept: [Corner; 4] = [[0.0; 4]; 4];
    let mut count = 0;
    for k in 0..3 {
        let (from, to) = (deep(corners[k]), deep(corners[(k + 1) % 3]));
        if from[2] >= near {
            kept[count] = corners[k];
            count += 1;
        }
        if (from[2] >= near) != (to[2] >= near) {
            let share = (near - from[2]) / (to[2] - from[2]);
            let mix = |i: usize| from[i] + share * (to[i] - from[i]);
            kept[count] = flat([mix(0), mix(1), near]);
            count += 1;
        }
    }
    for k in 2..count {
        raster([kept[0], kept[k - 1], kept[k]]);
    }
}

/// One triangle: points inside of its edges where it is nearer than what was there.
#[inline]
fn fill<T: Target>(
    size: [f32; 2],
    [mut a, b, mut c]: [Corner; 3],
    owner: u16,
    facet: u32,
    sides: Sides,
    target: &mut T,
) {
    // With y downward, front faces run clockwise: their area is negative.
    let mut area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let hidden = match sides {
        Sides::Front => area >= 0.0,
        Sides::MirroredFront => area <= 0.0,
        Sides::Both => area == 0.0,
    };
    if hidden || !area.is_finite() {
        return;
    }
    if area < 0.0 {
        (a, c, area) = (c, a, -area);
    }
    let low = |i: usize| larger(smaller(smaller(a[i], b[i]), c[i]), 0.0);
    let high = |i: usize| smaller(larger(larger(a[i], b[i]), c[i]), size[i]);
    let (left, right, top, bottom) = (low(0), high(0), low(1), high(1));
    if left >= right || top >= bottom {
        return;
    }
    let extent = target.extent(left, right, top, bottom);
    if extent.x0 >= extent.x1 {
        return;
    }
    let mut plane: Option<([Edge; 3], [f32; 2])> = None;
    for row in extent.y0..extent.y1 {
        let range = target.within(row, extent.x0, extent.x1);
        if range.is_empty() {
            continue;
        }
        // Most triangles meet no point at all: what follows is computed where it is needed.
        let (edges, gradients) = plane.get_or_insert_with(|| plane_of([a, b, c], area));
        if range.len() <= FEW {
            for at in range {
                let (x, y) = target.point(row, at);
                if edges.iter().all(|edge| edge.keeps(x, y)) {
                    let nearness = a[2] + (x - a[0]) * gradients[0] + (y - a[1]) * gradients[1];
                    target.offer_one(at, nearness, owner, facet);
                }
            }
            continue;
        }
        let mut at = range.start;
        while at < range.end {
            let (x, y) = target.points(row, at);
            let inside = edges[0].keep(x, y) & edges[1].keep(x, y) & edges[2].keep(x, y);
            let mask = inside.to_bitmask() & first(range.end - at);
            if mask != 0 {
                let nearness = splat(a[2])
                    + (x - splat(a[0])) * splat(gradients[0])
                    + (y - splat(a[1])) * splat(gradients[1]);
                target.offer(at, mask, nearness, owner, Some(facet));
            }
            at += LANES;
        }
    }
}

/// The edges of a triangle with the area `area`, and how nearness grows from pixel to pixel: it is linear across the image.
#[inline]
fn plane_of([a, b, c]: [Corner; 3], area: f32) -> ([Edge; 3], [f32; 2]) {
    let inverse = 1.0 / area;
    let gradient_x = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) * inverse;
    let gradient_y = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) * inverse;
    ([edge(b, c), edge(c, a), edge(a, b)], [gradient_x, gradient_y])
}

/// The smaller of two values in one instruction, which does not handle NaN.
#[inline]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// So many points are tested one by one.
const FEW: usize = 2;

/// An edge: the sum of its parts at a point is positive to the inside.
struct Edge {
    by_x: f32,
    by_y: f32,
    constant: f32,
    /// Whether points on it belong to this triangle: to one of the two that share it.
    owns: bool,
}

impl Edge {
    #[inline]
    fn keeps(&self, x: f32, y: f32) -> bool {
        let value = self.by_x * x + self.by_y * y + self.constant;
        value > 0.0 || (self.owns && value == 0.0)
    }

    /// The same for eight points.
    #[inline]
    fn keep(&self, x: Lanes, y: Lanes) -> Lanes {
        let value = splat(self.by_x) * x + splat(self.by_y) * y + splat(self.constant);
        if self.owns { value.simd_ge(splat(0.0)) } else { value.simd_gt(splat(0.0)) }
    }
}

/// The edge from `p` to `q`; that from `q` to `p` has exactly the opposite parts.
#[inline]
fn edge(p: Corner, q: Corner) -> Edge {
    let (by_x, by_y) = (p[1] - q[1], q[0] - p[0]);
    let owns = by_x > 0.0 || (by_x == 0.0 && by_y > 0.0);
    Edge { by_x, by_y, constant: p[0] * q[1] - q[0] * p[1], owns }
}

/// A ball around the mesh: center and radius in the world.
pub(super) fn ball((low, high): ([f32; 3], [f32; 3]), instance: &Instance) -> (Vector, f64) {
    let (low, high) = (wide(low), wide(high));
    let middle = scale(add(low, high), 0.5);
    (add(instance.position, rotate(instance.rotation, middle)), 0.5 * length(sub(high, low)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::grid::Raster;

    fn corner() -> impl Strategy<Value = Corner> {
        // Also on the middles of pixels and on what separates them.
        let place = prop_oneof![-9.0f32..50.0, (-18i32..100).prop_map(|half| half as f32 * 0.5)];
        (prop::array::uniform2(place), 0.1f32..9.0)
            .prop_map(|([x, y], nearness)| [x, y, nearness, 1.0 / nearness])
    }

    proptest! {
        #[test]
        fn eight_at_a_time_fill_what_each_alone_does(
            triangles in prop::collection::vec(prop::array::uniform3(corner()), 1..=LANES),
            small in 0.05f32..1.0,
        ) {
            // Some are small, some are large, and they share corners with none.
            let shrunk = |[a, b, c]: [Corner; 3], k: usize| {
                let by = if k.is_multiple_of(2) { small } else { 1.0 };
                let toward = |p: Corner| [a[0] + by * (p[0] - a[0]), a[1] + by * (p[1] - a[1]), p[2], p[3]];
                [a, toward(b), toward(c)]
            };
            let corners: Vec<Corner> =
                triangles.iter().enumerate().flat_map(|(k, corners)| shrunk(*corners, k)).collect();
            let indices: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
            let size = [45, 30];
            for sides in [Sides::Front, Sides::MirroredFront, Sides::Both] {
                let [mut together, mut alone] = [Raster::default(), Raster::default()];
                together.begin(size, 8.0, 0.0);
                alone.begin(size, 8.0, 0.0);
                let grid = *together.area();
                small::draw(&indices, &corners, sides, (7, 0), &grid, &mut together);
                for (facet, triangle) in (0..).zip(corners.chunks_exact(3)) {
                    let triangle = [triangle[0], triangle[1], triangle[2]];
                    fill(size.map(|side| side as f32), triangle, 7, facet, sides, &mut alone);
                }
                prop_assert_eq!(&together.nearness[..together.len()], &alone.nearness[..alone.len()]);
                prop_assert_eq!(&together.known.owner[..together.len()], &alone.known.owner[..alone.len()]);
                let seen = |raster: &Raster| -> Vec<(u16, u32)> {
                    let known = raster.known.owner.iter().zip(&raster.known.facet);
                    known.take(raster.len()).filter(|(owner, _)| **owner == 7).map(|(o, f)| (*o, *f)).collect()
                };
                prop_assert_eq!(seen(&together), seen(&alone));
            }
        }
    }
}
