//! Which pairs of shapes are tested for contact, and in which order.
//!
//! Each moving part has an enlarged box. While the part stays inside it nothing is searched: the pairs found when the
//! box was made are remembered and tested again. The order of the tests follows the tree from left to right, and among
//! the remembered pairs of one part the most recent comes first. The solver takes its constraints in this order.

use super::bodies::{Body, Placed};
use super::math::{Aabb, Vec2, vec2};
use super::memory::PairId;
use super::shapes::MAX_PARTS;
use super::tree::Tree;
use super::world::{BodyId, Layout, MAX_LEAVES, WALL_BOXES, WALLS, World};
use serde::{Deserialize, Serialize};

/// By how much of its size, and of its velocity over one second, a box is enlarged.
const ENLARGEMENT: f64 = 0.1;

/// A pair to be tested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Test {
    pub(super) pair: PairId,
    /// For a pair of agent and block: the block's part is the first of the two. Elsewhere always false.
    pub(super) block_first: bool,
}

/// The tests of one substep, in order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tests {
    items: [Test; PairId::COUNT],
    len: usize,
}

impl Tests {
    pub(super) fn new() -> Tests {
        Tests { items: [Test::default(); PairId::COUNT], len: 0 }
    }

    pub(super) fn as_slice(&self) -> &[Test] {
        &self.items[..self.len]
    }

    fn push(&mut self, test: Test) {
        self.items[self.len] = test;
        self.len += 1;
    }
}

/// Someone that a leaf may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Partner {
    Wall(u8),
    Leaf(u8),
}

/// The remembered partners to the left of one leaf, oldest first: four walls and the parts of the other body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Partners {
    items: [Partner; WALLS + MAX_PARTS],
    len: u8,
}

impl Partners {
    const EMPTY: Partners = Partners { items: [Partner::Wall(0); WALLS + MAX_PARTS], len: 0 };

    fn as_slice(&self) -> &[Partner] {
        &self.items[..usize::from(self.len)]
    }

    fn push(&mut self, partner: Partner) {
        self.items[usize::from(self.len)] = partner;
        self.len += 1;
    }

    fn remove(&mut self, partner: Partner) {
        let mut kept = Partners::EMPTY;
        for &item in self.as_slice().iter().filter(|&&item| item != partner) {
            kept.push(item);
        }
        *self = kept;
    }
}

/// The state of the search: enlarged boxes, tree and remembered pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct BroadPhase {
    boxes: [Aabb; MAX_LEAVES],
    tree: Tree,
    partners: [Partners; MAX_LEAVES],
}

impl BroadPhase {
    /// Takes the leaves in, one by one in the order of their numbers, as bodies at rest.
    pub(super) fn new(world: &World, placed: &Placed) -> BroadPhase {
        let mut this = BroadPhase {
            boxes: [Aabb::default(); MAX_LEAVES],
            tree: Tree::new(),
            partners: [Partners::EMPTY; MAX_LEAVES],
        };
        for leaf in 0..world.layout.leaves {
            this.boxes[leaf] = enlarged(&placed.boxes[leaf], Vec2::ZERO);
            this.tree.insert(leaf, &this.boxes);
            this.search(leaf, 1 << leaf, world.layout, &mut Tests::new());
        }
        this
    }

    /// Follows the leaves to their present places and lists the pairs to test.
    pub(super) fn update(&mut self, world: &World, placed: &Placed, bodies: &[Body; 2], tests: &mut Tests) {
        let layout = world.layout;
        let mut moved = 0_u8;
        for step in 0..layout.leaves {
            // The order in which the reference's hash table yields them.
            let leaf = if layout.leaves <= 4 { (step + 1) % layout.leaves } else { step };
            if !self.boxes[leaf].contains(&placed.boxes[leaf]) {
                self.boxes[leaf] =
                    enlarged(&placed.boxes[leaf], bodies[layout.body_of(leaf) as usize].motion.linear);
                self.tree.reinsert(leaf, &self.boxes);
                self.forget(leaf, layout);
                moved |= 1 << leaf;
            }
        }
        tests.len = 0;
        for leaf in self.tree.order().iter() {
            if moved & (1 << leaf) != 0 {
                self.search(leaf, moved, layout, tests);
            } else {
                for &partner in self.partners[leaf].as_slice().iter().rev() {
                    tests.push(match partner {
                        Partner::Wall(wall) => wall_test(usize::from(wall), leaf),
                        Partner::Leaf(other) => leaf_test(usize::from(other), leaf, layout),
                    });
                }
            }
        }
    }

    /// Deletes all remembered pairs that name a leaf.
    fn forget(&mut self, leaf: usize, layout: Layout) {
        self.partners[leaf] = Partners::EMPTY;
        for partners in &mut self.partners[..layout.leaves] {
            partners.remove(Partner::Leaf(leaf as u8));
        }
    }

    /// Finds the partners of a leaf that moved. Pairs with a partner further left are tested now; those with a partner
    /// further right are remembered there and tested in its turn.
    fn search(&mut self, leaf: usize, moved: u8, layout: Layout, tests: &mut Tests) {
        let BroadPhase { boxes, tree, partners } = self;
        let own = boxes[leaf];
        if layout.meets_walls(leaf) {
            for wall in (0..WALLS).rev() {
                if WALL_BOXES[wall].intersects(&own) {
                    partners[leaf].push(Partner::Wall(wall as u8));
                    tests.push(wall_test(wall, leaf));
                }
            }
        }
        tree.climb(leaf, |is_second, others| {
            for other in others.iter() {
                if layout.body_of(other) == layout.body_of(leaf) || !boxes[other].intersects(&own) {
                    continue;
                }
                if !is_second {
                    partners[other].push(Partner::Leaf(leaf as u8));
                    continue;
                }
                if moved & (1 << other) == 0 {
                    partners[leaf].push(Partner::Leaf(other as u8));
                }
                tests.push(leaf_test(leaf, other, layout));
            }
        });
    }

    /// True if a foreign state can be stepped with these bodies.
    pub(super) fn is_sound(&self, layout: Layout) -> bool {
        let capacity = WALLS + MAX_PARTS;
        if self.partners.iter().any(|partners| usize::from(partners.len) > capacity) {
            return false;
        }
        // Each pair at most once, and only pairs that can touch: this bounds the number of tests.
        let pairs_fit = self.partners.iter().enumerate().all(|(leaf, partners)| {
            let own = partners.as_slice();
            own.iter().enumerate().all(|(place, partner)| {
                let possible = match *partner {
                    Partner::Wall(wall) => usize::from(wall) < WALLS && layout.meets_walls(leaf),
                    Partner::Leaf(other) => {
                        let other = usize::from(other);
                        other < layout.leaves
                            && layout.body_of(other) != layout.body_of(leaf)
                            && !self.partners[other].as_slice().contains(&Partner::Leaf(leaf as u8))
                    }
                };
                possible && leaf < layout.leaves && !own[..place].contains(partner)
            })
        });
        pairs_fit && self.tree.is_sound(layout.leaves)
    }
}

fn wall_test(wall: usize, leaf: usize) -> Test {
    Test { pair: PairId::wall(wall, leaf), block_first: false }
}

/// The test of a pair of which the leaf `first` counts as the first shape.
fn leaf_test(first: usize, second: usize, layout: Layout) -> Test {
    let block_first = layout.body_of(first) == BodyId::Block;
    let (agent, block) = if block_first { (second, first) } else { (first, second) };
    Test {
        pair: PairId::agent_block(agent, block - layout.agent_parts),
        block_first: block_first && !layout.agent_is_disc,
    }
}

/// A box with room to move: a tenth of its size to all sides, more in the direction of the velocity.
pub(crate) fn enlarged(tight: &Aabb, velocity: Vec2) -> Aabb {
    let room = (tight.max - tight.min) * ENLARGEMENT;
    let ahead = velocity * ENLARGEMENT;
    Aabb {
        min: tight.min + vec2(ahead.x.min(-room.x), ahead.y.min(-room.y)),
        max: tight.max + vec2(ahead.x.max(room.x), ahead.y.max(room.y)),
    }
}
