//! The walls of an episode: where they stand, what they touch, and how a disc moves between them. Positions are `[x, y]`, y up, in
//! units of which the room is 5 wide, in f32 as in the reference.

use swm_fov::Fov;

use crate::shortest_path::{Rectangle, ShortestPaths};

/// The side of the room.
pub(super) const SIDE: f32 = 5.0;
/// Most walls of an episode.
pub(super) const MAX_WALLS: usize = 6;
/// Largest displacement of a step along each axis at a speed of 1.
pub(super) const MAX_ACTION: f32 = 0.2;
/// Room that the expert's paths leave beside the disc.
const MARGIN: f64 = 0.01;

/// A wall: its corners of least and of greatest coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wall {
    pub(super) min: [f32; 2],
    pub(super) max: [f32; 2],
}

impl Wall {
    pub(super) fn new(min: [f32; 2], shape: [f32; 2]) -> Self {
        Self { min, max: std::array::from_fn(|axis| min[axis] + shape[axis]) }
    }

    /// Whether it lies in the room.
    pub(super) fn is_inside(&self) -> bool {
        self.max.iter().all(|&end| end <= SIDE)
    }

    /// Whether a disc overlaps it.
    pub(super) fn meets(&self, center: [f32; 2], radius: f32) -> bool {
        let [x, y] = [0, 1].map(|axis| center[axis].clamp(self.min[axis], self.max[axis]) - center[axis]);
        x * x + y * y <= radius * radius
    }
}

/// The walls of an assignment of factors.
pub(super) fn walls(fov: &Fov) -> Vec<Wall> {
    let positions = fov.vector::<f32, { 2 * MAX_WALLS }>("walls.positions");
    let shapes = fov.vector::<f32, { 2 * MAX_WALLS }>("walls.shape");
    let pairs = positions.as_chunks::<2>().0.iter().zip(shapes.as_chunks::<2>().0);
    pairs.take(fov.i64("walls.number") as usize).map(|(&min, &shape)| Wall::new(min, shape)).collect()
}

/// Whether a disc overlaps a wall.
pub(super) fn is_blocked(walls: &[Wall], center: [f32; 2], radius: f32) -> bool {
    walls.iter().any(|wall| wall.meets(center, radius))
}

/// A disc among walls.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Room {
    pub(super) walls: Vec<Wall>,
    pub(super) radius: f32,
    pub(super) speed: f32,
}

impl Room {
    /// The room of an assignment of factors.
    pub(super) fn new(fov: &Fov) -> Self {
        Self { walls: walls(fov), radius: fov.f32("agent.radius"), speed: fov.f32("agent.speed") }
    }

    /// Where a step leads: a disc that would overlap a wall stays.
    pub(super) fn step(&self, position: [f32; 2], action: [f32; 2]) -> [f32; 2] {
        let moved: [f32; 2] = std::array::from_fn(|axis| {
            position[axis] + self.speed * action[axis].clamp(-MAX_ACTION, MAX_ACTION)
        });
        let next = if is_blocked(&self.walls, moved, self.radius) { position } else { moved };
        next.map(|c| c.clamp(0.0, SIDE))
    }

    /// All shortest paths to a goal: around the corners of walls that the disc reaches.
    pub(super) fn shortest_paths(&self, goal: [f32; 2]) -> ShortestPaths {
        let rectangles: Vec<Rectangle> = (self.walls.iter())
            .map(|wall| Rectangle { min: wall.min.map(f64::from), max: wall.max.map(f64::from) })
            .collect();
        let out = f64::from(self.radius) + 2.0 * MARGIN;
        let corners = rectangles.iter().flat_map(|wall| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|away: [f64; 2]| {
                let corner =
                    [0, 1].map(|axis| if away[axis] < 0.0 { wall.min[axis] } else { wall.max[axis] });
                (corner, away)
            })
        });
        let is_in_room = |(corner, away): &([f64; 2], [f64; 2])| {
            (0..2).all(|axis| (0.0..=f64::from(SIDE)).contains(&(corner[axis] + out * away[axis])))
        };
        let radius = [f64::from(self.radius), MARGIN];
        ShortestPaths::new(&rectangles, corners.filter(is_in_room), radius, goal.map(f64::from))
    }
}
