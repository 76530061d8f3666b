//! The shapes of the fast style, each by its signed distance. Coordinates are canvas pixels.

use super::coverage::{Coverage, Extent, Lanes, Lens, NOWHERE, share};

/// The exact raster includes a polygon's boundary pixels: half a pixel more on every side.
pub(super) const POLYGON_GROWTH: f32 = 0.5;

/// Convex polygons of more vertices are drawn as general ones.
const MAX_EDGES: usize = 8;

/// A line scaled so that a x + b y + c is a distance in half-widths of the filter.
#[derive(Debug, Clone, Copy, Default)]
struct Side {
    a: f32,
    b: f32,
    c: f32,
    per_a: f32,
}

/// A convex polygon: the product of what its sides cover.
#[derive(Debug)]
pub(super) struct ConvexPolygon {
    sides: [Side; MAX_EDGES],
    count: usize,
}

impl ConvexPolygon {
    /// `None` if the points are not the corners of a convex polygon of at most 8 vertices, in order.
    pub(super) fn new(points: &[[f32; 2]], lens: &Lens) -> Option<Self> {
        if points.len() > MAX_EDGES || points.len() < 3 {
            return None;
        }
        let mut polygon = Self { sides: [Side::default(); MAX_EDGES], count: 0 };
        let winding = signed_area(points).signum();
        for (from, to) in edges(points) {
            let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
            let length = (dx * dx + dy * dy).sqrt();
            if length == 0.0 {
                continue;
            }
            let normal = [winding * dy / length, -winding * dx / length];
            let distance = |p: &[f32; 2]| normal[0] * (p[0] - from[0]) + normal[1] * (p[1] - from[1]);
            if !points.iter().all(|point| distance(point) < 1e-2) {
                return None;
            }
            let scale = 1.0 / lens.reach_along(normal);
            let (a, b) = (normal[0] * scale, normal[1] * scale);
            let c = -(a * from[0] + b * from[1]) - POLYGON_GROWTH * scale;
            polygon.sides[polygon.count] = Side { a, b, c, per_a: 1.0 / a };
            polygon.count += 1;
        }
        (polygon.count >= 3).then_some(polygon)
    }
}

impl Coverage for ConvexPolygon {
    #[inline(always)]
    fn extent(&self, y: f32) -> Option<Extent> {
        let mut touched = [f32::NEG_INFINITY, f32::INFINITY];
        let mut solid = touched;
        for side in &self.sides[..self.count] {
            let rest = side.b * y + side.c;
            // Where a x + rest is 1 (nothing covered beyond) and -1 (all covered before).
            if side.a.abs() < 1e-6 {
                if rest >= 1.0 {
                    return None;
                }
                if rest > -1.0 {
                    solid = NOWHERE;
                }
                continue;
            }
            let (outer, inner) = ((1.0 - rest) * side.per_a, (-1.0 - rest) * side.per_a);
            if side.a > 0.0 {
                touched[1] = touched[1].min(outer);
                solid[1] = solid[1].min(inner);
            } else {
                touched[0] = touched[0].max(outer);
                solid[0] = solid[0].max(inner);
            }
        }
        (touched[0] <= touched[1]).then_some(Extent { touched, solid })
    }

    #[inline(always)]
    fn at(&self, x: Lanes, y: f32) -> Lanes {
        let mut covered = [1.0; _];
        for side in &self.sides[..self.count] {
            for (covered, x) in covered.iter_mut().zip(x) {
                *covered *= share(side.a * x + side.b * y + side.c);
            }
        }
        covered
    }
}

/// Any polygon, by the even-odd rule and the distance to its boundary. Slower: every pixel looks at every edge.
#[derive(Debug)]
pub(super) struct Polygon<'a> {
    points: &'a [[f32; 2]],
    per_reach: f32,
}

impl<'a> Polygon<'a> {
    pub(super) fn new(points: &'a [[f32; 2]], lens: &Lens) -> Self {
        let diagonal = std::f32::consts::FRAC_1_SQRT_2;
        Self { points, per_reach: 1.0 / lens.reach_along([diagonal; 2]) }
    }
}

impl Coverage for Polygon<'_> {
    #[inline(always)]
    fn extent(&self, _: f32) -> Option<Extent> {
        Some(Extent { touched: [f32::NEG_INFINITY, f32::INFINITY], solid: NOWHERE })
    }

    #[inline(always)]
    fn at(&self, x: Lanes, y: f32) -> Lanes {
        x.map(|x| self.share_at(x, y))
    }
}

impl Polygon<'_> {
    fn share_at(&self, x: f32, y: f32) -> f32 {
        let mut inside = false;
        let mut nearest = f32::INFINITY;
        for (from, to) in edges(self.points) {
            nearest = nearest.min(squared_distance([x, y], from, to));
            let spans = (from[1] > y) != (to[1] > y);
            let crossing = || from[0] + (y - from[1]) / (to[1] - from[1]) * (to[0] - from[0]);
            inside ^= spans && x < crossing();
        }
        let distance = if inside { -nearest.sqrt() } else { nearest.sqrt() };
        share((distance - POLYGON_GROWTH) * self.per_reach)
    }
}

/// A disc.
#[derive(Debug)]
pub(super) struct Disc {
    center: [f32; 2],
    radius: f32,
    reach: [f32; 2],
}

impl Disc {
    pub(super) fn new(center: [f32; 2], radius: f32, lens: &Lens) -> Self {
        Self { center, radius, reach: lens.reach() }
    }
}

impl Coverage for Disc {
    #[inline(always)]
    fn extent(&self, y: f32) -> Option<Extent> {
        let reach = self.reach[0].max(self.reach[1]);
        let dy = y - self.center[1];
        let interval = |radius: f32| {
            let squared = radius * radius - dy * dy;
            let half = squared.max(0.0).sqrt();
            (radius > 0.0 && squared > 0.0).then_some([self.center[0] - half, self.center[0] + half])
        };
        let touched = interval(self.radius + reach)?;
        Some(Extent { touched, solid: interval(self.radius - reach).unwrap_or(NOWHERE) })
    }

    #[inline(always)]
    fn at(&self, x: Lanes, y: f32) -> Lanes {
        let dy = y - self.center[1];
        let dx = x.map(|x| x - self.center[0]);
        let distance = dx.map(|dx| (dx * dx + dy * dy).sqrt());
        let [rx, ry] = self.reach;
        if rx == ry {
            let per_reach = 1.0 / rx;
            return distance.map(|distance| strip_share(distance, self.radius, per_reach));
        }
        std::array::from_fn(|lane| {
            let (dx, distance) = (dx[lane], distance[lane]);
            let reach = match distance {
                0.0 => rx,
                _ => (dx * dx * rx * rx + dy * dy * ry * ry).sqrt() / distance,
            };
            strip_share(distance, self.radius, 1.0 / reach)
        })
    }
}

/// A segment with round ends.
#[derive(Debug)]
pub(super) struct Capsule {
    from: [f32; 2],
    along: [f32; 2],
    per_squared_length: f32,
    radius: f32,
    per_reach: f32,
    /// The strips outside of which nothing is covered: beside the line, and before and behind the segment.
    beside: Strip,
    between: Strip,
}

/// What lies between two parallel lines, as an interval of x that moves with y.
#[derive(Debug)]
struct Strip {
    /// At y = 0.
    interval: [f32; 2],
    slope: f32,
}

/// Lines that are closer to horizontal bound no interval of x.
const HORIZONTAL: f32 = 1e-3;

impl Strip {
    /// Where `low <= nx x + ny y <= high`.
    fn new([nx, ny]: [f32; 2], low: f32, high: f32) -> Self {
        if nx.abs() < HORIZONTAL {
            return Self { interval: [f32::NEG_INFINITY, f32::INFINITY], slope: 0.0 };
        }
        let (a, b) = (low / nx, high / nx);
        Self { interval: [a.min(b), a.max(b)], slope: -ny / nx }
    }

    #[inline(always)]
    fn at(&self, y: f32) -> [f32; 2] {
        self.interval.map(|x| x + self.slope * y)
    }
}

impl Capsule {
    pub(super) fn new(from: [f32; 2], to: [f32; 2], radius: f32, lens: &Lens) -> Self {
        let along = [to[0] - from[0], to[1] - from[1]];
        let squared = along[0] * along[0] + along[1] * along[1];
        let length = squared.sqrt();
        let unit = if length > 0.0 { along.map(|side| side / length) } else { [1.0, 0.0] };
        let normal = [unit[1], -unit[0]];
        let [rx, ry] = lens.reach();
        let reach = if length > 0.0 { lens.reach_along(normal) } else { rx.max(ry) };
        let per_squared_length = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        let width = radius + reach;
        let strip = |direction: [f32; 2], length: f32| {
            let start = direction[0] * from[0] + direction[1] * from[1];
            Strip::new(direction, start - width, start + length + width)
        };
        Self {
            from,
            along,
            per_squared_length,
            radius,
            per_reach: 1.0 / reach,
            beside: strip(normal, 0.0),
            between: strip(unit, length),
        }
    }
}

impl Coverage for Capsule {
    #[inline(always)]
    fn extent(&self, y: f32) -> Option<Extent> {
        let (beside, between) = (self.beside.at(y), self.between.at(y));
        let touched = [beside[0].max(between[0]), beside[1].min(between[1])];
        (touched[0] <= touched[1]).then_some(Extent { touched, solid: NOWHERE })
    }

    #[inline(always)]
    fn at(&self, x: Lanes, y: f32) -> Lanes {
        let dy = y - self.from[1];
        let [ax, ay] = self.along;
        x.map(|x| {
            let dx = x - self.from[0];
            let foot = ((dx * ax + dy * ay) * self.per_squared_length).clamp(0.0, 1.0);
            let (dx, dy) = (dx - foot * ax, dy - foot * ay);
            strip_share((dx * dx + dy * dy).sqrt(), self.radius, self.per_reach)
        })
    }
}

/// The share between two parallel edges, `radius` either side of a line at `distance`.
#[inline(always)]
fn strip_share(distance: f32, radius: f32, per_reach: f32) -> f32 {
    share((distance - radius) * per_reach) - share((distance + radius) * per_reach)
}

fn edges(points: &[[f32; 2]]) -> impl Iterator<Item = ([f32; 2], [f32; 2])> {
    let next = points.iter().cycle().skip(1);
    points.iter().copied().zip(next.copied())
}

fn signed_area(points: &[[f32; 2]]) -> f32 {
    edges(points).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum()
}

fn squared_distance(point: [f32; 2], from: [f32; 2], to: [f32; 2]) -> f32 {
    let (dx, dy) = (point[0] - from[0], point[1] - from[1]);
    let (ax, ay) = (to[0] - from[0], to[1] - from[1]);
    let squared = ax * ax + ay * ay;
    let foot = if squared > 0.0 { ((dx * ax + dy * ay) / squared).clamp(0.0, 1.0) } else { 0.0 };
    let (dx, dy) = (dx - foot * ax, dy - foot * ay);
    dx * dx + dy * dy
}
