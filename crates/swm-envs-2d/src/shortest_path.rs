//! Shortest paths through a maze for a disc: straight lines over the corners of walls, which are kept at a distance.

/// A rectangle along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rectangle {
    pub(crate) min: [f64; 2],
    pub(crate) max: [f64; 2],
}

/// Paths whose lengths differ by less than this are equally long.
const SAME_LENGTH: f64 = 0.01;

/// All shortest paths to one goal.
#[derive(Clone, Debug)]
pub(crate) struct ShortestPaths {
    /// Where the disc's center cannot be.
    pub(crate) blocked: Vec<Rectangle>,
    /// The goal first, then corners, each with its distance from the goal.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    place: [f64; 2],
    /// Length of the shortest way on; infinite where there is none.
    rest: f64,
}

/// The first straight piece of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Leg {
    /// Where it ends: a corner, or the goal.
    pub(crate) to: [f64; 2],
    /// Length of the way that is left there; 0 at the goal.
    pub(crate) rest: f64,
    /// Length of the whole way.
    pub(crate) length: f64,
}

impl ShortestPaths {
    /// Paths to `goal` of a disc of this radius among walls. `corners` are those that paths bend around, each with the direction
    /// along both axes that leads away from its wall; `margin` is the room that paths leave beside the disc.
    pub(crate) fn new(
        walls: &[Rectangle],
        corners: impl Iterator<Item = ([f64; 2], [f64; 2])>,
        [radius, margin]: [f64; 2],
        goal: [f64; 2],
    ) -> ShortestPaths {
        let grow = radius + margin;
        let blocked = walls
            .iter()
            .map(|wall| Rectangle { min: wall.min.map(|c| c - grow), max: wall.max.map(|c| c + grow) });
        let mut paths = ShortestPaths { blocked: blocked.collect(), nodes: Vec::new() };
        paths.nodes.push(Node { place: paths.outside(goal), rest: 0.0 });
        // A little further out than lines of sight are tested, so that walls do not hide their own corners.
        let out = grow + margin / 5.0;
        let corners = corners.map(|(corner, away)| Node {
            place: [0, 1].map(|axis| corner[axis] + out * away[axis]),
            rest: f64::INFINITY,
        });
        paths.nodes.extend(corners);
        paths.grow();
        paths
    }

    /// Dijkstra's algorithm from the goal; lines of sight are tested only where they could shorten a way.
    fn grow(&mut self) {
        let ShortestPaths { blocked, nodes } = self;
        let mut open: Vec<usize> = (0..nodes.len()).collect();
        loop {
            let nearest =
                open.iter().enumerate().min_by(|a, b| nodes[*a.1].rest.total_cmp(&nodes[*b.1].rest));
            let Some((at, &index)) = nearest else { break };
            open.swap_remove(at);
            let from = nodes[index];
            if from.rest.is_infinite() {
                break;
            }
            for &other in &open {
                let rest = from.rest + distance(from.place, nodes[other].place);
                if rest < nodes[other].rest && sees(blocked, from.place, nodes[other].place) {
                    nodes[other].rest = rest;
                }
            }
        }
    }

    /// The first leg of the shortest way from a place. Where nothing is in sight (inside of a wall), straight to the
    /// node that promises most.
    pub(crate) fn leg(&self, from: [f64; 2]) -> Leg {
        let place = self.outside(from);
        let leg = |node: &Node| Leg {
            to: node.place,
            rest: node.rest,
            length: node.rest + distance(place, node.place),
        };
        let mut best: Option<Leg> = None;
        for node in &self.nodes {
            let found = leg(node);
            // Of paths that are equally long, the one with the longer first leg: else a corner hides the one behind it.
            let better = best.is_none_or(|best| {
                found.length < best.length - SAME_LENGTH
                    || (found.length < best.length + SAME_LENGTH && found.rest < best.rest)
            });
            if better && sees(&self.blocked, place, node.place) {
                best = Some(found);
            }
        }
        let anyhow = || {
            let legs = self.nodes.iter().map(leg);
            legs.min_by(|a, b| a.length.total_cmp(&b.length)).expect("the goal is a node")
        };
        best.unwrap_or_else(anyhow)
    }

    /// The nearest place that is not blocked, as far as a few corrections find it.
    fn outside(&self, mut place: [f64; 2]) -> [f64; 2] {
        for _ in 0..4 {
            let Some(wall) = self.blocked.iter().find(|wall| contains(wall, place)) else { break };
            let mut shortest = (f64::INFINITY, place);
            for axis in [0, 1] {
                for side in [wall.min[axis], wall.max[axis]] {
                    let mut moved = place;
                    moved[axis] = side;
                    let way = (side - place[axis]).abs();
                    if way < shortest.0 {
                        shortest = (way, moved);
                    }
                }
            }
            place = shortest.1;
        }
        place
    }
}

/// Whether a place lies inside of a rectangle, its border excluded.
fn contains(wall: &Rectangle, place: [f64; 2]) -> bool {
    [0, 1].iter().all(|&axis| wall.min[axis] < place[axis] && place[axis] < wall.max[axis])
}

/// Whether the line between two places crosses no rectangle's inside.
pub(crate) fn sees(blocked: &[Rectangle], from: [f64; 2], to: [f64; 2]) -> bool {
    blocked.iter().all(|wall| {
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in [0, 1] {
            let way = to[axis] - from[axis];
            if way == 0.0 {
                if from[axis] <= wall.min[axis] || from[axis] >= wall.max[axis] {
                    return true;
                }
                continue;
            }
            let (a, b) = ((wall.min[axis] - from[axis]) / way, (wall.max[axis] - from[axis]) / way);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        enter >= leave
    })
}

/// The distance between two places.
pub(crate) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}
