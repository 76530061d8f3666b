//! Where new mobs appear, and the choice of a cell that JAX makes for it.

use super::rules::{Block, Cell, Params, block, distance};
use super::state::{Mob, SIDE, State};
use super::threefry::Key;
use super::world::fused;

/// Cells that one side of a block of XLA's cumulative sum has.
const GROUP: usize = 16;
const GROUPS: usize = SIDE * SIDE / GROUP;

/// A set of cells, of which `jax.random.choice` takes one: all are as likely.
///
/// The choice searches a cumulative sum in single precision, which XLA takes in groups of 16, groups of 16 groups, and so
/// on. To choose the cells that the original chooses, the sum is rounded here as there.
pub(super) struct Weights {
    /// A bit per cell.
    cells: [u16; GROUPS],
    count: u32,
}

impl Weights {
    /// The cells, by index, for which `is_in` holds.
    pub(super) fn new(is_in: impl Fn(usize) -> bool) -> Self {
        let cells = std::array::from_fn(|group| {
            (0..GROUP).fold(0, |set, i| set | u16::from(is_in(group * GROUP + i)) << i)
        });
        Self::of(cells)
    }

    fn of(cells: [u16; GROUPS]) -> Self {
        let count = cells.iter().map(|set: &u16| set.count_ones()).sum();
        Self { cells, count }
    }

    /// The cells at more than `near` and less than `far` steps from `center` for which `is_in` holds.
    fn around(center: Cell, near: i32, far: i32, is_in: impl Fn(usize) -> bool) -> Self {
        let mut cells = [0; GROUPS];
        let side = SIDE as i32;
        for row in (center[0] - far + 1).max(0)..(center[0] + far).min(side) {
            let left = far - 1 - (row - center[0]).abs();
            for column in (center[1] - left).max(0)..(center[1] + left + 1).min(side) {
                let index = row as usize * SIDE + column as usize;
                if distance([row, column], center) > near && is_in(index) {
                    cells[index / GROUP] |= 1 << (index % GROUP);
                }
            }
        }
        Self::of(cells)
    }

    /// `choice(key, arange(n), p=set / set.sum())`; `None` from no cells.
    pub(super) fn choose(&self, key: Key) -> Option<usize> {
        if self.count == 0 {
            return None;
        }
        // What k cells of a group sum up to.
        let (mut sums, weight) = ([0.0_f32; GROUP + 1], 1.0 / self.count as f32);
        for k in 0..GROUP {
            sums[k + 1] = sums[k] + weight;
        }
        let (mut before, mut outer) = ([0.0_f32; GROUPS], 0.0_f32);
        for start in (0..GROUPS).step_by(GROUP) {
            let mut inner = 0.0;
            for group in start..start + GROUP {
                inner += sums[self.cells[group].count_ones() as usize];
                if group + 1 < GROUPS {
                    before[group + 1] = inner + outer;
                }
            }
            outer += inner;
        }
        let up_to = |index: usize| {
            let set = self.cells[index / GROUP] & (u16::MAX >> (GROUP - 1 - index % GROUP));
            sums[set.count_ones() as usize] + before[index / GROUP]
        };
        let wanted = up_to(SIDE * SIDE - 1) * (1.0 - key.uniform());
        // Where rounding makes the sum fall, the steps of the search count: these are JAX's.
        let (mut low, mut high) = (0, SIDE * SIDE);
        for _ in 0..=(SIDE * SIDE).ilog2() {
            let middle = usize::midpoint(low, high);
            *(if wanted <= up_to(middle) { &mut high } else { &mut low }) = middle;
        }
        Some(high.min(SIDE * SIDE - 1))
    }
}

/// Lets mobs appear.
pub(super) fn spawn(state: &mut State, key: Key, params: &Params) {
    let darkness = 1.0 - state.light;
    let zombie_chance = fused(params.zombie_night_chance, darkness * darkness, params.zombie_chance);
    let mut link = key;
    let mut appear = |kind: fn(&mut State) -> &mut [Mob], chance, health, near, grounds: &[Block]| {
        let (dice, choice) = (link.side(), link.next());
        link = choice.next();
        let place = 'place: {
            if dice.uniform() >= chance || kind(state).iter().all(|mob| mob.is_alive) {
                break 'place None;
            }
            let map = &state.map;
            let cells = Weights::around(state.player, near, params.despawn_distance, |index| {
                grounds.contains(&map.blocks[index]) && map.mobs[index / SIDE] >> (index % SIDE) & 1 == 0
            });
            cells.choose(choice.side())
        };
        let mobs = kind(state);
        // Where all live, the original means the first.
        let slot = mobs.iter().position(|mob| !mob.is_alive).unwrap_or(0);
        let mob = &mut mobs[slot];
        if let Some(index) = place {
            *mob = Mob { at: [(index / SIDE) as i32, (index % SIDE) as i32], health, is_alive: true, ..*mob };
        }
        let Mob { at, is_alive, .. } = *mob;
        if is_alive {
            state.map.set_mob(at, true);
        }
    };
    appear(|state| &mut state.cows, params.cow_chance, params.cow_health, 3, &[block::GRASS]);
    appear(|state| &mut state.zombies, zombie_chance, params.zombie_health, 9, &[block::GRASS, block::PATH]);
    appear(|state| &mut state.skeletons, params.skeleton_chance, params.skeleton_health, 9, &[block::PATH]);
}
