//! A frame's drawing as data: the primitives in order, with their bounds, so that two frames can be compared.
//!
//! Comparing is what makes incremental drawing exact without help from the environment: a pixel is a function of the
//! primitives over it, in order. Where two lists hold equal primitives at equal places in the order, that pixel cannot
//! have changed. So a wall that is drawn over the bodies in every frame costs a comparison, and no more.

use crate::painter::Rgb;
use crate::rect::Rect;

/// The kind of a primitive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Fill,
    Polygon,
    Disc,
    FatSegment,
    AaLine,
    SmoothPolygon,
    SmoothDisc,
    /// Its ends, in the exact style, are the bits of `f32`.
    SmoothLine,
    AxisLine,
    /// Its center; the radius is the side, negative if mirrored.
    TurnArrow,
}

#[derive(Debug, Clone)]
struct Item<C> {
    shape: Shape,
    color: Rgb,
    radius: C,
    first_point: usize,
    point_count: usize,
    bounds: Rect,
}

/// A primitive as the renderer reads it back.
#[derive(Debug, PartialEq)]
pub(crate) struct Primitive<'a, C> {
    pub(crate) shape: Shape,
    pub(crate) color: Rgb,
    /// Of discs and arrows; zero for the others.
    pub(crate) radius: C,
    pub(crate) points: &'a [[C; 2]],
    /// Every pixel that the primitive touches lies in here.
    pub(crate) bounds: Rect,
}

/// Primitives in drawing order, with coordinates of type `C`. Keeps its memory when cleared.
#[derive(Debug, Clone)]
pub(crate) struct DisplayList<C> {
    items: Vec<Item<C>>,
    points: Vec<[C; 2]>,
}

impl<C: Copy + PartialEq + Default> DisplayList<C> {
    pub(crate) fn new() -> Self {
        Self { items: Vec::with_capacity(32), points: Vec::with_capacity(128) }
    }

    pub(crate) fn clear(&mut self) {
        self.items.clear();
        self.points.clear();
    }

    pub(crate) fn push(
        &mut self,
        shape: Shape,
        points: impl Iterator<Item = [C; 2]>,
        radius: C,
        color: Rgb,
        bounds: Rect,
    ) {
        let first_point = self.points.len();
        self.points.extend(points);
        let point_count = self.points.len() - first_point;
        self.items.push(Item { shape, color, radius, first_point, point_count, bounds });
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = Primitive<'_, C>> {
        self.items.iter().map(|item| Primitive {
            shape: item.shape,
            color: item.color,
            radius: item.radius,
            points: &self.points[item.first_point..item.first_point + item.point_count],
            bounds: item.bounds,
        })
    }

    /// Names every primitive, of both lists, that has no equal at the same place of the other.
    pub(crate) fn changes_since(&self, old: &Self, mut changed: impl FnMut(&Primitive<'_, C>)) {
        let (mut old, mut new) = (old.iter(), self.iter());
        loop {
            let (before, after) = (old.next(), new.next());
            if before.is_none() && after.is_none() {
                return;
            }
            if before != after {
                [before, after].iter().flatten().for_each(&mut changed);
            }
        }
    }
}

impl<C: Copy + PartialEq + Default> PartialEq for DisplayList<C> {
    fn eq(&self, other: &Self) -> bool {
        self.items.len() == other.items.len() && self.iter().eq(other.iter())
    }
}
