//! Mazes on the grid: which cells are walls, Eller's algorithm, which makes them row by row, and shortest ways.

use rand_distr::{Distribution as _, StandardUniform};
use swm_core::seed::{Stream, keyed};

/// Cells along each side of the grid, border included.
pub(super) const SIDE: usize = 9;
/// Rooms along each side: the cells of odd coordinates, which are never walls.
const ROOMS: usize = SIDE / 2;

/// A cell: column and row, from the top left corner.
pub(super) type Cell = [i64; 2];

/// The steps of the four directions: right, down, left, up.
pub(super) const DIRECTIONS: [Cell; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// The cell next to one in a direction.
pub(super) fn next_to(cell: Cell, direction: i64) -> Cell {
    let step = DIRECTIONS[direction.rem_euclid(4) as usize];
    [cell[0] + step[0], cell[1] + step[1]]
}

/// The walls of a grid, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Maze {
    /// 1: a wall.
    pub(super) walls: [u8; SIDE * SIDE],
}

impl Maze {
    /// The maze of a seed: a passage between any two rooms, and only one.
    ///
    /// `p_horizontal` is the probability that two neighbors in a row that are not connected yet become so, `p_vertical` that a
    /// connected group of rooms of a row has a further passage down; it has at least one.
    pub(super) fn new(seed: i64, p_horizontal: f64, p_vertical: f64) -> Self {
        let mut stream = keyed(seed as u64, "maze", [0, 0]);
        let mut maze = Self { walls: [1; SIDE * SIDE] };
        let mut groups: [usize; ROOMS] = std::array::from_fn(|room| room);
        let mut next_group = ROOMS;
        for row in 0..ROOMS {
            let is_last = row + 1 == ROOMS;
            for room in 0..ROOMS {
                maze.open(2 * room + 1, 2 * row + 1);
                let Some(&right) = groups.get(room + 1) else { continue };
                let own = groups[room];
                if own != right && (is_last || uniform(&mut stream) < p_horizontal) {
                    maze.open(2 * room + 2, 2 * row + 1);
                    groups.iter_mut().filter(|group| **group == right).for_each(|group| *group = own);
                }
            }
            if is_last {
                break;
            }
            let mut below = [None; ROOMS];
            for first in 0..ROOMS {
                let group = groups[first];
                if groups[..first].contains(&group) {
                    continue;
                }
                let mut rooms = [0; ROOMS];
                let mut count = 0;
                for room in (first..ROOMS).filter(|&room| groups[room] == group) {
                    rooms[count] = room;
                    count += 1;
                }
                shuffle(&mut rooms[..count], &mut stream);
                for (index, &room) in rooms[..count].iter().enumerate() {
                    if index + 1 == count || uniform(&mut stream) < p_vertical {
                        maze.open(2 * room + 1, 2 * row + 2);
                        below[room] = Some(group);
                    }
                }
            }
            groups = below.map(|group| {
                next_group += 1;
                group.unwrap_or(next_group)
            });
        }
        maze
    }

    /// The maze of recorded walls, row by row.
    pub(super) fn from_walls(walls: &[u8]) -> Result<Self, String> {
        let walls: [u8; SIDE * SIDE] =
            walls.try_into().map_err(|_| format!("{} cells, not {}", walls.len(), SIDE * SIDE))?;
        let last = SIDE as i64 - 1;
        let maze = Self { walls };
        let border = (0..=last).flat_map(|i| [[i, 0], [i, last], [0, i], [last, i]]);
        if walls.iter().any(|&cell| cell > 1) {
            return Err("a cell is neither 0 (free) nor 1 (a wall)".to_owned());
        }
        match border.into_iter().find(|&cell| maze.is_free(cell)) {
            Some([x, y]) => Err(format!("the cell [{x}, {y}] of the border is no wall")),
            None => Ok(maze),
        }
    }

    fn open(&mut self, x: usize, y: usize) {
        self.walls[y * SIDE + x] = 0;
    }

    /// Whether a cell lies in the grid and is no wall.
    pub(super) fn is_free(&self, [x, y]: Cell) -> bool {
        let side = 0..SIDE as i64;
        side.contains(&x) && side.contains(&y) && self.walls[y as usize * SIDE + x as usize] == 0
    }

    /// The number of steps from every cell to `goal`; none where there is no way.
    pub(super) fn distances(&self, goal: Cell) -> Distances {
        let index = |[x, y]: Cell| y as usize * SIDE + x as usize;
        let mut steps = [None; SIDE * SIDE];
        let mut queue = [goal; SIDE * SIDE];
        let (mut first, mut end) = (0, 1);
        steps[index(goal)] = Some(0);
        while first < end {
            let cell = queue[first];
            first += 1;
            for direction in 0..4 {
                let next = next_to(cell, direction);
                if self.is_free(next) && steps[index(next)].is_none() {
                    steps[index(next)] = steps[index(cell)].map(|count: u8| count + 1);
                    queue[end] = next;
                    end += 1;
                }
            }
        }
        Distances { steps }
    }
}

/// Steps from every cell to a goal.
#[derive(Clone, Debug)]
pub(super) struct Distances {
    steps: [Option<u8>; SIDE * SIDE],
}

impl Distances {
    fn of(&self, [x, y]: Cell) -> Option<u8> {
        let side = 0..SIDE as i64;
        let is_inside = side.contains(&x) && side.contains(&y);
        is_inside.then(|| self.steps[y as usize * SIDE + x as usize]).flatten()
    }

    /// The direction of the shortest way; of several the first of right, left, down, up. None at the goal, or without a way.
    pub(super) fn direction(&self, cell: Cell) -> Option<i64> {
        let here = self.of(cell)?;
        [0, 2, 1, 3]
            .into_iter()
            .find(|&direction| self.of(next_to(cell, direction)).is_some_and(|there| there < here))
    }

    /// The number of actions, steps and turns, that lead along the shortest way; none without a way.
    pub(super) fn actions(&self, mut cell: Cell, mut facing: i64) -> Option<u32> {
        let steps = self.of(cell)?;
        let mut turns = 0;
        while let Some(direction) = self.direction(cell) {
            turns += [0, 1, 2, 1][(direction - facing).rem_euclid(4) as usize];
            facing = direction;
            cell = next_to(cell, direction);
        }
        Some(u32::from(steps) + turns)
    }
}

fn uniform(stream: &mut Stream) -> f64 {
    StandardUniform.sample(stream)
}

/// Fisher and Yates' shuffle.
fn shuffle(values: &mut [usize], stream: &mut Stream) {
    for last in (1..values.len()).rev() {
        let other = (uniform(stream) * (last + 1) as f64) as usize;
        values.swap(last, other.min(last));
    }
}
