//! What the agent sees: a square of 7 × 7 cells in front of it, as far as walls let it, as in MiniGrid.

use super::maze::{Cell, DIRECTIONS, Maze, SIDE};

/// Cells along each side of the view.
const VIEW: usize = 7;

/// Which cells of the grid are seen, row by row.
pub(super) type Seen = [bool; SIDE * SIDE];

/// The cells that an agent sees that stands on a cell and looks in a direction.
///
/// Sight spreads row by row from the agent's own, to the right and to the left, and one row on; walls are seen and end it.
pub(super) fn seen(maze: &Maze, agent: Cell, direction: i64) -> Seen {
    let ahead = DIRECTIONS[direction.rem_euclid(4) as usize];
    let right = [-ahead[1], ahead[0]];
    // Cell of a column of the view, from the left, and a row, from the farthest.
    let cell = |column: usize, row: usize| -> Cell {
        let (on, aside) = ((VIEW - 1 - row) as i64, column as i64 - (VIEW / 2) as i64);
        [0, 1].map(|axis| agent[axis] + on * ahead[axis] + aside * right[axis])
    };
    let mut mask = [[false; VIEW]; VIEW];
    mask[VIEW - 1][VIEW / 2] = true;
    for row in (0..VIEW).rev() {
        for leftward in [false, true] {
            for step in 0..VIEW - 1 {
                let column = if leftward { VIEW - 1 - step } else { step };
                if !mask[row][column] || !maze.is_free(cell(column, row)) {
                    continue;
                }
                let beside = if leftward { column - 1 } else { column + 1 };
                mask[row][beside] = true;
                if row > 0 {
                    mask[row - 1][beside] = true;
                    mask[row - 1][column] = true;
                }
            }
        }
    }
    let mut seen = [false; SIDE * SIDE];
    for (row, columns) in mask.iter().enumerate() {
        for (column, &is_seen) in columns.iter().enumerate() {
            let [x, y] = cell(column, row);
            if is_seen && [x, y].iter().all(|c| (0..SIDE as i64).contains(c)) {
                seen[y as usize * SIDE + x as usize] = true;
            }
        }
    }
    seen
}
