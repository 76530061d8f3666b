//! Truly solid walls: the disc is swept along its way, stops where it first touches, and slides on with what is left of
//! its motion. However fast, it never passes through: motion is cut at the first touch before anything else is asked.

use super::plan::FloorPlan;
use super::{Aabb, Vec2, vec2};

/// Touches at most in one motion: in a corner the second ends it, a slide along a row of pieces may touch each.
const MAX_TOUCHES: usize = 12;
/// Distance below which a disc counts as touching, pixels.
const SKIN_PX: f64 = 1e-9;

/// Where the disc comes to if it wants to move by `motion`.
pub(super) fn slide(plan: &FloorPlan, from: Vec2, radius: f64, motion: Vec2) -> Vec2 {
    let (mut position, mut rest) = (from, motion);
    let mut blocked: Option<Vec2> = None;
    for _ in 0..MAX_TOUCHES {
        let hits = plan.solids().filter_map(|area| first_touch(area, position, radius, rest));
        let Some((share, outward)) = hits.reduce(|a, b| if b.0 < a.0 { b } else { a }) else {
            return position + rest;
        };
        position = position + rest * share;
        rest = rest * (1.0 - share);
        rest = rest - outward * rest.dot(outward);
        // Between two faces that both stand in the way there is nowhere to slide.
        if blocked.is_some_and(|other| other != outward && rest.dot(other) < 0.0) {
            return position;
        }
        blocked = Some(outward);
    }
    position
}

/// The nearest place to `from` where the disc overlaps nothing, or as near to that as a few rounds come.
pub(super) fn pushed_out(plan: &FloorPlan, from: Vec2, radius: f64) -> Vec2 {
    let mut position = from;
    for _ in 0..16 {
        let overlaps = plan.solids().filter_map(|area| {
            let (distance, outward) = distance(area, position);
            (distance < radius).then_some((radius - distance, outward))
        });
        match overlaps.reduce(|a, b| if b.0 > a.0 { b } else { a }) {
            None => break,
            Some((overlap, outward)) => position = position + outward * (overlap + SKIN_PX),
        }
    }
    position
}

/// How many rectangles the disc touches.
pub(super) fn count_touching(plan: &FloorPlan, position: Vec2, radius: f64) -> u32 {
    // A slide ends within rounding of the surface: a thousandth of a pixel is touching.
    plan.solids().filter(|area| distance(area, position).0 <= radius + 1e-3).count() as u32
}

/// Signed distance of a point from a rectangle, and the unit vector away from it.
fn distance(area: &Aabb, point: Vec2) -> (f64, Vec2) {
    let away = point - area.nearest(point);
    let distance = away.norm();
    if distance > 0.0 {
        return (distance, away * (1.0 / distance));
    }
    let (depth, inward) = area.nearest_face(point);
    (-depth, -inward)
}

/// The share of `motion`, 0 to 1, after which a disc that does not overlap the rectangle touches it while moving towards
/// it, and the unit vector away from the rectangle there.
fn first_touch(area: &Aabb, from: Vec2, radius: f64, motion: Vec2) -> Option<(f64, Vec2)> {
    let (gap, outward) = distance(area, from);
    if gap <= radius + SKIN_PX {
        // The grown rectangle is convex: whoever leaves it or passes along does not meet it again.
        return (motion.dot(outward) < 0.0).then_some((0.0, outward));
    }
    let share = entry(area, from, radius, motion)?;
    let at = from + motion * share;
    let nearest = area.nearest(at);
    let is_corner = nearest.x != at.x && nearest.y != at.y;
    // In front of a face, the box grown by the radius is the whole story. Beside it, the rounded corner is: whoever
    // crosses the corner's square without touching its circle has left the box.
    let share = if is_corner { circle_entry(nearest, from, radius, motion)? } else { share };
    let (_, outward) = distance(area, from + motion * share);
    (motion.dot(outward) < 0.0).then_some((share, outward))
}

/// The share of `motion` after which a point enters the box grown by `radius`: 0 if it is inside.
fn entry(area: &Aabb, from: Vec2, radius: f64, motion: Vec2) -> Option<f64> {
    let grown = Aabb { min: area.min - vec2(radius, radius), max: area.max + vec2(radius, radius) };
    let mut span = (0.0_f64, 1.0_f64);
    let axes = [(from.x, motion.x, grown.min.x, grown.max.x), (from.y, motion.y, grown.min.y, grown.max.y)];
    for (from, motion, low, high) in axes {
        if motion == 0.0 {
            if from <= low || from >= high {
                return None;
            }
            continue;
        }
        let (a, b) = ((low - from) / motion, (high - from) / motion);
        span = (span.0.max(a.min(b)), span.1.min(a.max(b)));
    }
    (span.0 < span.1).then_some(span.0)
}

/// The share of `motion` after which a point comes within `radius` of `center`.
fn circle_entry(center: Vec2, from: Vec2, radius: f64, motion: Vec2) -> Option<f64> {
    let offset = from - center;
    let (a, b) = (motion.dot(motion), motion.dot(offset));
    let c = offset.dot(offset) - radius * radius;
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || b >= 0.0 {
        return None;
    }
    // The smaller root, in the form that does not cancel.
    let share = c / (-b + discriminant.sqrt());
    (share <= 1.0).then(|| share.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::super::plan::{Axis, WALL_AT_PX};
    use super::*;
    use proptest::prelude::*;

    fn clearance(plan: &FloorPlan, at: Vec2) -> f64 {
        plan.solids().map(|area| distance(area, at).0).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn a_disc_slides_along_a_wall_and_stops_in_a_corner() {
        let plan = FloorPlan::new(Axis::Vertical, 19, &[(480, 10)]);
        let end = slide(&plan, vec2(200.0, 200.0), 15.0, vec2(100.0, 30.0));
        assert!((end.x - 227.25).abs() < 1e-6 && (end.y - 230.0).abs() < 1e-6, "{end:?}");
        let corner = slide(&plan, vec2(200.0, 30.0), 15.0, vec2(500.0, -500.0));
        assert!((corner.x - 227.25).abs() < 1e-6 && (corner.y - 17.25).abs() < 1e-6, "{corner:?}");
    }

    #[test]
    fn a_disc_rolls_around_the_edge_of_a_door() {
        // The opening is 306..392; the corner at (242.25, 306) is met at its side.
        let plan = FloorPlan::new(Axis::Vertical, 19, &[(298, 84)]);
        let end = slide(&plan, vec2(200.0, 315.0), 15.0, vec2(100.0, 0.0));
        assert!(end.x > 242.25 && end.y > 320.9, "{end:?}");
        assert!(clearance(&plan, end) > 15.0 - 1e-6);
    }

    #[test]
    fn what_overlaps_is_pushed_out() {
        let plan = FloorPlan::new(Axis::Vertical, 19, &[(298, 84)]);
        for from in [vec2(245.0, 100.0), vec2(0.0, 0.0), vec2(250.0, 300.0), vec2(511.0, 511.0)] {
            assert!(clearance(&plan, pushed_out(&plan, from, 20.0)) > 20.0 - 1e-6, "{from:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn no_motion_however_fast_goes_through(
            horizontal: bool,
            thickness in 9i64..=33,
            doors in proptest::collection::vec((0i64..494, 10i64..=99), 1..=3),
            radius in 15.0..30.0f64,
            start in (40.0..210.0f64, 40.0..470.0f64),
            motions in proptest::collection::vec((-900.0..900.0f64, -900.0..900.0f64), 1..20),
        ) {
            let axis = if horizontal { Axis::Horizontal } else { Axis::Vertical };
            let plan = FloorPlan::new(axis, thickness, &doors);
            let openings: Vec<_> = plan.openings().collect();
            let mut at = pushed_out(&plan, axis.join(start.0, start.1), radius);
            prop_assume!(clearance(&plan, at) >= radius);
            for (x, y) in motions {
                let before = at;
                at = slide(&plan, at, radius, vec2(x, y));
                prop_assert!(clearance(&plan, at) > radius - 1e-6, "{before:?} to {at:?}");
                prop_assert!((0.0..512.0).contains(&at.x) && (0.0..512.0).contains(&at.y), "{at:?} is outside");
                let crossed = (axis.split(before).0 < WALL_AT_PX) != (axis.split(at).0 < WALL_AT_PX);
                let fits = openings.iter().any(|opening| opening.to - opening.from >= 2.0 * radius);
                prop_assert!(!crossed || fits, "{before:?} to {at:?} without a door that is wide enough");
            }
        }

        #[test]
        fn free_motion_is_untouched(x in 60.0..180.0f64, y in 60.0..440.0f64, dx in -40.0..40.0f64, dy in -40.0..40.0f64) {
            let plan = FloorPlan::new(Axis::Vertical, 19, &[(247, 75)]);
            prop_assert_eq!(slide(&plan, vec2(x, y), 15.0, vec2(dx, dy)), vec2(x, y) + vec2(dx, dy));
        }
    }
}
