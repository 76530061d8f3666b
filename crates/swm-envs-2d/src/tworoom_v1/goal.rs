//! The goal of TwoRoom: overlap of two discs, compared as regular 64-gons as the reference does; and a cost for planners.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use super::physics::{Sim, Vec2, vec2};
use crate::pusht::physics::Rotation;

/// Corners of the polygon that stands for a disc.
const CORNERS: usize = 64;
/// Share of either disc that must be covered.
const SUCCESS_SHARE: f64 = 0.5;
/// Pixels that count for a way that does not exist: planners still prefer to be near a wall's right place.
const NO_WAY_PX: f64 = 512.0;

/// Where agent and goal overlap, as shares of either's area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Overlap {
    /// Share of the goal's area.
    pub of_goal: f64,
    /// Share of the agent's area.
    pub of_agent: f64,
}

impl Overlap {
    /// The overlap of an agent with a goal; centers and radii in pixels.
    pub fn new(agent: [f64; 2], agent_radius: f64, goal: [f64; 2], goal_radius: f64) -> Overlap {
        let (agent, goal) = (Vec2::from(agent), Vec2::from(goal));
        let far = (agent - goal).norm() >= agent_radius + goal_radius;
        let shared = if far { 0.0 } else { shared_area((agent, agent_radius), (goal, goal_radius)) };
        // Rounding must not make a share larger than 1.
        let share = |radius| (shared / area(radius)).min(1.0);
        Overlap { of_goal: share(goal_radius), of_agent: share(agent_radius) }
    }

    /// Whether half of either disc is covered.
    pub fn is_success(&self) -> bool {
        self.of_goal >= SUCCESS_SHARE || self.of_agent >= SUCCESS_SHARE
    }
}

/// The corners of the polygon of radius 1 about the origin.
static UNIT: LazyLock<[Vec2; CORNERS]> = LazyLock::new(|| {
    std::array::from_fn(|corner| {
        Rotation::new(corner as f64 * TAU / CORNERS as f64).world_from_body(vec2(1.0, 0.0))
    })
});

fn area(radius: f64) -> f64 {
    let [_, second, ..] = *UNIT;
    0.5 * CORNERS as f64 * radius * radius * second.y
}

/// The area of the intersection of two polygons of 64 corners, by clipping one at every edge of the other.
fn shared_area((center, radius): (Vec2, f64), (other, other_radius): (Vec2, f64)) -> f64 {
    let mut polygon = Polygon::new();
    UNIT.iter().for_each(|&corner| polygon.push(center + corner * radius));
    for edge in 0..CORNERS {
        let from = other + UNIT[edge] * other_radius;
        let to = other + UNIT[(edge + 1) % CORNERS] * other_radius;
        polygon = polygon.clipped(from, to - from);
    }
    polygon.area()
}

/// A convex polygon without allocation: each clip adds at most one corner.
struct Polygon {
    corners: [Vec2; 2 * CORNERS + 2],
    len: usize,
}

impl Polygon {
    fn new() -> Polygon {
        Polygon { corners: [Vec2::ZERO; 2 * CORNERS + 2], len: 0 }
    }

    fn push(&mut self, corner: Vec2) {
        self.corners[self.len] = corner;
        self.len += 1;
    }

    fn edges(&self) -> impl Iterator<Item = (Vec2, Vec2)> {
        let corners = &self.corners[..self.len];
        corners.iter().copied().zip(corners.iter().cycle().skip(1).copied())
    }

    /// The part to the left of a line: where its direction, turned by a right angle, points.
    fn clipped(self, from: Vec2, along: Vec2) -> Polygon {
        let side = |point: Vec2| along.cross(point - from);
        if self.corners[..self.len].iter().all(|&corner| side(corner) >= 0.0) {
            return self;
        }
        let mut left = Polygon::new();
        for (corner, next) in self.edges() {
            let (a, b) = (side(corner), side(next));
            if a >= 0.0 {
                left.push(corner);
            }
            if (a < 0.0) != (b < 0.0) {
                left.push(corner + (next - corner) * (a / (a - b)));
            }
        }
        left
    }

    fn area(&self) -> f64 {
        0.5 * self.edges().map(|(a, b)| a.cross(b)).sum::<f64>()
    }
}

/// How far the task is from done, for planners: the length of the agent's way to the goal, pixels. Where a wall stands
/// between them it leads through the opening that makes it shortest, of those that the agent fits through.
pub(super) fn task_cost(sim: &Sim, goal: Vec2) -> f64 {
    let setup = sim.setup();
    let plan = &setup.plan;
    let agent = sim.position();
    let straight = (goal - agent).norm();
    let ((a_across, a_along), (g_across, g_along)) = (plan.axis.split(agent), plan.axis.split(goal));
    let wall = super::physics::WALL_AT_PX;
    if (a_across - wall) * (g_across - wall) >= 0.0 {
        return straight;
    }
    let crossing = a_along + (g_along - a_along) * (wall - a_across) / (g_across - a_across);
    let ways = plan.openings().filter_map(|opening| {
        let (low, high) = (opening.from + setup.radius, opening.to - setup.radius);
        (low <= high).then(|| {
            let gate = plan.axis.join(wall, crossing.clamp(low, high));
            (gate - agent).norm() + (goal - gate).norm()
        })
    });
    ways.reduce(f64::min).unwrap_or(straight + NO_WAY_PX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_equal_discs_is_covered_at_the_published_distance() {
        let at = |distance: f64| Overlap::new([100.0, 100.0], 15.0, [100.0 + distance, 100.0], 15.0);
        assert!(at(0.80728 * 15.0 - 1e-3).is_success());
        assert!(!at(0.80728 * 15.0 + 1e-3).is_success());
        assert!(at(0.0).of_goal <= 1.0 && at(0.0).of_agent > 1.0 - 1e-12);
        assert_eq!(at(30.0), Overlap::default());
    }

    #[test]
    fn the_smaller_disc_decides() {
        let inside = Overlap::new([100.0, 100.0], 15.0, [105.0, 95.0], 30.0);
        assert!((inside.of_agent - 1.0).abs() < 1e-12 && (inside.of_goal - 0.25).abs() < 1e-12, "{inside:?}");
        assert!(inside.is_success());
    }
}
