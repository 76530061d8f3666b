//! Meshes by rasterisation: which triangle is nearest at which sample.

use super::description::Instance;
use super::lanes::{LANES, load, splat};
use super::mesh::Level;
use super::samples::Samples;
use super::vector::{Vector, add, cross, dot, length, rotate, scale, sub, wide};
use super::view::{Area, View};

/// Which sides of triangles are seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sides {
    Front,
    /// Of a mirrored view, where front faces look like backs.
    MirroredFront,
    Both,
}

/// Corners of a mesh in the picture, kept between frames for their memory.
#[derive(Debug, Default)]
pub(super) struct Projected {
    /// x × w, y × w and w, where w is the depth of a perspective view and 1 in a parallel one; and nearness for that.
    corners: Vec<[f32; 4]>,
}

/// A corner in the picture: x, y, nearness.
type Corner = [f32; 3];

/// Draws `level` of the mesh that `instance` is.
pub(super) fn draw(
    view: &View,
    instance: &Instance,
    owner: u16,
    level: &Level,
    sides: Sides,
    projected: &mut Projected,
    samples: &mut Samples,
) {
    project(view, instance, level, projected);
    let near = view.nearest();
    let corners = &projected.corners;
    for (facet, triangle) in (0..).zip(&level.triangles) {
        let [a, b, c] = triangle.map(|index| corners[index as usize]);
        let mut raster = |corners: [Corner; 3]| fill(view, corners, owner, facet, sides, samples);
        if !view.is_perspective() {
            raster([a, b, c].map(|[x, y, _, nearness]| [x, y, nearness]));
            continue;
        }
        let is_seen = |corner: [f32; 4]| corner[3] > 0.0 && corner[3] <= near;
        match [a, b, c].map(is_seen) {
            [true, true, true] => raster([a, b, c].map(flat)),
            [false, false, false] => {}
            _ => clipped([a, b, c], 1.0 / near, raster),
        }
    }
}

fn flat([x, y, _depth, nearness]: [f32; 4]) -> Corner {
    [x * nearness, y * nearness, nearness]
}

/// All points of the mesh: homogeneous pixel coordinates, linear in the point.
fn project(view: &View, instance: &Instance, level: &Level, projected: &mut Projected) {
    let (rows, offset) = homogeneous(view, instance);
    let perspective = view.is_perspective();
    projected.corners.clear();
    projected.corners.extend(level.points.iter().map(|&[x, y, z]| {
        let part = |i: usize| rows[i][0] * x + rows[i][1] * y + rows[i][2] * z + offset[i];
        let depth = part(2);
        let nearness = if perspective { 1.0 / depth } else { -depth };
        [part(0), part(1), depth, nearness]
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
fn clipped(corners: [[f32; 4]; 3], near: f32, mut raster: impl FnMut([Corner; 3])) {
    let mut kept: [[f32; 4]; 4] = [[0.0; 4]; 4];
    let mut count = 0;
    for k in 0..3 {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        if from[2] >= near {
            kept[count] = from;
            count += 1;
        }
        if (from[2] >= near) != (to[2] >= near) {
            let share = (near - from[2]) / (to[2] - from[2]);
            let mix = |i: usize| from[i] + share * (to[i] - from[i]);
            kept[count] = [mix(0), mix(1), near, 1.0 / near];
            count += 1;
        }
    }
    for k in 2..count {
        raster([flat(kept[0]), flat(kept[k - 1]), flat(kept[k])]);
    }
}

/// One triangle: samples inside of its edges where it is nearer than what was there.
#[inline]
fn fill(view: &View, corners: [Corner; 3], owner: u16, facet: u32, sides: Sides, samples: &mut Samples) {
    let [mut a, b, mut c] = corners;
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
    let low = |i: usize| a[i].min(b[i]).min(c[i]);
    let high = |i: usize| a[i].max(b[i]).max(c[i]);
    let (left, top) = (low(0).max(0.0), low(1).max(0.0));
    let (right, bottom) = (high(0).min(view.width as f32), high(1).min(view.height as f32));
    if left >= right || top >= bottom || !samples.may_meet([left, right], [top, bottom]) {
        return;
    }
    let end = |value: f32, size: usize| (value as usize + 1).min(size);
    let extent = Area {
        x0: left as usize,
        x1: end(right, view.width),
        y0: top as usize,
        y1: end(bottom, view.height),
    };
    let edges = [edge(b, c), edge(c, a), edge(a, b)];
    // Nearness is linear across the picture.
    let inverse = 1.0 / area;
    let slope_x = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) * inverse;
    let slope_y = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) * inverse;
    for row in extent.y0..extent.y1 {
        let range = samples.within(row, &extent);
        let mut at = range.start;
        while at < range.end {
            let (x, y) = (load(&samples.x[at..], 0.0), load(&samples.y[at..], 0.0));
            let side = |edge: &Edge| {
                let value = splat(edge.by_x) * x + splat(edge.by_y) * y + splat(edge.constant);
                if edge.owns { value.simd_ge(splat(0.0)) } else { value.simd_gt(splat(0.0)) }
            };
            let inside = side(&edges[0]) & side(&edges[1]) & side(&edges[2]);
            if inside.to_bitmask() != 0 {
                let nearness =
                    splat(a[2]) + (x - splat(a[0])) * splat(slope_x) + (y - splat(a[1])) * splat(slope_y);
                let seen = inside
                    & nearness.simd_gt(load(&samples.nearness[at..], 0.0))
                    & nearness.simd_lt(load(&samples.limit[at..], 0.0));
                put(samples, at, seen.to_bitmask(), nearness.to_array(), owner, facet);
            }
            at += LANES;
        }
    }
}

/// Writes what is seen at the lanes whose bit is set.
#[inline]
pub(super) fn put(
    samples: &mut Samples,
    at: usize,
    mask: u32,
    nearness: [f32; LANES],
    owner: u16,
    facet: u32,
) {
    let mut bits = mask;
    while bits != 0 {
        let lane = bits.trailing_zeros() as usize;
        samples.nearness[at + lane] = nearness[lane];
        samples.owner[at + lane] = owner;
        samples.facet[at + lane] = facet;
        bits &= bits - 1;
    }
}

/// An edge: the sum of its parts at a point is positive to the inside.
struct Edge {
    by_x: f32,
    by_y: f32,
    constant: f32,
    /// Whether points on it belong to this triangle: to one of the two that share it.
    owns: bool,
}

/// The edge from `p` to `q`; that from `q` to `p` has exactly the opposite parts.
#[inline]
fn edge(p: Corner, q: Corner) -> Edge {
    let (by_x, by_y) = (p[1] - q[1], q[0] - p[0]);
    let owns = by_x > 0.0 || (by_x == 0.0 && by_y > 0.0);
    Edge { by_x, by_y, constant: p[0] * q[1] - q[0] * p[1], owns }
}

/// Shares of the three corners of triangle `facet` at a point of its plane, from the sizes of the opposite parts.
pub(super) fn shares(level: &Level, facet: u32, point: [f32; 3]) -> [f32; 3] {
    let [a, b, c] = level.triangles[facet as usize].map(|index| wide(level.points[index as usize]));
    let point = wide(point);
    let normal = cross(sub(b, a), sub(c, a));
    let whole = dot(normal, normal);
    if whole == 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let part = |p: Vector, q: Vector| dot(cross(sub(q, p), sub(point, p)), normal) / whole;
    let [x, y] = [part(b, c), part(c, a)].map(|share| share.clamp(0.0, 1.0));
    let sum = (x + y).max(1.0);
    [(x / sum) as f32, (y / sum) as f32, (1.0 - ((x + y) / sum)) as f32]
}

/// A ball around the mesh: centre and radius in the world.
pub(super) fn ball((low, high): ([f32; 3], [f32; 3]), instance: &Instance) -> (Vector, f64) {
    let (low, high) = (wide(low), wide(high));
    let middle = scale(add(low, high), 0.5);
    (add(instance.position, rotate(instance.rotation, middle)), 0.5 * length(sub(high, low)))
}
