//! The symbolic observation: what is around the player, one-hot, and how the player is.

use super::rules::{BLOCKS, Block, Cell, block, minus};
use super::state::{Map, SIDE, State};

/// Rows and columns that the player sees, with the player in the middle.
pub(super) const VIEW: [usize; 2] = [7, 9];
/// Kinds of blocks, then zombie, cow, skeleton, arrow.
const CHANNELS: usize = BLOCKS + 4;
/// Values about the view.
const VIEW_VALUES: usize = VIEW[0] * VIEW[1] * CHANNELS;
/// All values of the observation.
pub(super) const VALUES: usize = VIEW_VALUES + 12 + 4 + 4 + 2;

/// Tenths as the original has them: half-precision numbers times the half-precision 0.1.
const TENTHS: [f32; 10] = [
    0.0,
    0.099_975_586,
    0.199_951_17,
    0.299_804_7,
    0.399_902_34,
    0.5,
    0.599_609_4,
    0.699_707_03,
    0.799_804_7,
    0.899_902_34,
];

/// The blocks that the player sees, row by row.
pub(super) fn view(state: &State) -> [[Block; VIEW[1]]; VIEW[0]] {
    let [top, left] = minus(state.player, [VIEW[0] as i32 / 2, VIEW[1] as i32 / 2]);
    std::array::from_fn(|row| {
        let row = top + row as i32;
        std::array::from_fn(|column| {
            let cell = [row, left + column as i32];
            if Map::contains(cell) {
                state.map.blocks[cell[0] as usize * SIDE + cell[1] as usize]
            } else {
                block::OUT_OF_BOUNDS
            }
        })
    })
}

/// Where a cell is in the view, if it is.
pub(super) fn in_view(state: &State, cell: Cell) -> Option<[usize; 2]> {
    let [row, column] = local(state, cell);
    let is_inside = (0..VIEW[0] as i32).contains(&row) && (0..VIEW[1] as i32).contains(&column);
    is_inside.then_some([row as usize, column as usize])
}

fn local(state: &State, cell: Cell) -> Cell {
    let [row, column] = minus(cell, state.player);
    [row + VIEW[0] as i32 / 2, column + VIEW[1] as i32 / 2]
}

/// Writes the observation, `[1345]`.
pub(super) fn write(state: &State, out: &mut [f32]) {
    out.fill(0.0);
    for (cell, block) in view(state).as_flattened().iter().enumerate() {
        out[cell * CHANNELS + usize::from(*block)] = 1.0;
    }
    let mut channel = BLOCKS;
    for mobs in [&state.zombies[..], &state.cows, &state.skeletons] {
        mark(state, mobs.iter().map(|mob| (mob.at, mob.is_alive)), channel, out);
        channel += 1;
    }
    mark(state, state.arrows.iter().map(|arrow| (arrow.at, arrow.is_flying)), channel, out);

    let rest = &mut out[VIEW_VALUES..];
    let vitals = &state.vitals;
    let counts = state.inventory.counts().map(i32::from);
    let levels = [vitals.health, vitals.food, vitals.drink, vitals.energy];
    for (value, level) in rest.iter_mut().zip(counts.into_iter().chain(levels)) {
        *value = TENTHS[level as usize];
    }
    rest[16 + state.direction as usize - 1] = 1.0;
    rest[20] = state.light;
    rest[21] = f32::from(u8::from(vitals.is_sleeping));
}

/// Marks the mobs of one kind, in their order. As in the original, one that is dead or out of view wipes what an earlier one
/// marked on its cell; out of view up to one view to the left or above, its cell counts from the other edge.
fn mark(state: &State, mobs: impl Iterator<Item = (Cell, bool)>, channel: usize, out: &mut [f32]) {
    for (cell, is_there) in mobs {
        let at = local(state, cell);
        let mut is_seen = is_there;
        let mut place = [0; 2];
        let mut is_marked = true;
        for axis in 0..2 {
            let side = VIEW[axis] as i32;
            is_seen &= (0..side).contains(&at[axis]);
            let wrapped = if at[axis] < 0 { at[axis] + side } else { at[axis] };
            is_marked &= (0..side).contains(&wrapped);
            place[axis] = wrapped.max(0) as usize;
        }
        if is_marked {
            out[(place[0] * VIEW[1] + place[1]) * CHANNELS + channel] = f32::from(u8::from(is_seen));
        }
    }
}
