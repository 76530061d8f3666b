//! Ways around the block: shortest paths over the corners of the obstacle.

use std::cell::OnceCell;

use super::obstacle::{Obstacle, Room};
use crate::pusht::physics::Vec2;

/// A path has at most this many points; longer ones are cut, which a plan survives.
const MAX_POINTS: usize = 16;

/// The points of a way, without its start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    points: [Vec2; MAX_POINTS],
    len: usize,
}

impl Path {
    pub(super) fn points(&self) -> &[Vec2] {
        &self.points[..self.len]
    }
}

/// All ways from one start, around a block that stands still.
pub(super) struct Routes {
    obstacle: Obstacle,
    room: Option<Room>,
    start: Vec2,
    tree: OnceCell<Tree>,
}

/// Shortest ways from the start to every corner.
struct Tree {
    /// The start first.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy)]
struct Node {
    place: Vec2,
    /// Infinite where no way leads.
    distance: f64,
    previous: usize,
    is_final: bool,
}

impl Routes {
    /// From `start`, for an agent whose origin has to stay in `room`.
    pub(super) fn new(obstacle: Obstacle, room: Option<Room>, start: Vec2) -> Routes {
        Routes { obstacle, room, start, tree: OnceCell::new() }
    }

    pub(super) fn obstacle(&self) -> &Obstacle {
        &self.obstacle
    }

    pub(super) fn room(&self) -> Option<Room> {
        self.room
    }

    /// The shortest way to `target`; straight where there is none.
    pub(super) fn to(&self, target: Vec2) -> Path {
        let mut path = Path { points: [target; MAX_POINTS], len: 1 };
        if self.obstacle.is_free(self.start, target) {
            return path;
        }
        let nodes = &self.tree.get_or_init(|| self.grow()).nodes;
        let mut best: Option<(f64, usize)> = None;
        for (index, node) in nodes.iter().enumerate().skip(1) {
            let distance = node.distance + (target - node.place).norm();
            let shorter = best.is_none_or(|(shortest, _)| distance < shortest);
            if distance.is_finite() && shorter && self.obstacle.is_free(node.place, target) {
                best = Some((distance, index));
            }
        }
        let Some((_, mut index)) = best else { return path };
        while index != 0 && path.len < MAX_POINTS {
            path.points[path.len] = nodes[index].place;
            path.len += 1;
            index = nodes[index].previous;
        }
        path.points[..path.len].reverse();
        path
    }

    /// Dijkstra's algorithm; lines of sight are tested only where they could shorten a way.
    fn grow(&self) -> Tree {
        let node = |place| Node { place, distance: f64::INFINITY, previous: 0, is_final: false };
        let reachable = |p: &Vec2| self.room.is_none_or(|room| (room.clamp(*p) - *p).norm() < 2.0);
        let mut nodes = vec![Node { distance: 0.0, ..node(self.start) }];
        nodes.extend(self.obstacle.corners().into_iter().filter(reachable).map(node));
        loop {
            let open = nodes.iter().enumerate().filter(|(_, n)| !n.is_final && n.distance.is_finite());
            let nearest = open.min_by(|a, b| a.1.distance.total_cmp(&b.1.distance)).map(|(index, _)| index);
            let Some(index) = nearest else { break };
            nodes[index].is_final = true;
            let from = nodes[index];
            for other in nodes.iter_mut().filter(|other| !other.is_final) {
                let distance = from.distance + (other.place - from.place).norm();
                if distance < other.distance && self.obstacle.is_free(from.place, other.place) {
                    (other.distance, other.previous) = (distance, index);
                }
            }
        }
        Tree { nodes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pusht::expert::obstacle::Figure;
    use crate::pusht::physics::{BodyId, Placement, Setup, Sim, vec2};

    #[test]
    fn ways_lead_around_the_block() {
        let setup = Setup::default();
        let mut sim = Sim::new(&setup).unwrap();
        sim.place_exactly(&Placement::from([250.0, 200.0, 250.0, 250.0, 0.0])).unwrap();
        let [agent, block] = [BodyId::Agent, BodyId::Block].map(|body| Figure::new(&setup, body));
        let routes = Routes::new(Obstacle::new(&agent, &block, &sim), None, vec2(250.0, 200.0));
        assert_eq!(routes.to(vec2(300.0, 180.0)).points(), [vec2(300.0, 180.0)], "straight where nothing is");

        // From above the bar to below it, beside the stem.
        let target = vec2(290.0, 320.0);
        let path = routes.to(target);
        assert!(path.points().len() >= 2);
        assert_eq!(path.points().last(), Some(&target));
        let mut from = vec2(250.0, 200.0);
        let mut length = 0.0;
        for &point in path.points() {
            assert!(routes.obstacle().is_free(from, point), "{from:?} to {point:?}");
            length += (point - from).norm();
            from = point;
        }
        assert!((150.0..260.0).contains(&length), "{length}");
    }
}
