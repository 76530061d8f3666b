//! The ordered box tree: a binary tree over the moving parts whose left-to-right order decides in which order contacts
//! are solved.
//!
//! It accelerates nothing here (there are at most six leaves). It is kept because the solver does not converge, so the
//! order of its constraints shows in the result, and this tree is where the reference's order comes from.

use super::math::Aabb;
use super::world::MAX_LEAVES;
use serde::{Deserialize, Serialize};

const MAX_NODES: usize = 2 * MAX_LEAVES - 1;
/// No node: the parent of the root, the root of an empty tree.
const NONE: u8 = u8::MAX;

/// The boxes of the leaves, by leaf.
pub(super) type Boxes = [Aabb; MAX_LEAVES];

/// Nodes below [`MAX_LEAVES`] are leaves, the others inner nodes with a first and a second child.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Tree {
    root: u8,
    parents: [u8; MAX_NODES],
    children: [[u8; 2]; MAX_LEAVES - 1],
    /// The leaves from left to right; the first `len` entries are in use.
    order: [u8; MAX_LEAVES],
    len: u8,
}

/// Whether a newcomer goes below the second of two children: where the boxes grow less, else where it is nearer.
pub(crate) fn prefers_second(first: &Aabb, second: &Aabb, newcomer: &Aabb) -> bool {
    let cost_first = second.area() + first.union(newcomer).area();
    let cost_second = first.area() + second.union(newcomer).area();
    if cost_first == cost_second {
        second.proximity(newcomer) < first.proximity(newcomer)
    } else {
        cost_second < cost_first
    }
}

/// A list of leaves.
#[derive(Clone, Copy, Default)]
pub(super) struct Leaves {
    items: [u8; MAX_LEAVES],
    len: usize,
}

impl Leaves {
    pub(super) fn iter(&self) -> impl Iterator<Item = usize> + use<> {
        self.items.into_iter().take(self.len).map(usize::from)
    }
}

impl Tree {
    pub(super) fn new() -> Tree {
        Tree {
            root: NONE,
            parents: [NONE; MAX_NODES],
            children: [[NONE; 2]; MAX_LEAVES - 1],
            order: [0; MAX_LEAVES],
            len: 0,
        }
    }

    /// The leaves from left to right.
    pub(super) fn order(&self) -> Leaves {
        Leaves { items: self.order, len: usize::from(self.len) }
    }

    /// Adds a leaf that the tree does not have.
    pub(super) fn insert(&mut self, leaf: usize, boxes: &Boxes) {
        if self.root == NONE {
            self.root = leaf as u8;
        } else {
            // A tree of n leaves uses n - 1 inner nodes, so this one is free.
            let inner = MAX_LEAVES as u8 + self.len - 1;
            self.attach(leaf as u8, inner, boxes);
        }
        self.len += 1;
        self.renew_order();
    }

    /// Takes a leaf out and puts it back where its new box belongs.
    pub(super) fn reinsert(&mut self, leaf: usize, boxes: &Boxes) {
        let leaf = leaf as u8;
        let parent = self.parent(leaf);
        if parent == NONE {
            return;
        }
        let [first, second] = self.children(parent);
        let sibling = if first == leaf { second } else { first };
        self.replace(parent, sibling);
        self.attach(leaf, parent, boxes);
        self.renew_order();
    }

    /// Hangs a leaf into a tree that is not empty, with `inner` as its parent.
    fn attach(&mut self, leaf: u8, inner: u8, boxes: &Boxes) {
        let own = &boxes[usize::from(leaf)];
        let mut node = self.root;
        while let Some([first, second]) = self.inner_children(node) {
            let (box_first, box_second) = (self.box_of(first, boxes), self.box_of(second, boxes));
            node = if prefers_second(&box_first, &box_second, own) { second } else { first };
        }
        self.replace(node, inner);
        // The newcomer goes first.
        self.children[usize::from(inner) - MAX_LEAVES] = [leaf, node];
        self.parents[usize::from(leaf)] = inner;
        self.parents[usize::from(node)] = inner;
    }

    /// Puts `new` into the place of `old` below the parent of `old`.
    fn replace(&mut self, old: u8, new: u8) {
        let parent = self.parent(old);
        self.parents[usize::from(new)] = parent;
        if parent == NONE {
            self.root = new;
            return;
        }
        let children = &mut self.children[usize::from(parent) - MAX_LEAVES];
        let place = usize::from(children[0] != old);
        children[place] = new;
    }

    fn parent(&self, node: u8) -> u8 {
        self.parents[usize::from(node)]
    }

    fn children(&self, inner: u8) -> [u8; 2] {
        self.children[usize::from(inner) - MAX_LEAVES]
    }

    fn inner_children(&self, node: u8) -> Option<[u8; 2]> {
        (usize::from(node) >= MAX_LEAVES).then(|| self.children(node))
    }

    fn box_of(&self, node: u8, boxes: &Boxes) -> Aabb {
        match self.inner_children(node) {
            None => boxes[usize::from(node)],
            Some([first, second]) => self.box_of(first, boxes).union(&self.box_of(second, boxes)),
        }
    }

    fn renew_order(&mut self) {
        let mut leaves = Leaves::default();
        self.collect(self.root, &mut leaves);
        self.order = leaves.items;
    }

    fn collect(&self, node: u8, leaves: &mut Leaves) {
        match self.inner_children(node) {
            None => {
                leaves.items[leaves.len] = node;
                leaves.len += 1;
            }
            Some([first, second]) => {
                self.collect(first, leaves);
                self.collect(second, leaves);
            }
        }
    }

    /// Climbs from a leaf to the root. At every inner node: whether the leaf is below its second child, and the leaves
    /// below the other child from left to right.
    pub(super) fn climb(&self, leaf: usize, mut visit: impl FnMut(bool, Leaves)) {
        let mut node = leaf as u8;
        loop {
            let parent = self.parent(node);
            if parent == NONE {
                return;
            }
            let [first, second] = self.children(parent);
            let is_second = second == node;
            let mut others = Leaves::default();
            self.collect(if is_second { first } else { second }, &mut others);
            visit(is_second, others);
            node = parent;
        }
    }

    /// True if this is a tree over exactly the leaves `0..leaves`: what a foreign state must be checked for.
    pub(super) fn is_sound(&self, leaves: usize) -> bool {
        if usize::from(self.len) != leaves || leaves == 0 {
            return false;
        }
        let mut seen = [false; MAX_NODES];
        let mut order = [NONE; MAX_LEAVES];
        let mut count = 0;
        let mut pending = [NONE; MAX_NODES + 1];
        pending[0] = self.root;
        let mut depth = 1;
        let mut parent_of_root_is_none = false;
        while depth > 0 {
            depth -= 1;
            let node = usize::from(pending[depth]);
            if node >= MAX_NODES || seen[node] {
                return false;
            }
            seen[node] = true;
            if node == usize::from(self.root) {
                parent_of_root_is_none = self.parents[node] == NONE;
            }
            if node < MAX_LEAVES {
                if node >= leaves {
                    return false;
                }
                order[count] = node as u8;
                count += 1;
                continue;
            }
            let [first, second] = self.children(node as u8);
            for child in [second, first] {
                if usize::from(child) >= MAX_NODES
                    || usize::from(self.parent(child)) != node
                    || depth > MAX_NODES
                {
                    return false;
                }
                pending[depth] = child;
                depth += 1;
            }
        }
        parent_of_root_is_none && count == leaves && order[..count] == self.order[..count]
    }
}

#[cfg(test)]
mod tests {
    use super::super::math::vec2;
    use super::*;

    fn boxes(lefts: [f64; 3]) -> Boxes {
        let mut boxes = [Aabb::default(); MAX_LEAVES];
        for (leaf, left) in lefts.into_iter().enumerate() {
            boxes[leaf] = Aabb { min: vec2(left, 0.0), max: vec2(left + 10.0, 10.0) };
        }
        boxes
    }

    fn order(tree: &Tree) -> Vec<usize> {
        tree.order().iter().collect()
    }

    #[test]
    fn of_two_leaves_the_newcomer_is_first() {
        let boxes = boxes([0.0, 100.0, 0.0]);
        let mut tree = Tree::new();
        tree.insert(0, &boxes);
        tree.insert(1, &boxes);
        assert_eq!(order(&tree), [1, 0]);
        tree.reinsert(0, &boxes);
        assert_eq!(order(&tree), [0, 1]);
        tree.reinsert(0, &boxes);
        assert_eq!(order(&tree), [0, 1]);
        assert!(tree.is_sound(2) && !tree.is_sound(3));
    }

    #[test]
    fn of_three_leaves_the_newcomer_stands_before_its_nearer_neighbor() {
        let near_first = boxes([0.0, 100.0, 12.0]);
        let mut tree = Tree::new();
        for leaf in 0..3 {
            tree.insert(leaf, &near_first);
        }
        assert_eq!(order(&tree), [1, 2, 0]);
        let near_second = boxes([0.0, 100.0, 88.0]);
        tree.reinsert(2, &near_second);
        assert_eq!(order(&tree), [2, 1, 0]);
        assert!(tree.is_sound(3));
    }

    #[test]
    fn equal_costs_are_decided_by_nearness_then_for_the_first() {
        // Both siblings have the same size, and the newcomer lies inside both.
        let mut boxes = boxes([0.0, 0.0, 0.0]);
        boxes[2] = Aabb { min: vec2(4.0, 4.0), max: vec2(6.0, 6.0) };
        let mut tree = Tree::new();
        for leaf in 0..3 {
            tree.insert(leaf, &boxes);
        }
        assert_eq!(order(&tree), [2, 1, 0]);
    }

    #[test]
    fn climbing_shows_the_other_side_at_every_level() {
        let boxes = boxes([0.0, 100.0, 12.0]);
        let mut tree = Tree::new();
        for leaf in 0..3 {
            tree.insert(leaf, &boxes);
        }
        // The tree is (1 (2 0)).
        let mut seen = Vec::new();
        tree.climb(0, |is_second, others| seen.push((is_second, others.iter().collect::<Vec<_>>())));
        assert_eq!(seen, [(true, vec![2]), (true, vec![1])]);
        seen.clear();
        tree.climb(1, |is_second, others| seen.push((is_second, others.iter().collect::<Vec<_>>())));
        assert_eq!(seen, [(false, vec![2, 0])]);
    }
}
