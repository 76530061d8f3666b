//! What the world consists of: blocks, actions, achievements, and the constants of the game.

/// A kind of block. They are bytes, as the map is long and is saved with every state.
pub(super) type Block = u8;

/// The blocks, by the numbers of the original.
pub(super) mod block {
    use super::Block;

    pub(in super::super) const OUT_OF_BOUNDS: Block = 1;
    pub(in super::super) const GRASS: Block = 2;
    pub(in super::super) const WATER: Block = 3;
    pub(in super::super) const STONE: Block = 4;
    pub(in super::super) const TREE: Block = 5;
    pub(in super::super) const PATH: Block = 7;
    pub(in super::super) const COAL: Block = 8;
    pub(in super::super) const IRON: Block = 9;
    pub(in super::super) const DIAMOND: Block = 10;
    pub(in super::super) const TABLE: Block = 11;
    pub(in super::super) const FURNACE: Block = 12;
    pub(in super::super) const SAND: Block = 13;
    pub(in super::super) const LAVA: Block = 14;
    pub(in super::super) const PLANT: Block = 15;
    pub(in super::super) const RIPE_PLANT: Block = 16;
}

/// Number of kinds of blocks, the two that no world has included.
pub(super) const BLOCKS: usize = 17;

/// Whether nobody can walk onto a block.
pub(super) fn is_solid(of: Block) -> bool {
    use block::{COAL, DIAMOND, FURNACE, IRON, PLANT, RIPE_PLANT, STONE, TABLE, TREE, WATER};
    const SOLID: u32 = bits(&[WATER, STONE, TREE, COAL, IRON, DIAMOND, TABLE, FURNACE, PLANT, RIPE_PLANT]);
    SOLID >> of & 1 == 1
}

const fn bits(blocks: &[Block]) -> u32 {
    let (mut set, mut i) = (0, 0);
    while i < blocks.len() {
        set |= 1 << blocks[i];
        i += 1;
    }
    set
}

/// The actions, by the numbers of the original. Directions are actions, too.
pub(super) mod action {
    pub(in super::super) const NOOP: i64 = 0;
    pub(in super::super) const LEFT: i64 = 1;
    pub(in super::super) const RIGHT: i64 = 2;
    pub(in super::super) const UP: i64 = 3;
    pub(in super::super) const DOWN: i64 = 4;
    pub(in super::super) const DO: i64 = 5;
    pub(in super::super) const SLEEP: i64 = 6;
    pub(in super::super) const PLACE_STONE: i64 = 7;
    pub(in super::super) const PLACE_TABLE: i64 = 8;
    pub(in super::super) const PLACE_FURNACE: i64 = 9;
    pub(in super::super) const PLACE_PLANT: i64 = 10;
    pub(in super::super) const MAKE_WOOD_PICKAXE: i64 = 11;
    pub(in super::super) const MAKE_STONE_PICKAXE: i64 = 12;
    pub(in super::super) const MAKE_IRON_PICKAXE: i64 = 13;
    pub(in super::super) const MAKE_WOOD_SWORD: i64 = 14;
    pub(in super::super) const MAKE_STONE_SWORD: i64 = 15;
    pub(in super::super) const MAKE_IRON_SWORD: i64 = 16;
}

/// Number of actions.
pub(super) const ACTIONS: usize = 17;

/// A cell, or a step between cells: row and column.
pub(super) type Cell = [i32; 2];

/// Where an action of walking leads; nowhere for all others.
pub(super) fn direction(action: i64) -> Cell {
    match action {
        action::LEFT => [0, -1],
        action::RIGHT => [0, 1],
        action::UP => [-1, 0],
        action::DOWN => [1, 0],
        _ => [0, 0],
    }
}

pub(super) fn plus(a: Cell, b: Cell) -> Cell {
    [a[0] + b[0], a[1] + b[1]]
}

pub(super) fn minus(a: Cell, b: Cell) -> Cell {
    [a[0] - b[0], a[1] - b[1]]
}

/// Steps between two cells along rows and columns.
pub(super) fn distance(a: Cell, b: Cell) -> i32 {
    let [rows, columns] = minus(a, b);
    rows.abs() + columns.abs()
}

/// The achievements, by the numbers of the original.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Achievement {
    CollectWood,
    PlaceTable,
    EatCow,
    CollectSapling,
    CollectDrink,
    MakeWoodPickaxe,
    MakeWoodSword,
    PlacePlant,
    DefeatZombie,
    CollectStone,
    PlaceStone,
    EatPlant,
    DefeatSkeleton,
    MakeStonePickaxe,
    MakeStoneSword,
    WakeUp,
    PlaceFurnace,
    CollectCoal,
    CollectIron,
    CollectDiamond,
    MakeIronPickaxe,
    MakeIronSword,
}

/// Number of achievements.
pub(super) const ACHIEVEMENTS: usize = 22;

/// What of the game can be changed; the defaults are the original's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Params {
    /// Steps from one evening to the next.
    pub(super) day_length: i32,
    /// Whether every world has a diamond.
    pub(super) always_diamond: bool,
    pub(super) zombie_health: i32,
    pub(super) cow_health: i32,
    pub(super) skeleton_health: i32,
    /// Mobs at this distance from the player or beyond vanish, and none appear there, cells.
    pub(super) despawn_distance: i32,
    /// Probabilities per step that one appears, if there is room.
    pub(super) cow_chance: f32,
    pub(super) zombie_chance: f32,
    /// What is added to it in full darkness.
    pub(super) zombie_night_chance: f32,
    pub(super) skeleton_chance: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            day_length: 300,
            always_diamond: true,
            zombie_health: 5,
            cow_health: 3,
            skeleton_health: 3,
            despawn_distance: 14,
            cow_chance: 0.1,
            zombie_chance: 0.02,
            zombie_night_chance: 0.1,
            skeleton_chance: 0.05,
        }
    }
}

/// Steps after which the original ends an episode.
pub(super) const TIME_LIMIT: u32 = 10_000;
