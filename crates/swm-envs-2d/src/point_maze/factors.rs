//! The factors of PointMaze, their constraints, and what an assignment means.

use swm_core::{Space, Value};
use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::layout::{Cell, LAYOUTS, Layout, center};
use super::physics::Disc;

/// Rows and columns inside of the largest layout's border.
const INNER: [i64; 2] = [10, 14];

/// A cell: row and column, `[1, 1]` the first inside of the border.
fn cell(name: &str, default: Cell) -> Factor {
    let space = Space::MultiDiscrete { n: INNER.to_vec(), start: vec![1, 1] };
    Factor::new(name, space, Value::vector(&default))
}

/// The factor table, in sampling order. Lengths are in the maze's unit: a cell is 4 wide.
pub fn factors() -> FovSpace {
    let space = FovSpace::new(vec![
        Factor::integer("maze.layout", 0, LAYOUTS.len() as i64 - 1, 0)
            .choices(&["medium", "large", "giant", "arena"])
            .doc("0 medium, 1 large, 2 giant, 3 arena"),
        Factor::rgb("floor.color", [255, 255, 255]).doc("color of the floor"),
        Factor::rgb("wall.color", [105, 115, 130]).doc("color of the walls"),
        Factor::rgb("agent.color", [65, 105, 225]).doc("color of the disc"),
        Factor::scalar("agent.radius", 0.3, 1.0, 0.7).doc("radius of the disc"),
        Factor::scalar("agent.mass", 0.5, 1.5, 1.0).doc("mass of the disc"),
        Factor::scalar("agent.damping", 1.0, 3.0, 2.0).doc("rate at which its velocity decays, 1/s"),
        Factor::scalar("agent.gain", 8.0, 16.0, 10.0).doc("force of an action of 1"),
        cell("agent.start_cell", [1, 1]).doc("row and column where the disc starts").sampled_by_default(),
        Factor::vector("agent.start_offset", -1.0, 1.0, &[0.0, 0.0])
            .doc("start x, y from the middle of its cell")
            .sampled_by_default(),
        Factor::rgb("goal.color", [144, 238, 144]).doc("color of the goal"),
        Factor::scalar("goal.radius", 0.5, 1.5, 1.0).doc("the goal is reached within this distance"),
        cell("goal.cell", [5, 6]).doc("row and column of the goal").sampled_by_default(),
        Factor::vector("goal.offset", -1.0, 1.0, &[0.0, 0.0])
            .doc("goal x, y from the middle of its cell")
            .sampled_by_default(),
    ]);
    space.with_constraints(vec![
        Constraint {
            owner: "agent.start_cell",
            reads: &["maze.layout"],
            words: "a free cell of maze.layout",
            holds: |fov| layout(fov).is_free(fov.vector("agent.start_cell")),
        },
        Constraint {
            owner: "goal.cell",
            reads: &["maze.layout", "agent.start_cell"],
            words: "a free cell of maze.layout other than agent.start_cell",
            holds: |fov| {
                let [start, goal]: [Cell; 2] = ["agent.start_cell", "goal.cell"].map(|name| fov.vector(name));
                layout(fov).is_free(goal) && goal != start
            },
        },
    ])
}

/// The layout of a value of `maze.layout`.
pub(super) fn layout_at(index: i64) -> Option<&'static Layout> {
    LAYOUTS.get(usize::try_from(index).ok()?)
}

/// The layout of an assignment.
pub(super) fn layout(fov: &Fov) -> &'static Layout {
    layout_at(fov.i64("maze.layout")).expect("the factor's bounds are the layouts")
}

/// The disc of an assignment.
pub(super) fn disc(fov: &Fov) -> Disc {
    Disc {
        radius: fov.f64("agent.radius"),
        mass: fov.f64("agent.mass"),
        damping: fov.f64("agent.damping"),
        gain: fov.f64("agent.gain"),
    }
}

/// Where the disc starts.
pub(super) fn start(fov: &Fov) -> [f64; 2] {
    place(fov.vector("agent.start_cell"), fov.vector("agent.start_offset"))
}

/// Where the goal is.
pub(super) fn goal(fov: &Fov) -> [f64; 2] {
    place(fov.vector("goal.cell"), fov.vector("goal.offset"))
}

fn place(cell: Cell, offset: [f64; 2]) -> [f64; 2] {
    let middle = center(cell);
    [0, 1].map(|axis| middle[axis] + offset[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_cells_are_free_in_every_layout() {
        let fov = factors().defaults();
        for layout in LAYOUTS {
            assert!(layout.is_free(fov.vector("agent.start_cell")), "{}", layout.name);
            assert!(layout.is_free(fov.vector("goal.cell")), "{}", layout.name);
            let [rows, cols] = layout.size();
            assert!(rows as i64 - 2 <= INNER[0] && cols as i64 - 2 <= INNER[1], "{}", layout.name);
        }
    }
}
