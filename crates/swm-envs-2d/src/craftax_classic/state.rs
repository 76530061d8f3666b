//! The state of a game, and the map that it is played on.

use serde::{Deserialize, Serialize};

use super::rules::{Achievement, BLOCKS, Block, Cell, action, block, is_solid};
use super::threefry::Key;

/// Rows and columns of the map.
pub(super) const SIDE: usize = 64;
/// The most of what lives or flies in a world at a time.
pub(super) const ZOMBIES: usize = 3;
pub(super) const COWS: usize = 3;
pub(super) const SKELETONS: usize = 2;
pub(super) const ARROWS: usize = 3;
pub(super) const PLANTS: usize = 10;

/// The blocks, row by row, and the cells on which mobs stand.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Map {
    #[serde(with = "bytes")]
    pub(super) blocks: Vec<Block>,
    /// A word per row, a bit per column. Mobs that vanish or die while two share a cell leave marks that differ from where
    /// mobs are, as in the original.
    #[serde(with = "rows")]
    pub(super) mobs: [u64; SIDE],
}

/// Where an index points to, as JAX reads it: -1 is the last one, all others beyond the map are the nearest.
fn read_at(index: i32) -> usize {
    let side = SIDE as i32;
    let index = if index < 0 { index + side } else { index };
    index.clamp(0, side - 1) as usize
}

/// Where JAX writes: nowhere beyond the map, but -1 is the last one.
fn written_at(index: i32) -> Option<usize> {
    let side = SIDE as i32;
    let index = if index < 0 { index + side } else { index };
    (0..side).contains(&index).then_some(index as usize)
}

impl Map {
    pub(super) fn new(blocks: Vec<Block>) -> Self {
        assert_eq!(blocks.len(), SIDE * SIDE, "a map of {SIDE} rows and columns");
        Self { blocks, mobs: [0; SIDE] }
    }

    pub(super) fn contains(cell: Cell) -> bool {
        cell.iter().all(|index| (0..SIDE as i32).contains(index))
    }

    /// The block of a cell; see [`read_at`] for cells beyond the map.
    pub(super) fn block(&self, [row, column]: Cell) -> Block {
        self.blocks[read_at(row) * SIDE + read_at(column)]
    }

    pub(super) fn set_block(&mut self, [row, column]: Cell, to: Block) {
        if let (Some(row), Some(column)) = (written_at(row), written_at(column)) {
            self.blocks[row * SIDE + column] = to;
        }
    }

    /// Whether a mob is marked on a cell.
    pub(super) fn has_mob(&self, [row, column]: Cell) -> bool {
        self.mobs[read_at(row)] >> read_at(column) & 1 == 1
    }

    pub(super) fn set_mob(&mut self, [row, column]: Cell, is_there: bool) {
        if let (Some(row), Some(column)) = (written_at(row), written_at(column)) {
            self.mobs[row] = self.mobs[row] & !(1 << column) | u64::from(is_there) << column;
        }
    }
}

/// Mobs of one kind. Those that are not `alive` keep a place and a health, and move on unseen: what the player does can call
/// them back, as in the original.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Mob {
    pub(super) at: Cell,
    pub(super) health: i32,
    pub(super) is_alive: bool,
    /// Steps until it may attack; 0 or less: it may.
    pub(super) cooldown: i32,
}

/// An arrow in flight, or a slot for one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Arrow {
    pub(super) at: Cell,
    pub(super) direction: Cell,
    pub(super) is_flying: bool,
}

/// A planted sapling, or a slot for one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Plant {
    pub(super) at: Cell,
    pub(super) age: i32,
    pub(super) is_growing: bool,
}

/// What the player carries, 0 to 9 of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Inventory {
    pub(super) wood: u8,
    pub(super) stone: u8,
    pub(super) coal: u8,
    pub(super) iron: u8,
    pub(super) diamond: u8,
    pub(super) sapling: u8,
    pub(super) wood_pickaxe: u8,
    pub(super) stone_pickaxe: u8,
    pub(super) iron_pickaxe: u8,
    pub(super) wood_sword: u8,
    pub(super) stone_sword: u8,
    pub(super) iron_sword: u8,
}

impl Inventory {
    /// All counts, in the order of the observation.
    pub(super) fn counts(mut self) -> [u8; 12] {
        self.all().map(|count| *count)
    }

    /// Drops what is more than `most` of a kind.
    pub(super) fn cap(&mut self, most: u8) {
        for count in self.all() {
            *count = most.min(*count);
        }
    }

    fn all(&mut self) -> [&mut u8; 12] {
        let Self {
            wood, stone, coal, iron, diamond, sapling, wood_pickaxe, stone_pickaxe, iron_pickaxe, ..
        } = self;
        let Self { wood_sword, stone_sword, iron_sword, .. } = self;
        [
            wood,
            stone,
            coal,
            iron,
            diamond,
            sapling,
            wood_pickaxe,
            stone_pickaxe,
            iron_pickaxe,
            wood_sword,
            stone_sword,
            iron_sword,
        ]
    }
}

/// How the player is. Health, food, drink and energy are 0 to 9; the others count up to the next change of these.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Vitals {
    pub(super) health: i32,
    pub(super) food: i32,
    pub(super) drink: i32,
    pub(super) energy: i32,
    pub(super) recover: f32,
    pub(super) hunger: f32,
    pub(super) thirst: f32,
    pub(super) fatigue: f32,
    pub(super) is_sleeping: bool,
}

/// Everything that changes in an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub(super) map: Map,
    pub(super) player: Cell,
    /// Where the player looks: the action of walking there.
    pub(super) direction: i64,
    pub(super) vitals: Vitals,
    pub(super) inventory: Inventory,
    pub(super) zombies: [Mob; ZOMBIES],
    pub(super) cows: [Mob; COWS],
    pub(super) skeletons: [Mob; SKELETONS],
    pub(super) arrows: [Arrow; ARROWS],
    pub(super) plants: [Plant; PLANTS],
    /// 0 at night to 1 by day.
    pub(super) light: f32,
    /// A bit per achievement.
    pub(super) achievements: u32,
    pub(super) steps: u32,
    /// The key of the steps to come.
    pub(super) key: [u32; 2],
    /// The key of the noise of a night image is the side key of the key after this one.
    pub(super) noise_key: [u32; 2],
}

impl State {
    /// The first state of an episode.
    pub(super) fn new(map: Map, cow_health: i32, light: f32, key: Key, noise_key: Key) -> Self {
        let mob = |health| Mob { at: [0, 0], health, is_alive: false, cooldown: 0 };
        Self {
            map,
            player: [SIDE as i32 / 2; 2],
            direction: action::UP,
            vitals: Vitals {
                health: 9,
                food: 9,
                drink: 9,
                energy: 9,
                recover: 0.0,
                hunger: 0.0,
                thirst: 0.0,
                fatigue: 0.0,
                is_sleeping: false,
            },
            inventory: Inventory::default(),
            zombies: [mob(1); ZOMBIES],
            cows: [mob(cow_health); COWS],
            skeletons: [mob(0); SKELETONS],
            arrows: [Arrow { at: [0, 0], direction: [1, 1], is_flying: false }; ARROWS],
            plants: [Plant::default(); PLANTS],
            light,
            achievements: 0,
            steps: 0,
            key: key.words(),
            noise_key: noise_key.words(),
        }
    }

    pub(super) fn achieve(&mut self, what: Achievement) {
        self.achievements |= 1 << what as u32;
    }

    pub(super) fn has_achieved(&self, what: Achievement) -> bool {
        self.achievements >> what as u32 & 1 == 1
    }

    /// Whether a mob or the player is on a cell.
    pub(super) fn is_occupied(&self, cell: Cell) -> bool {
        self.map.has_mob(cell) || self.player == cell
    }

    /// Whether a mob can walk onto a cell.
    pub(super) fn is_free(&self, cell: Cell) -> bool {
        let block = self.map.block(cell);
        Map::contains(cell) && !is_solid(block) && block != block::LAVA && !self.is_occupied(cell)
    }

    /// Refuses what no game leads to.
    pub(super) fn check(&self) -> Result<(), String> {
        let blocks = &self.map.blocks;
        if blocks.len() != SIDE * SIDE || blocks.iter().any(|&of| usize::from(of) >= BLOCKS) {
            return Err("its map is not 64 rows of 64 blocks".to_owned());
        }
        let Vitals { health, food, drink, energy, recover, hunger, thirst, fatigue, .. } = self.vitals;
        let levels = [health, food, drink, energy].iter().all(|level| (0..=9).contains(level));
        let counts = self.inventory.counts().iter().all(|&count| count <= 9);
        let finite = [recover, hunger, thirst, fatigue, self.light].iter().all(|value| value.is_finite());
        // Beyond the map by far less than what could overflow in an episode.
        let mobs = self.zombies.iter().chain(&self.cows).chain(&self.skeletons);
        let numbers = mobs.flat_map(|mob| [mob.at[0], mob.at[1], mob.health, mob.cooldown]);
        let arrows = self.arrows.iter().flat_map(|arrow| arrow.at.into_iter().chain(arrow.direction));
        let plants = self.plants.iter().flat_map(|plant| [plant.at[0], plant.at[1], plant.age]);
        let near = numbers.chain(arrows).chain(plants).chain(self.player).all(|n| n.abs() < 1 << 20);
        let directs = (1..=4).contains(&self.direction) && self.steps < 1 << 30;
        if levels && counts && finite && near && directs {
            Ok(())
        } else {
            Err("it holds numbers to which no game leads".to_owned())
        }
    }

    /// Whether the player stands in lava.
    pub(super) fn is_in_lava(&self) -> bool {
        self.map.block(self.player) == block::LAVA
    }
}

/// Blocks as one piece of bytes.
mod bytes {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(blocks: &[u8], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_bytes(blocks)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
        <&[u8]>::deserialize(from).map(<[u8]>::to_vec)
    }
}

/// The rows of marks as one piece of bytes.
mod rows {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    use super::SIDE;

    pub(super) fn serialize<S: Serializer>(rows: &[u64; SIDE], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_bytes(rows.map(u64::to_le_bytes).as_flattened())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[u64; SIDE], D::Error> {
        let bytes = <&[u8]>::deserialize(from)?;
        let (rows, rest) = bytes.as_chunks::<8>();
        match rows.try_into() {
            Ok(rows) if rest.is_empty() => {
                let rows: [[u8; 8]; SIDE] = rows;
                Ok(rows.map(u64::from_le_bytes))
            }
            _ => Err(D::Error::custom("the marks of mobs are not 64 rows")),
        }
    }
}
