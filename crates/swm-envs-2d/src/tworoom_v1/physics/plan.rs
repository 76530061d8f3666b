//! The floor plan: where borders, wall pieces and doors are. Pieces follow the reference's arithmetic, whose stripes are
//! half as thick as their names say, and whose dividing wall stands 9 px left of (above) the middle.

use super::{Aabb, Vec2, vec2};
use crate::pusht::physics::prefers_second;

/// Side of the canvas, pixels.
const CANVAS_PX: f64 = 512.0;
/// Nominal border, pixels: the rooms begin here.
const BORDER_PX: i64 = 9;
/// Length of the dividing wall, pixels.
pub(crate) const INNER_PX: i64 = 494;
/// Where the dividing wall stands on its axis, pixels.
pub(crate) const WALL_AT_PX: f64 = 247.0;
/// How far a border reaches to either side of the canvas's edge, pixels.
const BORDER_HALF_PX: f64 = 2.25;

/// The orientation of the dividing wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    /// It runs from left to right; the rooms are above and below.
    Horizontal,
    /// It runs from top to bottom; the rooms are left and right.
    Vertical,
}

impl Axis {
    /// The coordinate across the wall, and the one along it.
    pub(crate) fn split(self, point: Vec2) -> (f64, f64) {
        match self {
            Axis::Horizontal => (point.y, point.x),
            Axis::Vertical => (point.x, point.y),
        }
    }

    /// The point with these coordinates across and along the wall.
    pub(crate) fn join(self, across: f64, along: f64) -> Vec2 {
        match self {
            Axis::Horizontal => vec2(along, across),
            Axis::Vertical => vec2(across, along),
        }
    }
}

/// A rectangle of the dividing wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) area: Aabb,
    /// A door is rendered, and not solid.
    pub(crate) is_door: bool,
}

/// A gap between solid pieces, in canvas coordinates along the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Opening {
    pub(crate) from: f64,
    pub(crate) to: f64,
}

impl Opening {
    pub(crate) fn length(&self) -> f64 {
        self.to - self.from
    }

    pub(crate) fn middle(&self) -> f64 {
        0.5 * (self.from + self.to)
    }
}

/// All rectangles of an episode.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FloorPlan {
    pub(crate) axis: Axis,
    /// Half of what the dividing wall is thick, pixels: a quarter of the factor's value.
    pub(crate) half_thickness: f64,
    /// Top, right, bottom, left.
    pub(crate) borders: [Aabb; 4],
    /// Wall pieces and doors in order along the wall.
    pub(crate) pieces: Vec<Piece>,
    /// Borders and pieces in the order of the reference's search tree; doors are kept, since they count as places.
    search_order: Vec<Piece>,
}

impl FloorPlan {
    /// The plan for doors given as `(start, length)` along the wall, pixels from its end.
    pub(crate) fn new(axis: Axis, thickness: i64, doors: &[(i64, i64)]) -> FloorPlan {
        let half_thickness = thickness as f64 / 4.0;
        let stripe = |[from, to]: [i64; 2], is_door: bool| {
            let end = |t: i64| (BORDER_PX + t) as f64;
            let min = axis.join(WALL_AT_PX - half_thickness, end(from));
            let max = axis.join(WALL_AT_PX + half_thickness, end(to));
            Piece { area: Aabb { min, max }, is_door }
        };
        let mut pieces = Vec::with_capacity(2 * doors.len() + 1);
        let mut current = 0;
        for (start, end) in merged(doors) {
            let (start, end) = (start.clamp(0, INNER_PX), end.clamp(0, INNER_PX));
            let wall = [current, (start - 1).clamp(0, INNER_PX)];
            // One pixel on either side of a door belongs to no piece: openings are 2 px longer than doors.
            for (span, is_door) in [(wall, false), ([start, end], true)] {
                if span[1] - span[0] >= 1 {
                    pieces.push(stripe(span, is_door));
                }
            }
            current = end + 1;
        }
        if INNER_PX - current >= 1 {
            pieces.push(stripe([current, INNER_PX], false));
        }
        let borders = borders();
        let walls = borders.iter().map(|&area| Piece { area, is_door: false });
        let search_order = search_order(walls.chain(pieces.iter().copied()));
        FloorPlan { axis, half_thickness, borders, pieces, search_order }
    }

    /// Every rectangle in the order of the reference's search tree.
    pub(super) fn search_order(&self) -> &[Piece] {
        &self.search_order
    }

    /// The solid rectangles.
    pub(super) fn solids(&self) -> impl DoubleEndedIterator<Item = &Aabb> {
        self.search_order.iter().filter(|piece| !piece.is_door).map(|piece| &piece.area)
    }

    /// The gaps between the solid pieces of the dividing wall, those at its ends included.
    pub(crate) fn openings(&self) -> impl Iterator<Item = Opening> {
        let ends = |piece: &Piece| (self.axis.split(piece.area.min).1, self.axis.split(piece.area.max).1);
        let last = CANVAS_PX - BORDER_HALF_PX;
        let solid = self.pieces.iter().filter(|piece| !piece.is_door).map(ends);
        let starts = std::iter::once(BORDER_HALF_PX).chain(solid.clone().map(|(_, end)| end));
        let stops = solid.map(|(start, _)| start).chain([last]);
        starts.zip(stops).map(|(from, to)| Opening { from, to })
    }
}

/// Doors sorted by start; one that begins before or where the last ends lengthens that one.
fn merged(doors: &[(i64, i64)]) -> Vec<(i64, i64)> {
    let mut sorted: Vec<(i64, i64)> = doors.iter().map(|&(start, length)| (start, start + length)).collect();
    sorted.sort_by_key(|&(start, _)| start);
    let mut merged: Vec<(i64, i64)> = Vec::with_capacity(sorted.len());
    for (start, end) in sorted {
        match merged.last_mut() {
            Some(last) if start <= last.1 => last.1 = last.1.max(end),
            _ => merged.push((start, end)),
        }
    }
    merged
}

fn borders() -> [Aabb; 4] {
    let (low, high) = (BORDER_HALF_PX, CANVAS_PX - BORDER_HALF_PX);
    let outside = CANVAS_PX + BORDER_HALF_PX;
    let rectangle = |x0, y0, x1, y1| Aabb { min: vec2(x0, y0), max: vec2(x1, y1) };
    [
        rectangle(0.0, -low, CANVAS_PX, low),
        rectangle(high, 0.0, outside, CANVAS_PX),
        rectangle(0.0, high, CANVAS_PX, outside),
        rectangle(-low, 0.0, low, CANVAS_PX),
    ]
}

/// A node of the search tree over fixed boxes; the box of an inner node is the union of its children's.
enum Node {
    Leaf(Piece),
    Inner(Aabb, Box<[Node; 2]>),
}

impl Node {
    fn area(&self) -> &Aabb {
        match self {
            Node::Leaf(piece) => &piece.area,
            Node::Inner(area, _) => area,
        }
    }

    /// The tree with one more leaf, by the rule of PushT's tree: newcomers stand first.
    fn with(self, newcomer: Piece) -> Node {
        let children = match self {
            Node::Leaf(_) => [Node::Leaf(newcomer), self],
            Node::Inner(_, children) => {
                let [first, second] = *children;
                if prefers_second(first.area(), second.area(), &newcomer.area) {
                    [first, second.with(newcomer)]
                } else {
                    [first.with(newcomer), second]
                }
            }
        };
        Node::Inner(children[0].area().union(children[1].area()), Box::new(children))
    }

    fn collect(self, order: &mut Vec<Piece>) {
        match self {
            Node::Leaf(piece) => order.push(piece),
            Node::Inner(_, children) => children.into_iter().for_each(|child| child.collect(order)),
        }
    }
}

/// Left to right in the tree that arises by inserting the rectangles one by one.
fn search_order(mut rectangles: impl Iterator<Item = Piece>) -> Vec<Piece> {
    let mut order = Vec::with_capacity(12);
    if let Some(first) = rectangles.next() {
        rectangles.fold(Node::Leaf(first), Node::with).collect(&mut order);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spans(plan: &FloorPlan) -> Vec<(f64, f64, bool)> {
        let along = |point| plan.axis.split(point).1;
        let span = |piece: &Piece| (along(piece.area.min), along(piece.area.max), piece.is_door);
        plan.pieces.iter().map(span).collect()
    }

    #[test]
    fn pieces_are_the_published_ones() {
        let plan = FloorPlan::new(Axis::Vertical, 19, &[(298, 84)]);
        assert_eq!(spans(&plan), [(9.0, 306.0, false), (307.0, 391.0, true), (392.0, 503.0, false)]);
        assert_eq!((plan.pieces[0].area.min.x, plan.pieces[0].area.max.x), (242.25, 251.75));
        let ends: Vec<_> = plan.openings().map(|opening| (opening.from, opening.to)).collect();
        assert_eq!(ends, [(2.25, 9.0), (306.0, 392.0), (503.0, 509.75)]);
    }

    #[test]
    fn a_door_at_the_end_leaves_no_piece_behind() {
        let plan = FloorPlan::new(Axis::Horizontal, 16, &[(414, 45), (477, 60)]);
        assert_eq!(
            spans(&plan),
            [(9.0, 422.0, false), (423.0, 468.0, true), (469.0, 485.0, false), (486.0, 503.0, true)]
        );
        assert_eq!(plan.pieces[0].area.min, vec2(9.0, 243.0));
        assert_eq!(plan.openings().last(), Some(Opening { from: 485.0, to: 509.75 }));
    }

    #[test]
    fn doors_that_touch_are_one() {
        let plan = FloorPlan::new(Axis::Vertical, 19, &[(200, 30), (100, 50), (150, 20)]);
        assert_eq!(spans(&plan)[1..4], [(109.0, 179.0, true), (180.0, 208.0, false), (209.0, 239.0, true)]);
    }

    #[test]
    fn the_search_order_has_every_rectangle_once() {
        let plan = FloorPlan::new(Axis::Vertical, 19, &[(40, 50), (220, 60), (380, 45)]);
        assert_eq!(plan.search_order().len(), 4 + 7);
        for piece in &plan.pieces {
            assert_eq!(plan.search_order().iter().filter(|other| *other == piece).count(), 1);
        }
        assert_eq!(plan.solids().count(), 4 + 4);
    }
}
