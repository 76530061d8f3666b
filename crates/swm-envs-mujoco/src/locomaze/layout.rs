//! The grids, their tasks, and the way from cell to cell. Cells are (row, column); row i is at y = 4 (i - 1) m, column j at
//! x = 4 (j - 1) m. Source: `ogbench/locomaze/maze.py`.

use serde::{Deserialize, Serialize};

/// Row and column.
pub(super) type Cell = [usize; 2];

/// Side of a cell, m.
pub(super) const UNIT: f64 = 4.0;
/// Height of the walls, m.
pub(super) const HEIGHT: f64 = 2.0;
/// How far starts and goals lie from the middle of their cell at most, along each axis, m.
pub(super) const START_RANGE: f64 = 1.0;

/// One of OGBench's mazes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Maze {
    /// One empty room.
    Arena,
    Medium,
    #[default]
    Large,
    Giant,
    /// Two entrances lead to any of three exits, by chance.
    Teleport,
}

/// Where a teleporter takes what comes near, and where to.
pub(super) struct Teleporters {
    pub(super) ins: &'static [Cell],
    pub(super) outs: &'static [Cell],
}

/// Radius of the discs of a teleporter, m, and how near counts as stepping onto one, in radii.
pub(super) const TELEPORTER_RADIUS: f64 = 1.0;
pub(super) const TELEPORTER_REACH: f64 = 1.5;

impl Maze {
    /// Rows of cells; `#` is a wall.
    pub(super) fn rows(self) -> &'static [&'static str] {
        match self {
            Maze::Arena => &[
                "########", "#      #", "#      #", "#      #", "#      #", "#      #", "#      #",
                "########",
            ],
            Maze::Medium => &[
                "########", "#  ##  #", "#  #   #", "##   ###", "#  #   #", "# #  # #", "#   #  #",
                "########",
            ],
            Maze::Large => &[
                "############",
                "#    #     #",
                "# ## # # # #",
                "#      #   #",
                "# #### ### #",
                "#  # #     #",
                "## # # # ###",
                "#  #   #   #",
                "############",
            ],
            Maze::Giant => &[
                "################",
                "# #      ##    #",
                "# # ## # #  ## #",
                "#   #  #   #   #",
                "# ### ###### # #",
                "#   #   #    # #",
                "### # #  # # ###",
                "#   #  #   #   #",
                "# # # ###### # #",
                "# ###   #   ## #",
                "#     #   #    #",
                "################",
            ],
            Maze::Teleport => &[
                "############",
                "#     # #  #",
                "## #   #  ##",
                "## ###     #",
                "#    # # # #",
                "# ## # # # #",
                "# ## # # # #",
                "#    #   # #",
                "############",
            ],
        }
    }

    /// Start and goal of the tasks, the first of which is task 1.
    pub(super) fn tasks(self) -> &'static [[Cell; 2]] {
        match self {
            Maze::Arena => &[[[1, 1], [6, 6]]],
            Maze::Medium => {
                &[[[1, 1], [6, 6]], [[6, 1], [1, 6]], [[5, 3], [4, 2]], [[6, 5], [6, 1]], [[2, 6], [1, 1]]]
            }
            Maze::Large => {
                &[[[1, 1], [7, 10]], [[5, 4], [7, 1]], [[7, 4], [1, 10]], [[3, 8], [5, 4]], [[1, 1], [5, 4]]]
            }
            Maze::Giant => &[
                [[1, 1], [10, 14]],
                [[1, 14], [10, 1]],
                [[8, 14], [1, 1]],
                [[8, 3], [5, 12]],
                [[5, 9], [3, 8]],
            ],
            Maze::Teleport => &[
                [[1, 10], [7, 1]],
                [[1, 1], [7, 10]],
                [[5, 6], [7, 10]],
                [[7, 1], [7, 10]],
                [[5, 6], [7, 1]],
            ],
        }
    }

    /// Starts of the ant and of the ball, and the goal, of AntSoccer's tasks; none where it cannot be played.
    pub(super) fn soccer_tasks(self) -> &'static [[Cell; 3]] {
        match self {
            Maze::Arena => &[
                [[1, 6], [2, 3], [5, 2]],
                [[2, 2], [5, 5], [2, 2]],
                [[6, 1], [2, 3], [6, 6]],
                [[6, 6], [1, 1], [6, 1]],
                [[4, 6], [6, 2], [1, 6]],
            ],
            Maze::Medium => &[
                [[1, 1], [3, 4], [6, 6]],
                [[6, 1], [6, 5], [1, 1]],
                [[5, 3], [4, 2], [6, 5]],
                [[6, 5], [1, 1], [5, 3]],
                [[1, 6], [6, 1], [1, 6]],
            ],
            Maze::Large | Maze::Giant | Maze::Teleport => &[],
        }
    }

    /// The teleporters; none but in one maze.
    pub(super) fn teleporters(self) -> Option<Teleporters> {
        const INS: &[Cell] = &[[4, 6], [5, 1]];
        const OUTS: &[Cell] = &[[1, 7], [6, 1], [6, 10]];
        (self == Maze::Teleport).then_some(Teleporters { ins: INS, outs: OUTS })
    }

    /// Rows and columns of cells.
    pub(super) fn size(self) -> [usize; 2] {
        [self.rows().len(), self.rows()[0].len()]
    }

    /// Whether something can be in a cell.
    pub(super) fn is_free(self, [row, column]: Cell) -> bool {
        self.rows().get(row).and_then(|cells| cells.as_bytes().get(column)) == Some(&b' ')
    }

    /// All cells, row by row.
    pub(super) fn cells(self) -> impl Iterator<Item = Cell> {
        let [rows, columns] = self.size();
        (0..rows).flat_map(move |row| (0..columns).map(move |column| [row, column]))
    }

    /// The free cells, row by row.
    pub(super) fn free_cells(self) -> Vec<Cell> {
        self.cells().filter(|&cell| self.is_free(cell)).collect()
    }

    /// The middle of all cells but the rim, x, y, m.
    pub(super) fn center(self) -> [f64; 2] {
        let [rows, columns] = self.size();
        [2.0 * (columns as f64 - 3.0), 2.0 * (rows as f64 - 3.0)]
    }

    /// The cells that have a way to each other: not those that teleport, nor one that only a teleporter leads to.
    pub(super) fn open_cells(self) -> Vec<Cell> {
        let mut cells = self.free_cells();
        cells.retain(|&cell| {
            !self.teleports(cell) && neighbors(cell).iter().any(|&other| self.is_free(other))
        });
        cells
    }

    fn teleports(self, cell: Cell) -> bool {
        self.teleporters().is_some_and(|teleporters| teleporters.ins.contains(&cell))
    }

    /// How many cells lie on the shortest way from each cell to `goal`, `[rows, columns]`; `None` in walls and where there is
    /// no way. Ways lead around teleporters: nobody knows where those lead to.
    pub(super) fn ways(self, goal: Cell) -> Vec<Option<u32>> {
        let [rows, columns] = self.size();
        let mut ways = vec![None; rows * columns];
        if !self.is_free(goal) {
            return ways;
        }
        ways[goal[0] * columns + goal[1]] = Some(0);
        let mut reached = vec![goal];
        let mut next = 0;
        while let Some(&cell) = reached.get(next) {
            let way = ways[cell[0] * columns + cell[1]].map(|way: u32| way + 1);
            for neighbor in neighbors(cell) {
                let known = &mut ways[neighbor[0] * columns + neighbor[1]];
                if self.is_free(neighbor) && !self.teleports(neighbor) && known.is_none() {
                    *known = way;
                    reached.push(neighbor);
                }
            }
            next += 1;
        }
        ways
    }

    /// The cell to go to next from `cell`, of those around it: the first of the nearest to the goal; the cell itself where none
    /// is nearer.
    pub(super) fn next(self, ways: &[Option<u32>], cell: Cell) -> Cell {
        let columns = self.size()[1];
        let way = |cell: Cell| ways.get(cell[0] * columns + cell[1]).copied().flatten().unwrap_or(u32::MAX);
        let mut best = cell;
        for neighbor in neighbors(cell) {
            if self.is_free(neighbor) && way(neighbor) < way(best) {
                best = neighbor;
            }
        }
        best
    }

    /// The piece of the way from `place` to `goal` that one is at: from the middle of this cell to that of the next, or to the
    /// goal. `None` where there is no way.
    pub(super) fn leg(self, ways: &[Option<u32>], place: [f64; 2], goal: [f64; 2]) -> Option<Leg> {
        let cell = cell_at(place);
        let next = self.next(ways, cell);
        let cells = ways.get(next[0] * self.size()[1] + next[1]).copied().flatten()?;
        let to = if cells == 0 { goal } else { place_of(next) };
        if next == cell {
            return Some(Leg { nearest: place, to, rest: 0.0 });
        }
        let (from, rest) = (place_of(cell), UNIT * f64::from(cells));
        let length = distance(from, to);
        let along =
            ((place[0] - from[0]) * (to[0] - from[0]) + (place[1] - from[1]) * (to[1] - from[1])) / length;
        let part = (along / length).clamp(0.0, 1.0);
        Some(Leg { nearest: [0, 1].map(|k| from[k] + part * (to[k] - from[k])), to, rest })
    }

    /// The length of the way from `place` to `goal` over the middles of cells, m; infinite where there is none.
    pub(super) fn way_left(self, ways: &[Option<u32>], place: [f64; 2], goal: [f64; 2]) -> f64 {
        self.leg(ways, place, goal).map_or(f64::INFINITY, |Leg { nearest, to, rest }| {
            distance(place, nearest) + distance(nearest, to) + rest
        })
    }
}

/// A straight piece of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leg {
    /// Its point that is nearest to where one is.
    pub(super) nearest: [f64; 2],
    /// Where it ends.
    pub(super) to: [f64; 2],
    /// The length of the way from there on, m.
    pub(super) rest: f64,
}

/// Above, left, below, right: the reference's order.
fn neighbors([row, column]: Cell) -> [Cell; 4] {
    [[row.saturating_sub(1), column], [row, column.saturating_sub(1)], [row + 1, column], [row, column + 1]]
}

/// The middle of a cell: x, y, m.
pub(super) fn place_of([row, column]: Cell) -> [f64; 2] {
    [column as f64 * UNIT - UNIT, row as f64 * UNIT - UNIT]
}

/// The cell that x, y lie in; row or column 0 for what lies outside.
pub(super) fn cell_at([x, y]: [f64; 2]) -> Cell {
    [y, x].map(|along| ((along + 1.5 * UNIT) / UNIT) as usize)
}

/// Between two places, m.
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Maze; 5] = [Maze::Arena, Maze::Medium, Maze::Large, Maze::Giant, Maze::Teleport];

    #[test]
    fn mazes_are_closed_and_their_tasks_can_be_done() {
        for maze in ALL {
            let [rows, columns] = maze.size();
            assert!(maze.rows().iter().all(|row| row.len() == columns), "{maze:?}");
            let on_the_rim =
                |[row, column]: Cell| row == 0 || column == 0 || row + 1 == rows || column + 1 == columns;
            assert!(maze.free_cells().into_iter().all(|cell| !on_the_rim(cell)), "{maze:?}");
            for (number, [start, goal]) in maze.tasks().iter().enumerate() {
                assert!(maze.is_free(*start) && maze.is_free(*goal), "{maze:?} {number}");
                let ways = maze.ways(*goal);
                let mut cell = *start;
                while cell != *goal {
                    let next = maze.next(&ways, cell);
                    assert_ne!(next, cell, "{maze:?}: no way in task {}", number + 1);
                    cell = next;
                }
            }
            for cells in maze.soccer_tasks() {
                assert!(cells.iter().all(|&cell| maze.is_free(cell)), "{maze:?} {cells:?}");
            }
        }
    }

    #[test]
    fn cells_and_places_are_two_names_for_one_thing() {
        for cell in Maze::Giant.cells() {
            let [x, y] = place_of(cell);
            assert_eq!(cell_at([x + 1.9, y - 1.9]), cell);
        }
        assert_eq!(cell_at([-100.0, 3.0])[1], 0);
        assert_eq!(Maze::Large.center(), [18.0, 12.0]);
    }

    #[test]
    fn the_way_left_has_no_jumps() {
        let goal = [36.7, 24.3];
        let ways = Maze::Large.ways(cell_at(goal));
        let mut last = Maze::Large.way_left(&ways, [0.0, 0.0], goal);
        assert!((50.0..200.0).contains(&last), "{last}");
        for step in 1..=160 {
            let now = Maze::Large.way_left(&ways, [0.0, 0.05 * f64::from(step)], goal);
            assert!((now - last).abs() < 0.0501, "step {step}: {last} to {now}");
            last = now;
        }
        assert_eq!(Maze::Large.way_left(&ways, goal, goal), 0.0);
        assert_eq!(Maze::Large.way_left(&ways, [-50.0, -50.0], goal), f64::INFINITY);
        // From beside a teleporter the way leads round it.
        let ways = Maze::Teleport.ways([6, 1]);
        assert_eq!(Maze::Teleport.next(&ways, [4, 1]), [4, 2]);
    }
}
