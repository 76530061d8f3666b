//! Shortest paths through a maze.

use super::layout::Layout;
use crate::shortest_path::ShortestPaths;

/// Room that paths leave between the disc and a wall, beside its radius.
const MARGIN: f64 = 0.05;

/// All shortest paths of a disc of this radius to `goal`, which lies in a free cell.
pub(super) fn shortest_paths(layout: &Layout, radius: f64, goal: [f64; 2]) -> ShortestPaths {
    ShortestPaths::new(&layout.walls(), layout.corners(), [radius, MARGIN], goal)
}

#[cfg(test)]
mod tests {
    use super::super::layout::{LAYOUTS, center};
    use super::*;
    use crate::shortest_path::{Leg, distance, sees};

    /// Follows legs from a place to the goal; the length walked.
    fn walk(to_goal: &ShortestPaths, mut place: [f64; 2]) -> f64 {
        let mut length = 0.0;
        for _ in 0..60 {
            let leg = to_goal.leg(place);
            assert!(sees(&to_goal.blocked, place, leg.to), "from {place:?} to {:?}", leg.to);
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
                    let to_goal = shortest_paths(&layout, radius, center(goal));
                    for cell in layout.free_cells() {
                        let leg = to_goal.leg(center(cell));
                        let walked = walk(&to_goal, center(cell));
                        assert!((walked - leg.length).abs() < 0.2, "{}: {walked}, {leg:?}", layout.name);
                        assert!(leg.length + 1e-9 >= distance(center(cell), center(goal)));
                    }
                }
            }
        }
    }

    #[test]
    fn ways_are_straight_in_the_open_and_bend_at_corners() {
        let open = shortest_paths(&LAYOUTS[3], 0.7, [20.0, 12.0]);
        assert_eq!(
            open.leg([0.0, 0.0]),
            Leg { to: [20.0, 12.0], rest: 0.0, length: distance([0.0, 0.0], [20.0, 12.0]) }
        );
        // From [1, 1] of the medium maze to [1, 5]: around the walls between.
        let to_goal = shortest_paths(&LAYOUTS[0], 0.7, center([1, 5]));
        let leg = to_goal.leg(center([1, 1]));
        assert!(leg.rest > 0.0 && leg.length > 20.0 && leg.length < 32.0, "{leg:?}");
    }

    #[test]
    fn a_place_in_contact_with_a_wall_sees_as_one_beside_it() {
        let to_goal = shortest_paths(&LAYOUTS[0], 0.7, center([6, 6]));
        let [beside, touching] = [[-1.2, 0.0], [-1.31, 0.0]].map(|place| to_goal.leg(place));
        assert_eq!(beside.to, touching.to);
    }
}
