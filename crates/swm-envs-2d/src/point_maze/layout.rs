//! The mazes: which cells are walls, where a cell lies, and the walls as few rectangles. Nothing moves here.
//!
//! Wall cells, cell size and coordinates are those of OGBench's locomotion mazes (`ogbench` 1.2.2, `locomaze/maze.py`),
//! so that positions compare with its datasets.

use crate::shortest_path::Rectangle;

/// Side of a cell, in the maze's unit of length.
pub(super) const CELL: f64 = 4.0;

/// A maze: a grid of cells, all walls on its border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) name: &'static str,
    /// `#` a wall, `.` free; rows from y = 0 on.
    rows: &'static [&'static str],
}

/// All layouts, by the value of the factor `maze.layout`.
pub(super) const LAYOUTS: [Layout; 4] = [
    Layout {
        name: "medium",
        rows: &[
            "########", "#..##..#", "#..#...#", "##...###", "#..#...#", "#.#..#.#", "#...#..#", "########",
        ],
    },
    Layout {
        name: "large",
        rows: &[
            "############",
            "#....#.....#",
            "#.##.#.#.#.#",
            "#......#...#",
            "#.####.###.#",
            "#..#.#.....#",
            "##.#.#.#.###",
            "#..#...#...#",
            "############",
        ],
    },
    Layout {
        name: "giant",
        rows: &[
            "################",
            "#.#......##....#",
            "#.#.##.#.#..##.#",
            "#...#..#...#...#",
            "#.###.######.#.#",
            "#...#...#....#.#",
            "###.#.#..#.#.###",
            "#...#..#...#...#",
            "#.#.#.######.#.#",
            "#.###...#...##.#",
            "#.....#...#....#",
            "################",
        ],
    },
    Layout {
        name: "arena",
        rows: &[
            "########", "#......#", "#......#", "#......#", "#......#", "#......#", "#......#", "########",
        ],
    },
];

/// Row and column of a cell.
pub(super) type Cell = [i64; 2];

impl Layout {
    /// Rows and columns, walls of the border included.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.rows.len(), self.rows[0].len()]
    }

    /// Whether a cell exists and is no wall.
    pub(super) fn is_free(&self, [row, col]: Cell) -> bool {
        let row = usize::try_from(row).ok().and_then(|row| self.rows.get(row));
        let cell = row.zip(usize::try_from(col).ok()).and_then(|(row, col)| row.as_bytes().get(col));
        cell == Some(&b'.')
    }

    /// All cells, row by row.
    fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let [rows, cols] = self.size().map(|count| count as i64);
        (0..rows).flat_map(move |row| (0..cols).map(move |col| [row, col]))
    }

    /// The free cells, row by row.
    pub(super) fn free_cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.cells().filter(|&cell| self.is_free(cell))
    }

    /// The walls, row by row.
    pub(super) fn wall_cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.cells().filter(|&cell| !self.is_free(cell))
    }

    /// The walls as few rectangles: runs of a row, joined over rows of equal runs.
    pub(super) fn walls(&self) -> Vec<Rectangle> {
        let mut walls: Vec<Rectangle> = Vec::new();
        let mut above: Vec<usize> = Vec::new();
        for (row, cells) in self.rows.iter().enumerate() {
            let mut here = Vec::new();
            let mut col = 0;
            for run in cells.as_bytes().chunk_by(|a, b| a == b) {
                let (first, last) = (col, col + run.len() - 1);
                col += run.len();
                if run[0] != b'#' {
                    continue;
                }
                let [low, high] = [first, last].map(|col| center([row as i64, col as i64]));
                let run = Rectangle { min: low.map(|c| c - CELL / 2.0), max: high.map(|c| c + CELL / 2.0) };
                let same =
                    |&index: &usize| (walls[index].min[0], walls[index].max[0]) == (run.min[0], run.max[0]);
                if let Some(index) = above.iter().copied().find(same) {
                    walls[index].max[1] = run.max[1];
                    here.push(index);
                } else {
                    here.push(walls.len());
                    walls.push(run);
                }
            }
            above = here;
        }
        walls
    }

    /// Corners that paths bend around: where one wall cell meets three free ones. Each comes with the direction, along
    /// both axes, that leads away from the wall.
    pub(super) fn corners(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
        self.cells().filter_map(|[row, col]| {
            let around = [[row, col], [row, col + 1], [row + 1, col], [row + 1, col + 1]];
            let mut walls = around.into_iter().filter(|&cell| !self.is_free(cell));
            let (Some(wall), None) = (walls.next(), walls.next()) else { return None };
            let corner = center([row, col]).map(|c| c + CELL / 2.0);
            let wall = center(wall);
            Some((corner, [0, 1].map(|axis| (corner[axis] - wall[axis]).signum())))
        })
    }
}

/// The middle of a cell: x by column, y by row, with the first free cell `[1, 1]` at the origin.
pub(super) fn center([row, col]: Cell) -> [f64; 2] {
    [CELL * (col - 1) as f64, CELL * (row - 1) as f64]
}

/// The cell that a place lies in; the place must be finite.
pub(super) fn cell_at([x, y]: [f64; 2]) -> Cell {
    [y, x].map(|c| (c / CELL + 1.5).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mazes_are_closed_and_connected() {
        for layout in LAYOUTS {
            let [rows, cols] = layout.size();
            assert!(layout.rows.iter().all(|row| row.len() == cols), "{}", layout.name);
            for [row, col] in layout.free_cells() {
                assert!((1..rows as i64 - 1).contains(&row) && (1..cols as i64 - 1).contains(&col));
            }
            let free: Vec<Cell> = layout.free_cells().collect();
            let mut reached = vec![free[0]];
            let mut next = 0;
            while let Some(&[row, col]) = reached.get(next) {
                next += 1;
                for cell in [[row + 1, col], [row - 1, col], [row, col + 1], [row, col - 1]] {
                    if layout.is_free(cell) && !reached.contains(&cell) {
                        reached.push(cell);
                    }
                }
            }
            assert_eq!(reached.len(), free.len(), "{} falls apart", layout.name);
        }
        assert_eq!(LAYOUTS.map(|layout| layout.free_cells().count()), [26, 46, 86, 36]);
    }

    #[test]
    fn walls_cover_the_wall_cells_and_nothing_else() {
        for layout in LAYOUTS {
            let walls = layout.walls();
            let inside = |[x, y]: [f64; 2]| {
                let hits = walls.iter().filter(|wall| {
                    (wall.min[0]..wall.max[0]).contains(&x) && (wall.min[1]..wall.max[1]).contains(&y)
                });
                hits.count()
            };
            assert!(layout.free_cells().all(|cell| inside(center(cell)) == 0));
            assert!(layout.wall_cells().all(|cell| inside(center(cell)) == 1), "{}", layout.name);
            assert!(walls.len() < layout.wall_cells().count() / 2 + 1, "{}: {}", layout.name, walls.len());
        }
    }

    #[test]
    fn places_and_cells_agree() {
        for cell in LAYOUTS[1].free_cells() {
            let [x, y] = center(cell);
            assert_eq!(cell_at([x + 1.9, y - 1.9]), cell);
        }
        assert_eq!(center([1, 1]), [0.0, 0.0]);
        assert!(!LAYOUTS[0].is_free([-1, 3]) && !LAYOUTS[0].is_free([3, 99]));
    }

    #[test]
    fn the_arena_has_no_corners_and_a_lone_wall_four() {
        assert_eq!(LAYOUTS[3].corners().count(), 0);
        // Cell [2, 9] of the large maze is the only wall around which all eight neighbors are free.
        let alone = center([2, 9]);
        let near = LAYOUTS[1].corners().filter(|(corner, _)| {
            (corner[0] - alone[0]).abs() == CELL / 2.0 && (corner[1] - alone[1]).abs() == CELL / 2.0
        });
        let mut ways: Vec<[f64; 2]> = near.map(|(_, way)| way).collect();
        ways.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(ways, [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]);
    }
}
