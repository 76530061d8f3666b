//! Contact memory: the impulses of each pair's last contact, from which the solver starts again.
//!
//! A pair that touched in the previous substep starts from its old impulses. One that paused for one or two substeps
//! still inherits them, but they are not applied beforehand. After three substeps without contact a pair is forgotten.

use super::collide::Feature;
use super::shapes::MAX_PARTS;
use super::world::{Layout, MAX_LEAVES, WALLS};
use serde::{Deserialize, Serialize};

/// After how many substeps without contact a pair is forgotten.
const SUBSTEPS_REMEMBERED: u8 = 3;
/// At most this many pairs touch at once: all parts of the bodies with each other, and each part with two walls (no
/// part reaches opposite walls).
pub(super) const MAX_TOUCHING: usize = AGENT_BLOCK_PAIRS + 2 * MAX_LEAVES;

const AGENT_BLOCK_PAIRS: usize = MAX_PARTS * MAX_PARTS;
const WALL_PAIRS: usize = MAX_LEAVES * WALLS;

/// The number of an unordered pair of shapes that can touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct PairId(u8);

/// What a [`PairId`] stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pair {
    Wall { wall: usize, leaf: usize },
    AgentBlock { agent: usize, block: usize },
}

impl PairId {
    /// Number of pairs.
    pub(super) const COUNT: usize = AGENT_BLOCK_PAIRS + WALL_PAIRS;

    pub(super) fn wall(wall: usize, leaf: usize) -> PairId {
        PairId((AGENT_BLOCK_PAIRS + leaf * WALLS + wall) as u8)
    }

    /// The pair of the agent's part and the block's part with these numbers, each counted from 0.
    pub(super) fn agent_block(agent_part: usize, block_part: usize) -> PairId {
        PairId((agent_part * MAX_PARTS + block_part) as u8)
    }

    /// The pair, with leaf numbers.
    pub(super) fn pair(self, layout: Layout) -> Pair {
        let number = usize::from(self.0);
        match number.checked_sub(AGENT_BLOCK_PAIRS) {
            None => {
                Pair::AgentBlock { agent: number / MAX_PARTS, block: layout.agent_parts + number % MAX_PARTS }
            }
            Some(rest) => Pair::Wall { wall: rest % WALLS, leaf: rest / WALLS },
        }
    }

    fn bit(self) -> u64 {
        1 << self.0
    }

    fn exists(self, layout: Layout) -> bool {
        usize::from(self.0) < PairId::COUNT
            && match self.pair(layout) {
                Pair::AgentBlock { agent, block } => agent < layout.agent_parts && block < layout.leaves,
                Pair::Wall { leaf, .. } => leaf < layout.leaves && layout.meets_walls(leaf),
            }
    }
}

/// What is remembered of one pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Record {
    impulses: [f64; 2],
    /// Vertices with the wall or the agent's part first, as `4 * first + second`.
    features: [u8; 2],
    len: u8,
    /// Substeps since the last one in which the pair touched.
    pause: u8,
    block_first: bool,
}

/// A pair in contact, to be remembered.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Touch {
    pub(super) pair: PairId,
    pub(super) block_first: bool,
    pub(super) features: [Feature; 2],
    pub(super) len: usize,
}

impl Touch {
    fn code(&self, contact: usize) -> u8 {
        let Feature { first, second } = self.features[contact];
        if self.block_first { 4 * second + first } else { 4 * first + second }
    }
}

/// What the solver starts a pair from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Recalled {
    pub(super) impulses: [f64; 2],
    /// The pair touched in the previous substep: the impulses are applied before the first sweep.
    pub(super) apply: bool,
}

/// All remembered pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Memory {
    agent_block: [Record; AGENT_BLOCK_PAIRS],
    walls: [Record; WALL_PAIRS],
    /// Bit per pair: it is remembered. Records of other pairs are blank.
    remembered: u64,
    /// The pairs of the last substep in the order in which they were solved.
    touching: [PairId; MAX_TOUCHING],
    touching_len: u8,
}

impl Memory {
    pub(super) fn new() -> Memory {
        Memory {
            agent_block: [Record::default(); AGENT_BLOCK_PAIRS],
            walls: [Record::default(); WALL_PAIRS],
            remembered: 0,
            touching: [PairId::default(); MAX_TOUCHING],
            touching_len: 0,
        }
    }

    /// The impulses that the contacts of a pair inherit: from the remembered contact of the same identity, else 0.
    pub(super) fn recall(&self, touch: &Touch) -> Recalled {
        if self.remembered & touch.pair.bit() == 0 {
            return Recalled::default();
        }
        let record = self.record(touch.pair);
        let mut recalled = Recalled { impulses: [0.0; 2], apply: record.pause == 0 };
        for contact in 0..touch.len {
            let old = (0..usize::from(record.len)).find(|&old| record.features[old] == touch.code(contact));
            recalled.impulses[contact] = old.map_or(0.0, |old| record.impulses[old]);
        }
        recalled
    }

    /// Ends a substep: remembers the pairs that touched in it, in order, with the final impulses of their contacts
    /// one after the other, and ages the others.
    pub(super) fn renew(&mut self, touches: &[Touch], mut impulses: impl Iterator<Item = f64>) {
        let mut touched = 0;
        for touch in touches {
            let mut record =
                Record { len: touch.len as u8, block_first: touch.block_first, ..Record::default() };
            for contact in 0..touch.len {
                record.features[contact] = touch.code(contact);
                record.impulses[contact] = impulses.next().unwrap_or_default();
            }
            *self.record_mut(touch.pair) = record;
            touched |= touch.pair.bit();
        }
        let mut pausing = self.remembered & !touched;
        while pausing != 0 {
            let pair = PairId(pausing.trailing_zeros() as u8);
            pausing &= pausing - 1;
            let record = self.record_mut(pair);
            record.pause += 1;
            if record.pause >= SUBSTEPS_REMEMBERED {
                *record = Record::default();
                self.remembered &= !pair.bit();
            }
        }
        self.remembered |= touched;
        let before = usize::from(self.touching_len);
        self.touching_len = touches.len() as u8;
        for (slot, touch) in self.touching.iter_mut().zip(touches) {
            *slot = touch.pair;
        }
        for slot in self.touching.iter_mut().take(before).skip(touches.len()) {
            *slot = PairId::default();
        }
    }

    /// The pairs that touched in the last substep, in the order in which they were solved, each with whether the
    /// block's part counted as the first shape.
    pub(super) fn touching(&self) -> impl Iterator<Item = (PairId, bool)> + '_ {
        let pairs = &self.touching[..usize::from(self.touching_len)];
        pairs.iter().map(|&pair| (pair, self.record(pair).block_first))
    }

    /// Number of contact points of the last substep.
    pub(super) fn contact_points(&self) -> u32 {
        self.touching().map(|(pair, _)| u32::from(self.record(pair).len)).sum()
    }

    fn record(&self, pair: PairId) -> &Record {
        let number = usize::from(pair.0);
        match number.checked_sub(AGENT_BLOCK_PAIRS) {
            None => &self.agent_block[number],
            Some(rest) => &self.walls[rest],
        }
    }

    fn record_mut(&mut self, pair: PairId) -> &mut Record {
        let number = usize::from(pair.0);
        match number.checked_sub(AGENT_BLOCK_PAIRS) {
            None => &mut self.agent_block[number],
            Some(rest) => &mut self.walls[rest],
        }
    }

    /// True if a foreign state can be stepped with these bodies.
    pub(super) fn is_sound(&self, layout: Layout) -> bool {
        let all = (0..PairId::COUNT as u8).map(PairId);
        let records_fit = all.clone().all(|pair| {
            let record = self.record(pair);
            if self.remembered & pair.bit() == 0 {
                *record == Record::default()
            } else {
                pair.exists(layout) && record.len <= 2 && record.pause < SUBSTEPS_REMEMBERED
            }
        });
        let touching = self.touching.get(..usize::from(self.touching_len));
        records_fit
            && self.remembered >> PairId::COUNT == 0
            && touching.is_some_and(|touching| {
                touching.iter().enumerate().all(|(i, pair)| {
                    pair.exists(layout) && self.remembered & pair.bit() != 0 && !touching[..i].contains(pair)
                })
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAIR: PairId = PairId(0);

    fn touch(first: u8, second: u8) -> Touch {
        Touch { pair: PAIR, block_first: false, features: [Feature { first, second }; 2], len: 1 }
    }

    /// Impulse and flag that a contact finds which comes back after `pause` substeps without contact.
    fn after_pause(pause: usize, features: (u8, u8)) -> Recalled {
        let mut memory = Memory::new();
        memory.renew(&[touch(1, 2)], [5.0].into_iter());
        for _ in 0..pause {
            memory.renew(&[], [].into_iter());
        }
        memory.recall(&touch(features.0, features.1))
    }

    #[test]
    fn impulses_are_applied_inherited_then_forgotten() {
        assert_eq!(after_pause(0, (1, 2)), Recalled { impulses: [5.0, 0.0], apply: true });
        assert_eq!(after_pause(1, (1, 2)), Recalled { impulses: [5.0, 0.0], apply: false });
        assert_eq!(after_pause(2, (1, 2)), Recalled { impulses: [5.0, 0.0], apply: false });
        assert_eq!(after_pause(3, (1, 2)), Recalled::default());
    }

    #[test]
    fn another_contact_of_the_pair_inherits_nothing() {
        assert_eq!(after_pause(0, (2, 1)), Recalled { impulses: [0.0, 0.0], apply: true });
    }

    #[test]
    fn a_contact_keeps_its_identity_when_the_shapes_change_places() {
        let mut memory = Memory::new();
        memory.renew(&[touch(1, 2)], [5.0].into_iter());
        let swapped = Touch { block_first: true, ..touch(2, 1) };
        assert_eq!(memory.recall(&swapped).impulses[0], 5.0);
    }

    #[test]
    fn a_forgotten_pair_leaves_no_trace() {
        let mut memory = Memory::new();
        memory.renew(&[touch(1, 2)], [5.0].into_iter());
        assert_eq!(memory.contact_points(), 1);
        for _ in 0..3 {
            memory.renew(&[], [].into_iter());
        }
        assert_eq!(memory, Memory::new());
    }
}
