//! Where the agent cannot stand: the block, grown by the agent's own extent.
//!
//! Each pair of a block's rectangle and a part of the agent gives one convex piece with four pairs of parallel sides.
//! For a polygon agent that is the exact set of overlapping positions at its present angle; around a disc's rounded
//! corners it is slightly too large. Positions are those of the agent's origin, in the world, pixels.

use crate::pusht::engine::Engine;
use crate::pusht::physics::{
    BodyId, Rectangle, Rotation, Setup, Shape, Vec2, WALL_RADIUS, WALL_SEGMENTS, vec2,
};

/// The inner faces of the walls, on both axes.
const WALLS_PX: [f64; 2] = [WALL_SEGMENTS[0].from[0] + WALL_RADIUS, WALL_SEGMENTS[2].from[0] - WALL_RADIUS];

/// What an agent or block occupies, in its own coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Figure {
    /// A disc about the origin: its radius.
    Disc(f64),
    /// A union of rectangles.
    Polygon(Vec<Rectangle>),
}

impl Figure {
    pub(super) fn new(setup: &Setup, body: BodyId) -> Figure {
        let body = if body == BodyId::Agent { &setup.agent } else { &setup.block };
        match body.shape {
            Shape::Disc => Figure::Disc(Shape::disc_radius(body.scale)),
            shape => Figure::Polygon(shape.rectangles(body.scale).collect()),
        }
    }

    fn parts(&self) -> Vec<Part> {
        match self {
            Figure::Disc(radius) => {
                vec![Part { center: Vec2::default(), half: Vec2::default(), round: *radius }]
            }
            Figure::Polygon(rectangles) => rectangles.iter().map(Part::new).collect(),
        }
    }

    /// The point that lies farthest in a direction, from the origin, in the world.
    pub(super) fn farthest(&self, rotation: Rotation, direction: Vec2) -> Vec2 {
        match self {
            Figure::Disc(radius) => direction * (*radius / direction.norm()),
            Figure::Polygon(rectangles) => {
                let inward = rotation.body_from_world(direction);
                let corners = rectangles.iter().flat_map(Rectangle::corners).map(Vec2::from);
                let farthest = corners.max_by(|a, b| a.dot(inward).total_cmp(&b.dot(inward)));
                rotation.world_from_body(farthest.unwrap_or_default())
            }
        }
    }

    /// How far the figure is from each of the four walls, pixels; negative inside of one.
    pub(super) fn wall_room(&self, origin: Vec2, rotation: Rotation) -> [f64; 4] {
        let mut room = [f64::INFINITY; 4];
        let Figure::Polygon(rectangles) = self else { return room };
        let [near, far] = WALLS_PX;
        for corner in rectangles.iter().flat_map(Rectangle::corners) {
            let p = origin + rotation.world_from_body(Vec2::from(corner));
            for (room, here) in room.iter_mut().zip([p.x - near, p.y - near, far - p.x, far - p.y]) {
                *room = room.min(here);
            }
        }
        room
    }

    /// The point with which the figure touches something in front of it, from the origin, in the world: as far as it
    /// reaches in `direction`, and across it from one end (0) to the other (1). A disc has one such point.
    pub(super) fn contact(&self, rotation: Rotation, direction: Vec2, side: f64) -> Vec2 {
        let foremost = self.farthest(rotation, direction);
        if let Figure::Disc(_) = self {
            return foremost;
        }
        let across = quarter_turn(direction);
        let [low, high] = [-across, across].map(|way| self.farthest(rotation, way).dot(across));
        direction * foremost.dot(direction) + across * (low + side * (high - low))
    }
}

/// A rectangle with rounded corners, in body coordinates.
#[derive(Clone, Copy, Debug)]
struct Part {
    center: Vec2,
    half: Vec2,
    round: f64,
}

impl Part {
    fn new(rectangle: &Rectangle) -> Part {
        let [min, max] = [rectangle.min, rectangle.max].map(Vec2::from);
        Part { center: (min + max) * 0.5, half: (max - min) * 0.5, round: 0.0 }
    }

    /// Half its width along a direction of the world.
    fn reach(&self, rotation: Rotation, direction: Vec2) -> f64 {
        let d = rotation.body_from_world(direction);
        d.x.abs() * self.half.x + d.y.abs() * self.half.y + self.round
    }
}

/// A rectangle that the agent's origin must stay in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Room {
    pub(super) min: Vec2,
    pub(super) max: Vec2,
}

impl Room {
    /// Between the walls, for a body of this figure.
    pub(super) fn new(figure: &Figure, rotation: Rotation) -> Room {
        let [near, far] = WALLS_PX;
        let reach = |x, y| figure.farthest(rotation, vec2(x, y));
        let min = vec2(near - reach(-1.0, 0.0).x, near - reach(0.0, -1.0).y);
        let max = vec2(far - reach(1.0, 0.0).x, far - reach(0.0, 1.0).y);
        Room { min, max }
    }

    pub(super) fn clamp(&self, p: Vec2) -> Vec2 {
        vec2(p.x.min(self.max.x).max(self.min.x), p.y.min(self.max.y).max(self.min.y))
    }
}

/// One convex piece: all `p` with `|normal · (p - center)| < half_width` for each of the four normals.
#[derive(Clone, Copy, Debug)]
struct Piece {
    center: Vec2,
    half_widths: [f64; 4],
}

/// The grown block.
#[derive(Clone, Debug)]
pub(super) struct Obstacle {
    /// In the order of their angles, over half a turn.
    normals: [Vec2; 4],
    pieces: Vec<Piece>,
}

/// How near the agent may come to the block on its way, pixels.
const MARGIN_PX: f64 = 0.8;

impl Obstacle {
    /// For the present poses.
    pub(super) fn new(agent: &Figure, block: &Figure, sim: &impl Engine) -> Obstacle {
        let [agent_rotation, block_rotation] =
            [BodyId::Agent, BodyId::Block].map(|body| Rotation::new(sim.angle(body)));
        Obstacle::at((agent, agent_rotation), (block, block_rotation), sim.position(BodyId::Block).into())
    }

    /// For an agent at any place and a block at `origin`.
    pub(super) fn at(agent: (&Figure, Rotation), block: (&Figure, Rotation), origin: Vec2) -> Obstacle {
        let (figure, agent_rotation) = agent;
        let x = block.1.world_from_body(vec2(1.0, 0.0));
        let y = block.1.world_from_body(vec2(0.0, 1.0));
        // The agent's axis between the block's two; a disc has none, and halving the corner fits it best.
        let mut between = match figure {
            Figure::Disc(_) => (x + y) * std::f64::consts::FRAC_1_SQRT_2,
            Figure::Polygon(_) => agent_rotation.world_from_body(vec2(1.0, 0.0)),
        };
        while between.dot(x) < 0.0 || between.dot(y) <= 0.0 {
            between = quarter_turn(between);
        }
        let normals = [x, between, y, quarter_turn(between)];
        let agent_parts = figure.parts();
        let pairs = block.0.parts().into_iter().flat_map(|b| agent_parts.iter().map(move |a| (*a, b)));
        let pieces = pairs.map(|(a, b)| Piece {
            center: origin + block.1.world_from_body(b.center) - agent_rotation.world_from_body(a.center),
            half_widths: normals.map(|n| a.reach(agent_rotation, n) + b.reach(block.1, n)),
        });
        Obstacle { normals, pieces: pieces.collect() }
    }

    /// True if the way from `a` to `b` keeps its distance, or at least does not come nearer than its ends are.
    pub(super) fn is_free(&self, a: Vec2, b: Vec2) -> bool {
        let way = b - a;
        let projected = self.normals.map(|n| (n.dot(a), n.dot(way)));
        self.pieces.iter().all(|piece| {
            let sides = || {
                let normals = self.normals.iter().zip(projected);
                normals
                    .zip(piece.half_widths)
                    .map(|((n, (from, slope)), half)| (from - n.dot(piece.center), slope, half))
            };
            let outside = |t: f64| {
                sides()
                    .fold(f64::NEG_INFINITY, |d, (from, slope, half)| d.max((from + t * slope).abs() - half))
            };
            let margin = MARGIN_PX.min(outside(0.0) - 0.01).min(outside(1.0) - 0.01);
            let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
            for (from, slope, half) in sides() {
                let half = half + margin;
                if slope.abs() < 1e-12 {
                    if from.abs() >= half {
                        return true;
                    }
                    continue;
                }
                let (first, second) = ((-half - from) / slope, (half - from) / slope);
                enter = enter.max(first.min(second));
                leave = leave.min(first.max(second));
            }
            enter >= leave
        })
    }

    /// Distance to the nearest piece (a lower bound of it around corners); negative inside.
    pub(super) fn clearance(&self, p: Vec2) -> f64 {
        self.pieces.iter().map(|piece| self.side(piece, p).0).fold(f64::INFINITY, f64::min)
    }

    /// The nearest point outside that a few corrections find.
    pub(super) fn outside(&self, mut p: Vec2) -> Vec2 {
        for _ in 0..4 {
            let sides = self.pieces.iter().map(|piece| self.side(piece, p));
            let Some((clearance, outward)) = sides.min_by(|a, b| a.0.total_cmp(&b.0)) else { return p };
            if clearance >= 0.0 {
                break;
            }
            p = p + outward * (2.0 * MARGIN_PX - clearance);
        }
        p
    }

    /// Signed distance to the side of a piece that is passed first on leaving it, and that side's outward normal.
    fn side(&self, piece: &Piece, p: Vec2) -> (f64, Vec2) {
        let mut best = (f64::NEG_INFINITY, Vec2::default());
        for (&normal, half_width) in self.normals.iter().zip(piece.half_widths) {
            let from = normal.dot(p - piece.center);
            let clearance = from.abs() - half_width;
            if clearance > best.0 {
                best = (clearance, if from < 0.0 { -normal } else { normal });
            }
        }
        best
    }

    /// Corners to go around: those of the pieces, a little outside, where nothing else is.
    pub(super) fn corners(&self) -> Vec<Vec2> {
        let mut corners = Vec::new();
        for piece in &self.pieces {
            for k in 0..8 {
                let side = |k: usize| {
                    let sign = if k % 8 < 4 { 1.0 } else { -1.0 };
                    (self.normals[k % 4] * sign, piece.half_widths[k % 4] + 2.0 * MARGIN_PX)
                };
                let ((a, reach_a), (b, reach_b)) = (side(k), side(k + 1));
                let det = a.cross(b);
                if det.abs() < 0.02 {
                    continue;
                }
                let corner = vec2(reach_a * b.y - reach_b * a.y, a.x * reach_b - b.x * reach_a) * (1.0 / det);
                let corner = piece.center + corner;
                if self.clearance(corner) > MARGIN_PX {
                    corners.push(corner);
                }
            }
        }
        corners
    }
}

fn quarter_turn(v: Vec2) -> Vec2 {
    vec2(-v.y, v.x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pusht::physics::{Placement, Sim};

    /// A T-block at (250, 250), turned by half a radian, and an agent of some shape at an angle.
    fn world(agent: Shape, at: [f64; 2]) -> (Obstacle, Sim) {
        let mut setup = Setup::default();
        (setup.agent.shape, setup.agent.scale) = (agent, if agent == Shape::Disc { 40.0 } else { 25.0 });
        let mut sim = Sim::new(&setup).unwrap();
        let placement = Placement {
            agent: at,
            agent_angle: Some(0.8),
            block: [250.0, 250.0],
            block_angle: 0.5,
            ..Placement::default()
        };
        sim.place_exactly(&placement).unwrap();
        let [agent, block] = [BodyId::Agent, BodyId::Block].map(|body| Figure::new(&setup, body));
        (Obstacle::new(&agent, &block, &sim), sim)
    }

    #[test]
    fn polygons_touch_exactly_where_there_is_no_clearance() {
        for shape in [Shape::L, Shape::T, Shape::Square, Shape::Plus] {
            let mut seen = [0; 2];
            for index in 0..400 {
                // Far enough from the walls that every contact is with the block.
                let at = [110.0 + 15.0 * f64::from(index % 20), 110.0 + 15.0 * f64::from(index / 20)];
                let (obstacle, mut sim) = world(shape, at);
                let clearance = obstacle.clearance(Vec2::from(at));
                assert_eq!(sim.settle() > 0, clearance < 0.0, "{shape:?} at {at:?}: {clearance}");
                seen[usize::from(clearance < 0.0)] += 1;
            }
            assert!(seen[0] > 20 && seen[1] > 20, "{shape:?}: {seen:?}");
        }
    }

    #[test]
    fn discs_keep_their_radius() {
        let (obstacle, _) = world(Shape::Disc, [400.0, 400.0]);
        let rotation = Rotation::new(0.5);
        let place = |x, y| vec2(250.0, 250.0) + rotation.world_from_body(vec2(x, y));
        // The bar's upper side is at y = 0, the agent's radius is 15.
        assert!((obstacle.clearance(place(0.0, -20.0)) - 5.0).abs() < 1e-9);
        assert!(obstacle.clearance(place(0.0, -14.0)) < 0.0);
        let outside = obstacle.outside(place(0.0, -3.0));
        assert!(obstacle.clearance(outside) > 0.0 && (outside - place(0.0, -3.0)).norm() < 15.0);
        assert!(obstacle.is_free(place(-90.0, -20.0), place(90.0, -20.0)));
        assert!(!obstacle.is_free(place(-90.0, 20.0), place(90.0, 20.0)));
        assert!(obstacle.is_free(place(0.0, -14.0), place(0.0, -60.0)), "away from a touch");
        assert!(obstacle.corners().iter().all(|&corner| obstacle.clearance(corner) > 0.0));
    }

    #[test]
    fn walls_leave_room_for_the_extent() {
        let mut setup = Setup::default();
        setup.agent.shape = Shape::Square;
        let figure = Figure::new(&setup, BodyId::Agent);
        let room = Room::new(&figure, Rotation::new(0.0));
        assert_eq!((room.min, room.max), (vec2(47.0, 47.0), vec2(464.0, 464.0)));
        assert_eq!(room.clamp(vec2(0.0, 300.0)), vec2(47.0, 300.0));
        assert_eq!(figure.wall_room(vec2(100.0, 464.0), Rotation::new(0.0)), [53.0, 417.0, 364.0, 0.0]);
        assert_eq!(Room::new(&Figure::Disc(15.0), Rotation::new(1.0)).min, vec2(22.0, 22.0));
    }
}
