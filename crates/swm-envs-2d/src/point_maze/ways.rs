//! Shortest ways through a maze for a disc: straight lines over the corners of walls, which are kept at a distance.

use super::layout::{Layout, Rectangle};

/// Room that ways leave between the disc and a wall, beside its radius.
const MARGIN: f64 = 0.05;
/// Corners stand this much further out than lines of sight are tested, so that walls do not hide their own corners.
const OUTSIDE: f64 = 0.01;

/// All ways to one goal.
#[derive(Clone, Debug)]
pub(super) struct Ways {
    /// Where the disc's center cannot be.
    blocked: Vec<Rectangle>,
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
pub(super) struct Leg {
    /// Where it ends: a corner, or the goal.
    pub(super) to: [f64; 2],
    /// Length of the way that is left there; 0 at the goal.
    pub(super) rest: f64,
    /// Length of the whole way.
    pub(super) length: f64,
}

impl Ways {
    /// Ways of a disc of this radius to `goal`, which lies in a free cell.
    pub(super) fn new(layout: &Layout, radius: f64, goal: [f64; 2]) -> Ways {
        let grow = radius + MARGIN;
        let blocked = layout
            .walls()
            .into_iter()
            .map(|wall| Rectangle { min: wall.min.map(|c| c - grow), max: wall.max.map(|c| c + grow) });
        let mut ways = Ways { blocked: blocked.collect(), nodes: Vec::new() };
        ways.nodes.push(Node { place: ways.outside(goal), rest: 0.0 });
        let out = grow + OUTSIDE;
        let corners = layout.corners().map(|(corner, away)| Node {
            place: [0, 1].map(|axis| corner[axis] + out * away[axis]),
            rest: f64::INFINITY,
        });
        ways.nodes.extend(corners);
        ways.grow();
        ways
    }

    /// Dijkstra's algorithm from the goal; lines of sight are tested only where they could shorten a way.
    fn grow(&mut self) {
        let Ways { blocked, nodes } = self;
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
    pub(super) fn leg(&self, from: [f64; 2]) -> Leg {
        let place = self.outside(from);
        let leg = |node: &Node| Leg {
            to: node.place,
            rest: node.rest,
            length: node.rest + distance(place, node.place),
        };
        let mut best: Option<Leg> = None;
        for node in &self.nodes {
            let found = leg(node);
            // Of ways that are equally long, the one with the longer first leg: else a corner hides the one behind it.
            let better = best.is_none_or(|best| {
                found.length < best.length - OUTSIDE
                    || (found.length < best.length + OUTSIDE && found.rest < best.rest)
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
fn sees(blocked: &[Rectangle], from: [f64; 2], to: [f64; 2]) -> bool {
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
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::layout::{LAYOUTS, center};
    use super::*;

    /// Follows legs from a place to the goal; the length walked.
    fn walk(ways: &Ways, mut place: [f64; 2]) -> f64 {
        let mut length = 0.0;
        for _ in 0..60 {
            let leg = ways.leg(place);
            assert!(sees(&ways.blocked, place, leg.to), "from {place:?} to {:?}", leg.to);
            length += distance(place, leg.to);
            place = leg.to;
            if leg.rest == 0.0 {
                return length;
            }
        }
        panic!("no end in sight");
    }

    #[test]
    fn every_cell_leads_to_the_goal_at_the_promised_length() {
        for layout in LAYOUTS {
            for radius in [0.3, 1.0] {
                for goal in layout.free_cells().step_by(7) {
                    let ways = Ways::new(&layout, radius, center(goal));
                    for cell in layout.free_cells() {
                        let leg = ways.leg(center(cell));
                        let walked = walk(&ways, center(cell));
                        assert!((walked - leg.length).abs() < 0.2, "{}: {walked}, {leg:?}", layout.name);
                        assert!(leg.length + 1e-9 >= distance(center(cell), center(goal)));
                    }
                }
            }
        }
    }

    #[test]
    fn ways_are_straight_in_the_open_and_bend_at_corners() {
        let open = Ways::new(&LAYOUTS[3], 0.7, [20.0, 12.0]);
        assert_eq!(
            open.leg([0.0, 0.0]),
            Leg { to: [20.0, 12.0], rest: 0.0, length: distance([0.0, 0.0], [20.0, 12.0]) }
        );
        // From [1, 1] of the medium maze to [1, 5]: around the walls between.
        let ways = Ways::new(&LAYOUTS[0], 0.7, center([1, 5]));
        let leg = ways.leg(center([1, 1]));
        assert!(leg.rest > 0.0 && leg.length > 20.0 && leg.length < 32.0, "{leg:?}");
    }

    #[test]
    fn a_place_in_contact_with_a_wall_sees_as_one_beside_it() {
        let ways = Ways::new(&LAYOUTS[0], 0.7, center([6, 6]));
        let [beside, touching] = [[-1.2, 0.0], [-1.31, 0.0]].map(|place| ways.leg(place));
        assert_eq!(beside.to, touching.to);
    }
}
