//! Cheapest paths over the map, through stone if the player has a pickaxe.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::rules::{Block, Cell, action, block, direction, is_solid, plus};
use super::state::{Map, SIDE, State};

const CELLS: usize = SIDE * SIDE;
/// The actions of walking.
pub(super) const WALKS: [i64; 4] = [action::LEFT, action::RIGHT, action::UP, action::DOWN];

/// Steps to walk onto a cell; `None` where the player cannot get.
fn cost(state: &State, cell: Cell) -> Option<u32> {
    let has = &state.inventory;
    match state.map.block(cell) {
        _ if !Map::contains(cell) || state.map.has_mob(cell) => None,
        block::STONE | block::COAL if has.wood_pickaxe > 0 => Some(2),
        block::IRON if has.stone_pickaxe > 0 => Some(2),
        block::LAVA => None,
        of if is_solid(of) => None,
        _ => Some(1),
    }
}

fn index([row, column]: Cell) -> usize {
    row as usize * SIDE + column as usize
}

/// The walk that begins the cheapest way to the nearest cell for which `is_goal` holds, and the steps of that way. The last
/// cell need not be one that can be walked on. `None` if there is no way.
pub(super) fn way_to(state: &State, is_goal: impl Fn(Cell) -> bool) -> Option<(i64, u32)> {
    let mut first = vec![(u32::MAX, 0_i64); CELLS];
    let mut open = BinaryHeap::from([Reverse((0, index(state.player)))]);
    first[index(state.player)] = (0, 0);
    while let Some(Reverse((steps, at))) = open.pop() {
        let cell = [(at / SIDE) as i32, (at % SIDE) as i32];
        let (best, begun) = first[at];
        if steps > best {
            continue;
        }
        if cell != state.player && is_goal(cell) {
            return Some((begun, steps));
        }
        // A goal that blocks the way is where a way ends.
        if cell != state.player && cost(state, cell).is_none() {
            continue;
        }
        for walk in WALKS {
            let next = plus(cell, direction(walk));
            if !Map::contains(next) {
                continue;
            }
            let Some(cost) = cost(state, next).or(is_goal(next).then_some(1)) else { continue };
            if steps + cost < first[index(next)].0 {
                first[index(next)] = (steps + cost, if cell == state.player { walk } else { begun });
                open.push(Reverse((steps + cost, index(next))));
            }
        }
    }
    None
}

/// The action that goes on by `walk`: turns to what is in the way, digs it away or uses it, or walks.
pub(super) fn toward(state: &State, walk: i64) -> i64 {
    let next = plus(state.player, direction(walk));
    let is_blocked = state.map.has_mob(next) || is_solid(state.map.block(next));
    if is_blocked && state.direction == walk { action::DO } else { walk }
}

/// The action that leads to such a block nearby and uses it.
pub(super) fn use_block(state: &State, wanted: Block) -> Option<(i64, u32)> {
    let (walk, steps) = way_to(state, |cell| state.map.block(cell) == wanted)?;
    let next = plus(state.player, direction(walk));
    // Grass does not block the way: the player must look at it instead.
    if state.map.block(next) == wanted && state.direction == walk {
        return Some((action::DO, steps));
    }
    Some((toward(state, walk), steps))
}

/// Cells that a mob could reach from the player's, with one more blocked: up to `most` and one.
pub(super) fn room(state: &State, from: Cell, blocked: Option<Cell>, most: usize) -> usize {
    let mut cells = vec![from];
    let mut next = 0;
    while next < cells.len() && cells.len() <= most {
        for walk in WALKS {
            let cell = plus(cells[next], direction(walk));
            let is_open = Map::contains(cell) && !is_solid(state.map.block(cell)) && Some(cell) != blocked;
            if is_open && !cells.contains(&cell) {
                cells.push(cell);
            }
        }
        next += 1;
    }
    cells.len()
}
