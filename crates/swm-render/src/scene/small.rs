//! Triangles of a mesh in a grid of pixels, eight at a time: which of the few points around each are inside. Most triangles are
//! that small; larger ones are filled by columns, from what was computed for all eight.

use wide::f32x4;

use super::lanes::{LANES, Lanes, both, splat};
use super::target::{Target, first};
use super::triangles::{Corner, Sides};
use super::view::Area;

/// Triangles up to so many pixels wide and high count as small.
const SMALL: usize = 4;

/// Corners of eight triangles.
struct Corners {
    x: [Lanes; 3],
    y: [Lanes; 3],
    nearness: [Lanes; 3],
}

/// An edge of each (or of one): the sum of its parts at a point is positive to the inside.
#[derive(Clone, Copy)]
struct Edges<V> {
    by_x: V,
    by_y: V,
    constant: V,
    /// What the sum must be above: 0, or just below where points on the edge belong to the triangle: to one of the two that
    /// share it.
    bound: V,
}

/// What is the same for the points of one column of each triangle.
#[derive(Clone, Copy, Default)]
struct Column {
    in_box: Lanes,
    x: Lanes,
    /// The part of each edge's sum.
    edges: [Lanes; 3],
}

/// The triangles that are not small.
struct Large {
    edges: [Edges<[f32; LANES]>; 3],
    /// Of the first corner: x, y, nearness.
    corner: [[f32; LANES]; 3],
    /// How nearness grows along x and y.
    slope: [[f32; LANES]; 2],
    /// From which to before which column and row.
    columns: [[f32; LANES]; 2],
    rows: [[f32; LANES]; 2],
}

/// Draws up to eight triangles as instance `owner` with the facets from `facet` on. No corner may be behind the near plane;
/// `grid`: that of the target.
#[inline]
pub(super) fn draw<T: Target>(
    triangles: &[[u32; 3]],
    corners: &[Corner],
    sides: Sides,
    (owner, facet): (u16, u32),
    grid: &Area,
    target: &mut T,
) {
    let Corners { x, y, nearness } = Corners::gather(triangles, corners);
    let zero = splat(0.0);
    let area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]);
    let is_seen = match sides {
        Sides::Front => area.simd_lt(zero),
        Sides::MirroredFront => area.simd_gt(zero),
        Sides::Both => area.simd_ne(zero),
    } & area.abs().simd_lt(splat(f32::INFINITY));
    let (left, right) = span(x, grid.x0, grid.x1);
    let (top, bottom) = span(y, grid.y0, grid.y1);
    let (wide, high) = (right - left, bottom - top);
    let is_met = is_seen & wide.simd_gt(zero) & high.simd_gt(zero);
    let limit = splat(SMALL as f32);
    let is_small = is_met & wide.simd_le(limit) & high.simd_le(limit);
    let (met, small) = (is_met.to_bitmask(), is_small.to_bitmask());
    if met == 0 {
        return;
    }
    // Turned so that the area is positive.
    let turned = area.simd_lt(zero);
    let swap = |v: [Lanes; 3]| [turned.select(v[2], v[0]), v[1], turned.select(v[0], v[2])];
    let (x, y, nearness) = (swap(x), swap(y), swap(nearness));
    let edges = [(1, 2), (2, 0), (0, 1)].map(|(p, q)| Edges::new([x[p], y[p]], [x[q], y[q]]));
    // Nearness is linear across the image.
    let inverse = splat(1.0) / area.abs();
    let (near_b, near_c) = (nearness[1] - nearness[0], nearness[2] - nearness[0]);
    let by_x = (near_b * (y[2] - y[0]) - near_c * (y[1] - y[0])) * inverse;
    let by_y = (near_c * (x[1] - x[0]) - near_b * (x[2] - x[0])) * inverse;
    let width = grid.x1 - grid.x0;
    let starts = (top - splat(grid.y0 as f32)) * splat(width as f32) + (left - splat(grid.x0 as f32));
    let starts = starts.to_array();
    // Where the columns are, and the part of the edges that they decide: the same in every row.
    let mut columns = [Column::default(); SMALL];
    let mut count = 0;
    for (across, column) in columns.iter_mut().enumerate() {
        let in_box = is_small & wide.simd_gt(splat(across as f32));
        if in_box.to_bitmask() == 0 {
            break;
        }
        let x = left + splat(across as f32 + 0.5);
        *column = Column { in_box, x, edges: edges.each_ref().map(|edge| edge.by_x * x) };
        count += 1;
    }
    for down in 0..SMALL {
        let in_row = high.simd_gt(splat(down as f32));
        if (in_row & is_small).to_bitmask() == 0 {
            break;
        }
        let point_y = top + splat(down as f32 + 0.5);
        let rows = edges.each_ref().map(|edge| edge.by_y * point_y);
        for (across, column) in columns[..count].iter().enumerate() {
            let inside = (0..3).fold(in_row & column.in_box, |inside, k| {
                let value = column.edges[k] + rows[k] + edges[k].constant;
                inside & value.simd_gt(edges[k].bound)
            });
            let mut bits = inside.to_bitmask();
            if bits == 0 {
                continue;
            }
            let near = nearness[0] + (column.x - x[0]) * by_x + (point_y - y[0]) * by_y;
            let near = near.to_array();
            while bits != 0 {
                let lane = bits.trailing_zeros();
                let at = starts[lane as usize] as i32 as usize + down * width + across;
                target.offer_one(at, near[lane as usize], owner, facet + lane);
                bits &= bits - 1;
            }
        }
    }
    let mut larger = met & !small;
    if larger == 0 {
        return;
    }
    let large = Large {
        edges: edges.each_ref().map(|edge| edge.to_arrays()),
        corner: [x[0], y[0], nearness[0]].map(Lanes::to_array),
        slope: [by_x, by_y].map(Lanes::to_array),
        columns: [left, right].map(Lanes::to_array),
        rows: [top, bottom].map(Lanes::to_array),
    };
    while larger != 0 {
        let lane = larger.trailing_zeros();
        large.fill(lane as usize, (owner, facet + lane), grid, target);
        larger &= larger - 1;
    }
}

impl Large {
    /// Fills a triangle, eight columns at a time: what they decide is the same in all rows.
    #[inline]
    fn fill<T: Target>(&self, lane: usize, (owner, facet): (u16, u32), grid: &Area, target: &mut T) {
        let edges = self.edges.each_ref().map(|edge| edge.of(lane));
        let [corner_x, corner_y, nearness] = self.corner.map(|values| values[lane]);
        let [by_x, by_y] = self.slope.map(|values| values[lane]);
        let whole = |ends: [[f32; LANES]; 2]| ends.map(|values| values[lane] as i32 as usize);
        let ([x0, x1], [y0, y1]) = (whole(self.columns), whole(self.rows));
        let width = grid.x1 - grid.x0;
        for column in (x0..x1).step_by(LANES) {
            let lanes = first(x1 - column);
            let mut at = (y0 - grid.y0) * width + column - grid.x0;
            let (x, _) = target.points(y0, at);
            let parts = edges.each_ref().map(|edge| splat(edge.by_x) * x);
            let nearness_x = splat(nearness) + (x - splat(corner_x)) * splat(by_x);
            for row in y0..y1 {
                let y = row as i32 as f32 + 0.5;
                let [p, q, r] = [0, 1, 2].map(|k| {
                    let Edges { by_y, constant, bound, .. } = edges[k];
                    (parts[k] + splat(by_y * y) + splat(constant)).simd_gt(splat(bound))
                });
                let mask = (p & q & r).to_bitmask() & lanes;
                if mask != 0 {
                    let nearness = nearness_x + splat((y - corner_y) * by_y);
                    target.offer(at, mask, nearness, owner, Some(facet));
                }
                at += width;
            }
        }
    }
}

impl Corners {
    /// Of up to eight triangles; the others are a single point.
    #[inline]
    fn gather(triangles: &[[u32; 3]], corners: &[Corner]) -> Self {
        if let Some(triangles) = triangles.first_chunk::<LANES>() {
            // Four corners make the rows of a square, whose columns are their x, y and nearness.
            let [a, b, c] = [0, 1, 2].map(|k| {
                let square = |half: usize| {
                    let row = |lane: usize| f32x4::new(corners[triangles[4 * half + lane][k] as usize]);
                    f32x4::transpose([row(0), row(1), row(2), row(3)]).map(f32x4::to_array)
                };
                let (low, high) = (square(0), square(1));
                [0, 1, 2].map(|part| both(low[part], high[part]))
            });
            return Self { x: [a[0], b[0], c[0]], y: [a[1], b[1], c[1]], nearness: [a[2], b[2], c[2]] };
        }
        let mut parts = [[0.0; LANES]; 9];
        for (lane, triangle) in triangles.iter().enumerate() {
            for (k, &index) in triangle.iter().enumerate() {
                let [x, y, nearness, _] = corners[index as usize];
                parts[k][lane] = x;
                parts[3 + k][lane] = y;
                parts[6 + k][lane] = nearness;
            }
        }
        let [a, b, c, d, e, f, g, h, i] = parts.map(Lanes::new);
        Self { x: [a, b, c], y: [d, e, f], nearness: [g, h, i] }
    }
}

impl Edges<Lanes> {
    /// From `p` to `q`; those from `q` to `p` have exactly the opposite parts.
    #[inline]
    fn new(p: [Lanes; 2], q: [Lanes; 2]) -> Self {
        let zero = splat(0.0);
        let (by_x, by_y) = (p[1] - q[1], q[0] - p[0]);
        let owns = by_x.simd_gt(zero) | (by_x.simd_eq(zero) & by_y.simd_gt(zero));
        // No sum of parts of pixels lies between this and 0.
        let bound = owns.select(splat(-f32::MIN_POSITIVE), zero);
        Self { by_x, by_y, constant: p[0] * q[1] - q[0] * p[1], bound }
    }

    #[inline]
    fn to_arrays(self) -> Edges<[f32; LANES]> {
        let Self { by_x, by_y, constant, bound } = self;
        let [by_x, by_y, constant, bound] = [by_x, by_y, constant, bound].map(Lanes::to_array);
        Edges { by_x, by_y, constant, bound }
    }
}

impl Edges<[f32; LANES]> {
    /// That of one triangle.
    #[inline]
    fn of(&self, lane: usize) -> Edges<f32> {
        let Self { by_x, by_y, constant, bound } = self;
        Edges { by_x: by_x[lane], by_y: by_y[lane], constant: constant[lane], bound: bound[lane] }
    }
}

/// From which to before which of the columns (or rows) from `start` to `end` the middles lie between the corners of each.
#[inline]
fn span([a, b, c]: [Lanes; 3], start: usize, end: usize) -> (Lanes, Lanes) {
    let (half, start, end) = (splat(0.5), splat(start as f32), splat(end as f32));
    let low = a.fast_min(b).fast_min(c).fast_max(start).fast_min(end) + half;
    let high = a.fast_max(b).fast_max(c).fast_min(end).fast_max(start) + half;
    let whole = |value: Lanes| Lanes::from_i32x8(value.fast_trunc_int());
    let from = whole(low);
    let from = from - low.simd_eq(from).select(splat(1.0), splat(0.0));
    (from.fast_max(start), whole(high))
}
