//! Narrow phase: contact points and normal of one pair of shapes.
//!
//! `collide_A_B` names the first shape A and the second B; the normal points from A to B. All polygons are
//! rectangles, so a distance is found in the rectangle's own axes: exactly, and without iteration. Contacts exist
//! only where the shapes touch; there are no speculative ones.

use super::math::{Rotation, Vec2, vec2};
use super::world::{WALL_NORMALS, WALL_RADIUS, WALL_SEGMENTS};

/// A rectangle in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedRectangle {
    pub(super) center: Vec2,
    pub(super) half: Vec2,
    pub(super) rotation: Rotation,
}

/// Where two shapes touch: one or two points and their common normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Manifold {
    /// Unit vector from the first shape to the second.
    pub(super) normal: Vec2,
    pub(super) points: [Point; 2],
    pub(super) len: usize,
}

/// One contact: a point on either shape, and which of their vertices made it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) on_first: Vec2,
    pub(super) on_second: Vec2,
    pub(super) feature: Feature,
}

/// The identity of a contact over time: a vertex of the first and one of the second shape, in hull order (a wall's
/// ends are 0 and 1; a disc has only the vertex 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Feature {
    pub(super) first: u8,
    pub(super) second: u8,
}

/// A directed edge that may touch, with the hull indices of its ends.
#[derive(Clone, Copy)]
struct Edge {
    a: Vec2,
    b: Vec2,
    a_index: u8,
    b_index: u8,
}

/// Disc against rectangle. The disc counts as one vertex; there is at most one contact.
pub(super) fn collide_disc_rectangle(
    center: Vec2,
    radius: f64,
    rectangle: &PlacedRectangle,
) -> Option<Manifold> {
    let PlacedRectangle { half, rotation, .. } = *rectangle;
    let q = rotation.body_from_world(center - rectangle.center);
    let (outward, distance) = outward_and_distance(q, half);
    if distance > radius {
        return None;
    }
    let normal = -rotation.world_from_body(outward);
    let point = Point {
        on_first: center + normal * radius,
        on_second: center + normal * distance,
        feature: Feature::default(),
    };
    Some(Manifold { normal, points: [point; 2], len: 1 })
}

/// Rectangle against rectangle. They touch only if they overlap, so the axis of least overlap is all that is needed.
pub(super) fn collide_rectangle_rectangle(
    first: &PlacedRectangle,
    second: &PlacedRectangle,
) -> Option<Manifold> {
    let (separation_first, face_first) = widest_gap(first, second);
    if separation_first > 0.0 {
        return None;
    }
    let (separation_second, face_second) = widest_gap(second, first);
    if separation_second > 0.0 {
        return None;
    }
    let normal = if separation_second > separation_first { -face_second } else { face_first };
    clip(normal, touching_edge(first, normal), 0.0, touching_edge(second, -normal), 0.0)
}

/// Wall against rectangle.
pub(super) fn collide_wall_rectangle(wall: usize, rectangle: &PlacedRectangle) -> Option<Manifold> {
    let wall_normal = WALL_NORMALS[wall];
    let (from, to) = (Vec2::from(WALL_SEGMENTS[wall].from), Vec2::from(WALL_SEGMENTS[wall].to));
    let PlacedRectangle { center, half, rotation } = *rectangle;

    let side = wall_normal.dot(center - from);
    let local_normal = rotation.body_from_world(wall_normal);
    let extent = half.x * local_normal.x.abs() + half.y * local_normal.y.abs();
    let wall_separation = side.abs() - extent;
    if wall_separation > WALL_RADIUS {
        return None;
    }
    let toward = if side >= 0.0 { wall_normal } else { -wall_normal };
    let (a, b) = (rotation.body_from_world(from - center), rotation.body_from_world(to - center));
    let (separation, face) = segment_gap(a, b, half);
    if separation > WALL_RADIUS {
        return None;
    }
    let normal = if separation <= 0.0 && wall_separation <= 0.0 {
        if separation > wall_separation { -rotation.world_from_body(face) } else { toward }
    } else {
        let (normal, distance) = nearest_direction(wall, [a, b], rectangle);
        if distance > WALL_RADIUS {
            return None;
        }
        normal
    };
    let wall_edge = if wall_normal.dot(normal) > 0.0 {
        Edge { a: from, b: to, a_index: 0, b_index: 1 }
    } else {
        Edge { a: to, b: from, a_index: 1, b_index: 0 }
    };
    clip(normal, wall_edge, WALL_RADIUS, touching_edge(rectangle, -normal), 0.0)
}

/// The face of `of` that keeps the largest signed distance from `other`: that distance and the outward normal.
fn widest_gap(of: &PlacedRectangle, other: &PlacedRectangle) -> (f64, Vec2) {
    let q = of.rotation.body_from_world(other.center - of.center);
    let cos = of.rotation.cos * other.rotation.cos + of.rotation.sin * other.rotation.sin;
    let sin = of.rotation.cos * other.rotation.sin - of.rotation.sin * other.rotation.cos;
    let (cos, sin) = (cos.abs(), sin.abs());
    let gap_x = q.x.abs() - of.half.x - (cos * other.half.x + sin * other.half.y);
    let gap_y = q.y.abs() - of.half.y - (sin * other.half.x + cos * other.half.y);
    let (gap, face) = if gap_x > gap_y {
        (gap_x, vec2(if q.x < 0.0 { -1.0 } else { 1.0 }, 0.0))
    } else {
        (gap_y, vec2(0.0, if q.y > 0.0 { 1.0 } else { -1.0 }))
    };
    (gap, of.rotation.world_from_body(face))
}

/// The face of a rectangle around the origin that keeps the largest signed distance from the segment `a`-`b`, all in
/// the rectangle's axes.
fn segment_gap(a: Vec2, b: Vec2, half: Vec2) -> (f64, Vec2) {
    let faces = [
        (-a.y.max(b.y) - half.y, vec2(0.0, -1.0)),
        (a.x.min(b.x) - half.x, vec2(1.0, 0.0)),
        (a.y.min(b.y) - half.y, vec2(0.0, 1.0)),
        (-a.x.max(b.x) - half.x, vec2(-1.0, 0.0)),
    ];
    let mut widest = faces[0];
    for face in &faces[1..] {
        if face.0 > widest.0 {
            widest = *face;
        }
    }
    widest
}

/// Direction and distance from the closest point of a wall's segment to that of a rectangle that does not overlap it.
/// The closest pair has a vertex on one side, so all vertices of both are tried.
fn nearest_direction(wall: usize, ends: [Vec2; 2], rectangle: &PlacedRectangle) -> (Vec2, f64) {
    let PlacedRectangle { center, half, rotation } = *rectangle;
    let wall_normal = WALL_NORMALS[wall];
    let (from, to) = (Vec2::from(WALL_SEGMENTS[wall].from), Vec2::from(WALL_SEGMENTS[wall].to));
    let along = to - from;
    let length_squared = along.dot(along);

    let mut best = (wall_normal, f64::INFINITY);
    for corner in [vec2(-1.0, -1.0), vec2(1.0, -1.0), vec2(1.0, 1.0), vec2(-1.0, 1.0)] {
        let vertex = center + rotation.world_from_body(vec2(corner.x * half.x, corner.y * half.y));
        let t = along.dot(vertex - from) / length_squared;
        let candidate = if t > 0.0 && t < 1.0 {
            let side = wall_normal.dot(vertex - from);
            (if side >= 0.0 { wall_normal } else { -wall_normal }, side.abs())
        } else {
            unit_and_length(vertex - if t <= 0.0 { from } else { to })
        };
        if candidate.1 < best.1 {
            best = candidate;
        }
    }
    for q in ends {
        let (outward, distance) = outward_and_distance(q, half);
        if distance < best.1 {
            best = (-rotation.world_from_body(outward), distance);
        }
    }
    best
}

/// From a rectangle around the origin to a point `q`, in the rectangle's axes: the direction from the closest point of
/// the rectangle, and the distance. For a point inside: the outward normal of the closest face, and minus the depth.
fn outward_and_distance(q: Vec2, half: Vec2) -> (Vec2, f64) {
    let beyond = vec2(q.x.abs() - half.x, q.y.abs() - half.y);
    let sign_x = if q.x < 0.0 { -1.0 } else { 1.0 };
    let sign_y = if q.y > 0.0 { 1.0 } else { -1.0 };
    if beyond.x > 0.0 && beyond.y > 0.0 {
        unit_and_length(vec2(sign_x * beyond.x, sign_y * beyond.y))
    } else if beyond.x > beyond.y {
        (vec2(sign_x, 0.0), beyond.x)
    } else {
        (vec2(0.0, sign_y), beyond.y)
    }
}

fn unit_and_length(v: Vec2) -> (Vec2, f64) {
    let length = v.norm();
    (v * (1.0 / length), length)
}

/// The edge of a rectangle that faces a direction: at the vertex farthest along it, the edge whose normal agrees
/// better (the one that starts there, if both agree equally).
fn touching_edge(rectangle: &PlacedRectangle, direction: Vec2) -> Edge {
    let u = rectangle.rotation.body_from_world(direction);
    // Hull order: vertex 0 (-,-), 1 (+,-), 2 (+,+), 3 (-,+); edge i runs from vertex i to i + 1.
    let vertex = match (u.x > 0.0, u.y > 0.0) {
        (false, false) => 0,
        (true, false) => 1,
        (true, true) => 2,
        // Along +y both 2 and 3 are farthest: the smaller index wins, as it does in the other ties.
        (false, true) if u.x == 0.0 => 2,
        (false, true) => 3,
    };
    let (along_x, along_y) = (u.x.abs(), u.y.abs());
    // The edges that end at vertices 0 and 2 have normals along x, those that end at 1 and 3 along y.
    let (ending, starting) = if vertex % 2 == 0 { (along_x, along_y) } else { (along_y, along_x) };
    let start = if ending > starting { (vertex + 3) % 4 } else { vertex };
    let end = (start + 1) % 4;
    Edge { a: rectangle.vertex(start), b: rectangle.vertex(end), a_index: start, b_index: end }
}

impl PlacedRectangle {
    /// World position of a vertex by its hull index.
    pub(super) fn vertex(&self, index: u8) -> Vec2 {
        let x = if index == 1 || index == 2 { self.half.x } else { -self.half.x };
        let y = if index >= 2 { self.half.y } else { -self.half.y };
        self.center + self.rotation.world_from_body(vec2(x, y))
    }
}

/// Contacts of two edges that face each other: the ends of their common stretch. Those without overlap are dropped.
fn clip(normal: Vec2, first: Edge, radius_first: f64, second: Edge, radius_second: f64) -> Option<Manifold> {
    let (a1, b1) = (first.a.cross(normal), first.b.cross(normal));
    let (a2, b2) = (second.a.cross(normal), second.b.cross(normal));
    let at = |edge: &Edge, from: f64, to: f64, t: f64| {
        let k = (t - from) / (to - from + f64::MIN_POSITIVE);
        edge.a + (edge.b - edge.a) * k.clamp(0.0, 1.0)
    };
    let candidates = [
        Point {
            on_first: at(&first, a1, b1, b2) + normal * radius_first,
            on_second: at(&second, a2, b2, a1) - normal * radius_second,
            feature: Feature { first: first.a_index, second: second.b_index },
        },
        Point {
            on_first: at(&first, a1, b1, a2) + normal * radius_first,
            on_second: at(&second, a2, b2, b1) - normal * radius_second,
            feature: Feature { first: first.b_index, second: second.a_index },
        },
    ];
    let mut manifold = Manifold { normal, points: candidates, len: 0 };
    for point in candidates {
        if (point.on_second - point.on_first).dot(normal) <= 0.0 {
            manifold.points[manifold.len] = point;
            manifold.len += 1;
        }
    }
    (manifold.len > 0).then_some(manifold)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_4;

    fn rectangle(x: f64, y: f64, half: f64, angle: f64) -> PlacedRectangle {
        PlacedRectangle { center: vec2(x, y), half: vec2(half, half), rotation: Rotation::new(angle) }
    }

    fn assert_near(a: Vec2, b: Vec2) {
        assert!((a - b).norm() < 1e-12, "{a:?} is not near {b:?}");
    }

    #[test]
    fn a_disc_meets_faces_and_corners_from_outside_and_inside() {
        let square = rectangle(100.0, 100.0, 10.0, 0.0);
        let face = collide_disc_rectangle(vec2(85.0, 103.0), 6.0, &square).unwrap();
        assert_near(face.normal, vec2(1.0, 0.0));
        assert_near(face.points[0].on_second, vec2(90.0, 103.0));
        assert_near(face.points[0].on_first, vec2(91.0, 103.0));

        let corner = collide_disc_rectangle(vec2(87.0, 86.0), 6.0, &square).unwrap();
        assert_near(corner.normal, vec2(0.6, 0.8));
        assert_near(corner.points[0].on_second, vec2(90.0, 90.0));
        assert!(collide_disc_rectangle(vec2(87.0, 86.0), 4.9, &square).is_none());

        let inside = collide_disc_rectangle(vec2(93.0, 101.0), 6.0, &square).unwrap();
        assert_near(inside.normal, vec2(1.0, 0.0));
        assert_near(inside.points[0].on_second, vec2(90.0, 101.0));
    }

    #[test]
    fn rectangles_meet_along_their_common_stretch() {
        let (left, right) = (rectangle(100.0, 100.0, 10.0, 0.0), rectangle(119.0, 105.0, 10.0, 0.0));
        let manifold = collide_rectangle_rectangle(&left, &right).unwrap();
        assert_near(manifold.normal, vec2(1.0, 0.0));
        assert_eq!(manifold.len, 2);
        let mut ends = manifold.points.map(|point| (point.on_first, point.on_second));
        ends.sort_by(|a, b| a.0.y.total_cmp(&b.0.y));
        assert_near(ends[0].0, vec2(110.0, 95.0));
        assert_near(ends[0].1, vec2(109.0, 95.0));
        assert_near(ends[1].0, vec2(110.0, 110.0));
        assert!(collide_rectangle_rectangle(&left, &rectangle(120.1, 100.0, 10.0, 0.0)).is_none());

        let swapped = collide_rectangle_rectangle(&right, &left).unwrap();
        assert_near(swapped.normal, vec2(-1.0, 0.0));
        // The same two contacts in the other order, known by the same vertices.
        assert_near(swapped.points[0].on_second, manifold.points[1].on_first);
        assert_eq!(swapped.points[0].feature.first, manifold.points[1].feature.second);
        assert_eq!(swapped.points[0].feature.second, manifold.points[1].feature.first);
    }

    #[test]
    fn a_vertex_meets_a_wall_within_its_radius() {
        // The left wall's segment is at x = 5; the vertex is 1 px from it.
        let tilted = rectangle(6.0 + 10.0 * 2.0_f64.sqrt(), 250.0, 10.0, FRAC_PI_4);
        let manifold = collide_wall_rectangle(0, &tilted).unwrap();
        assert_near(manifold.normal, vec2(1.0, 0.0));
        assert_eq!(manifold.len, 1);
        assert_near(manifold.points[0].on_first, vec2(7.0, 250.0));
        assert_near(manifold.points[0].on_second, vec2(6.0, 250.0));
        let apart = rectangle(7.1 + 10.0 * 2.0_f64.sqrt(), 250.0, 10.0, FRAC_PI_4);
        assert!(collide_wall_rectangle(0, &apart).is_none());
    }

    #[test]
    fn a_face_rests_on_a_wall_with_two_points() {
        let manifold = collide_wall_rectangle(3, &rectangle(300.0, 494.5, 10.0, 0.0)).unwrap();
        assert_near(manifold.normal, vec2(0.0, -1.0));
        assert_eq!(manifold.len, 2);
        for point in manifold.points {
            assert!((point.on_first.y - 504.0).abs() < 1e-12 && (point.on_second.y - 504.5).abs() < 1e-12);
        }
    }

    #[test]
    fn a_vertex_beyond_the_end_of_a_wall_meets_its_round_cap() {
        // Outside the top right corner: the nearest point of both walls is their end (506, 5).
        let beyond = rectangle(506.9 + 10.0, 3.8 - 10.0, 10.0, 0.0);
        let manifold = collide_wall_rectangle(1, &beyond).unwrap();
        assert_near(manifold.normal, vec2(0.6, -0.8));
        assert!(collide_wall_rectangle(1, &rectangle(517.6, -7.0, 10.0, 0.0)).is_none());
    }

    #[test]
    fn the_touching_edge_faces_the_direction() {
        let square = rectangle(0.0, 0.0, 1.0, 0.0);
        let ends = |x: f64, y: f64| {
            let edge = touching_edge(&square, vec2(x, y));
            (edge.a_index, edge.b_index)
        };
        assert_eq!(
            [ends(0.0, -1.0), ends(1.0, 0.0), ends(0.0, 1.0), ends(-1.0, 0.0)],
            [(0, 1), (1, 2), (2, 3), (3, 0)]
        );
        assert_eq!([ends(0.9, -0.1), ends(0.1, -0.9)], [(1, 2), (0, 1)]);
    }
}
