//! Coarser versions of a mesh: edges collapse, the least visible first (Garland & Heckbert, *Surface Simplification Using
//! Quadric Error Metrics*, SIGGRAPH 1997). Flat parts lose nearly all of their triangles, round ones as many as the eye
//! allows.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use super::mesh::Level;
use super::vector::{Vector, add, cross, dot, length, scale, sub, wide};

/// The sum of squared distances to planes: a form of degree two in the point. Planes count alike, whatever their size, and
/// the sum is not divided: no plane's distance is hidden by others.
#[derive(Clone, Copy, Debug, Default)]
struct Quadric {
    /// Upper triangle of the matrix of normals; the offset times normals; the squared offset.
    square: [f64; 6],
    linear: Vector,
    constant: f64,
}

/// An edge that may collapse: squared error, its ends, and how often the ends had changed when that was computed.
type Candidate = Reverse<(u64, u32, u32, u32, u32)>;

/// A mesh that loses edges.
struct Shrinking {
    points: Vec<Vector>,
    quadrics: Vec<Quadric>,
    /// How often each point has changed; points that are gone have none of the triangles.
    changes: Vec<u32>,
    around: Vec<Vec<u32>>,
    triangles: Vec<Option<[u32; 3]>>,
    candidates: BinaryHeap<Candidate>,
    /// Into which point each has been merged; itself: into none.
    merged: Vec<u32>,
}

/// Errors are measured at so many points, or up to twice as many.
const MEASURED: usize = 1000;
/// What the squared length of an edge adds to its error.
const PATIENCE: f64 = 1e-7;
/// A triangle may turn so far in one step: cosine.
const TURN: f64 = 0.3;

/// Versions of `full` in which no part is farther than each of `tolerances` (meters, ascending) from where it was, each with
/// the index of its tolerance. A version that saves little is not worth its memory and is left out.
pub(super) fn levels(full: &Level, tolerances: &[f32]) -> Vec<(usize, Level)> {
    let mut mesh = Shrinking::new(full);
    let mut levels = Vec::new();
    let mut last = full.triangles.len();
    for (index, &tolerance) in tolerances.iter().enumerate() {
        mesh.collapse_up_to(f64::from(tolerance) * f64::from(tolerance));
        let count = mesh.triangles.iter().flatten().count();
        if count * 4 < last * 3 {
            levels.push((index, mesh.level(full)));
            last = count;
        }
    }
    levels
}

impl Quadric {
    /// The plane through a point; `normal` of length 1.
    fn of_plane(normal: Vector, through: Vector) -> Self {
        let offset = -dot(normal, through);
        let [x, y, z] = normal;
        let square = [x * x, x * y, x * z, y * y, y * z, z * z];
        Self { square, linear: scale(normal, offset), constant: offset * offset }
    }

    fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        sum.square.iter_mut().zip(other.square).for_each(|(a, b)| *a += b);
        sum.linear = add(sum.linear, other.linear);
        sum.constant += other.constant;
        sum
    }

    /// The sum for a point.
    fn at(&self, point: Vector) -> f64 {
        let [x, y, z] = point;
        let [xx, xy, xz, yy, yz, zz] = self.square;
        let squares = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z);
        (squares + 2.0 * dot(self.linear, point) + self.constant).max(0.0)
    }
}

impl Shrinking {
    fn new(full: &Level) -> Self {
        let points: Vec<Vector> = full.points.iter().map(|point| wide(*point)).collect();
        let count = points.len();
        let mut mesh = Self {
            points,
            quadrics: vec![Quadric::default(); count],
            changes: vec![0; count],
            around: vec![Vec::new(); count],
            triangles: full.triangles.iter().copied().map(Some).collect(),
            candidates: BinaryHeap::new(),
            merged: (0..count as u32).collect(),
        };
        // Each edge with how many triangles it has; ordered, so that nothing depends on the order of a hash.
        let mut edges: BTreeMap<[u32; 2], (u32, usize)> = BTreeMap::new();
        for (index, corners) in full.triangles.iter().enumerate() {
            let [a, b, c] = *corners;
            if a == b || b == c || c == a {
                mesh.triangles[index] = None;
                continue;
            }
            let normal = mesh.normal(*corners);
            let twice = length(normal);
            for corner in [a, b, c] {
                mesh.around[corner as usize].push(index as u32);
                if twice > 0.0 {
                    let plane = Quadric::of_plane(scale(normal, 1.0 / twice), mesh.points[a as usize]);
                    mesh.quadrics[corner as usize] = mesh.quadrics[corner as usize].plus(&plane);
                }
            }
            for [p, q] in [[a, b], [b, c], [c, a]] {
                edges.entry([p.min(q), p.max(q)]).or_insert((0, index)).0 += 1;
            }
        }
        for (&[p, q], &(count, triangle)) in &edges {
            if count == 1 {
                mesh.hold_rim([p, q], full.triangles[triangle]);
            }
        }
        for &[p, q] in edges.keys() {
            mesh.consider(p, q);
        }
        mesh
    }

    /// The normal of a triangle, twice as long as the triangle is large.
    fn normal(&self, corners: [u32; 3]) -> Vector {
        let [a, b, c] = corners.map(|corner| self.points[corner as usize]);
        cross(sub(b, a), sub(c, a))
    }

    /// Keeps an edge of one triangle in its place: a plane through it, across the triangle.
    fn hold_rim(&mut self, ends: [u32; 2], corners: [u32; 3]) {
        let [from, to] = ends.map(|end| self.points[end as usize]);
        let along = sub(to, from);
        let across = cross(along, self.normal(corners));
        let wide = length(across);
        if wide > 0.0 {
            let plane = Quadric::of_plane(scale(across, 1.0 / wide), from);
            for end in ends {
                self.quadrics[end as usize] = self.quadrics[end as usize].plus(&plane);
            }
        }
    }

    /// Where the ends of an edge meet best, and the error there.
    fn meeting(&self, p: u32, q: u32) -> (Vector, f64) {
        let (from, to) = (self.points[p as usize], self.points[q as usize]);
        let quadric = self.quadrics[p as usize].plus(&self.quadrics[q as usize]);
        let middle = scale(add(from, to), 0.5);
        [from, to, middle]
            .map(|point| (point, quadric.at(point)))
            .into_iter()
            .reduce(|best, other| if other.1 < best.1 { other } else { best })
            .unwrap_or((middle, f64::INFINITY))
    }

    fn consider(&mut self, p: u32, q: u32) {
        let (p, q) = (p.min(q), p.max(q));
        // Of edges that cost alike, as in a flat part, the shortest first: long ones make points with many neighbors.
        let way = sub(self.points[q as usize], self.points[p as usize]);
        let error = self.meeting(p, q).1 + PATIENCE * dot(way, way);
        // Positive values are ordered as their bits are.
        let changes = [p, q].map(|end| self.changes[end as usize]);
        self.candidates.push(Reverse((error.to_bits(), p, q, changes[0], changes[1])));
    }

    fn collapse_up_to(&mut self, error: f64) {
        while let Some(&Reverse((bits, p, q, of_p, of_q))) = self.candidates.peek() {
            if f64::from_bits(bits) > error {
                return;
            }
            self.candidates.pop();
            let is_current = self.changes[p as usize] == of_p && self.changes[q as usize] == of_q;
            if is_current {
                self.collapse(p, q);
            }
        }
    }

    /// Makes one point of the two ends of an edge, unless a triangle would turn over.
    fn collapse(&mut self, p: u32, q: u32) {
        let (place, _) = self.meeting(p, q);
        let both = [p, q].map(|end| std::mem::take(&mut self.around[end as usize]));
        let turns_over = both.iter().flatten().any(|&index| {
            let Some(corners) = self.triangles[index as usize] else { return false };
            if corners.contains(&p) && corners.contains(&q) {
                return false;
            }
            let before = self.normal(corners);
            let moved = corners
                .map(|corner| if corner == p || corner == q { place } else { self.points[corner as usize] });
            let after = cross(sub(moved[1], moved[0]), sub(moved[2], moved[0]));
            dot(before, after) <= TURN * length(before) * length(after)
        });
        let [of_p, of_q] = both;
        if turns_over {
            (self.around[p as usize], self.around[q as usize]) = (of_p, of_q);
            return;
        }
        let mut around = of_p;
        for index in of_q {
            if let Some(corners) = &mut self.triangles[index as usize] {
                if corners.contains(&p) {
                    self.triangles[index as usize] = None;
                } else {
                    corners.iter_mut().filter(|corner| **corner == q).for_each(|corner| *corner = p);
                    around.push(index);
                }
            }
        }
        around.retain(|&index| self.triangles[index as usize].is_some());
        self.points[p as usize] = place;
        self.merged[q as usize] = p;
        self.quadrics[p as usize] = self.quadrics[p as usize].plus(&self.quadrics[q as usize]);
        self.changes[p as usize] += 1;
        self.changes[q as usize] += 1;
        let mut neighbors: Vec<u32> =
            around.iter().filter_map(|&index| self.triangles[index as usize]).flatten().collect();
        self.around[p as usize] = around;
        neighbors.sort_unstable();
        neighbors.dedup();
        for other in neighbors.into_iter().filter(|&other| other != p) {
            self.consider(p, other);
        }
    }

    /// How far points of the full mesh are from what is left, but for one in a hundred: deep holes, which close. Of large
    /// meshes, of some of their points.
    fn error(&self, full: &Level) -> f32 {
        let every = (full.points.len() / MEASURED).max(1);
        let points = (0..).zip(&full.points).step_by(every);
        let mut errors: Vec<f64> = points.map(|(index, point)| self.moved(index, *point)).collect();
        let Some(last) = errors.len().checked_sub(1) else { return 0.0 };
        let (_, error, _) = errors.select_nth_unstable_by(last * 99 / 100, f64::total_cmp);
        error.sqrt() as f32
    }

    /// The squared distance of a point of the full mesh from the triangles around the point that it was merged into.
    fn moved(&self, index: u32, point: [f32; 3]) -> f64 {
        let mut at = index;
        while self.merged[at as usize] != at {
            at = self.merged[at as usize];
        }
        let (point, meeting) = (wide(point), self.points[at as usize]);
        let way = sub(point, meeting);
        let around =
            self.around[at as usize].iter().filter_map(|&triangle| self.triangles[triangle as usize]);
        around
            .map(|corners| squared_distance(point, corners.map(|corner| self.points[corner as usize])))
            .fold(dot(way, way), f64::min)
    }

    /// What is left, with the corner normals that the triangles had.
    fn level(&self, full: &Level) -> Level {
        let mut level = Level { most: full.most, error: self.error(full), ..Level::default() };
        let mut place_of = vec![u32::MAX; self.points.len()];
        for (corners, normals) in self.triangles.iter().zip(&full.normals) {
            let Some(corners) = corners else { continue };
            level.triangles.push(corners.map(|corner| {
                let place = &mut place_of[corner as usize];
                if *place == u32::MAX {
                    *place = level.points.len() as u32;
                    level.points.push(self.points[corner as usize].map(|value| value as f32));
                }
                *place
            }));
            level.normals.push(*normals);
        }
        level.is_closed = level.encloses();
        level
    }
}

/// The squared distance of a point from a triangle (Ericson, *Real-Time Collision Detection*, section 5.1.5); NaN from one
/// without an area.
fn squared_distance(p: Vector, [a, b, c]: [Vector; 3]) -> f64 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let to = |near: Vector| {
        let way = sub(p, near);
        dot(way, way)
    };
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return to(a);
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return to(b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return to(add(a, scale(ab, d1 / (d1 - d3))));
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return to(c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return to(add(a, scale(ac, d2 / (d2 - d6))));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return to(add(b, scale(sub(c, b), share)));
    }
    let whole = va + vb + vc;
    to(add(a, add(scale(ab, vb / whole), scale(ac, vc / whole))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_end_at_faces_edges_and_corners() {
        let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        for (point, squared) in [
            ([1.0, 1.0, 3.0], 9.0),
            ([1.0, 1.0, 0.0], 0.0),
            ([2.0, -2.0, 1.0], 5.0),
            ([-3.0, 2.0, 0.0], 9.0),
            ([4.0, 4.0, 1.0], 9.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([6.0, -1.0, 2.0], 9.0),
            ([-1.0, 7.0, 0.0], 10.0),
        ] {
            for turn in 0..3 {
                let corners = [0, 1, 2].map(|k| triangle[(k + turn) % 3]);
                assert!((squared_distance(point, corners) - squared).abs() < 1e-12, "{point:?} {turn}");
            }
        }
    }
}
