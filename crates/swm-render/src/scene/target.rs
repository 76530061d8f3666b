//! What surfaces are drawn into. Which points there are and what is known of each is in `grid` and `samples`.

use std::ops::Range;

use super::lanes::{LANES, Lanes};
use super::view::Area;

/// What a sample shows where nothing is.
pub(super) const NOTHING: u16 = u16::MAX;

/// What surfaces are drawn into: points in rows of pixels, from left to right in each.
pub(super) trait Target {
    /// How many points there are along the length of a pixel, at odd halves of their spacing; or many, if they can be
    /// anywhere.
    fn density(&self) -> f32;

    /// The pixels whose points may lie in `left..=right` × `top..=bottom`, which is inside of the image.
    fn extent(&self, left: f32, right: f32, top: f32, bottom: f32) -> Area;

    /// The points in columns `x0..x1` of a row.
    fn within(&self, row: usize, x0: usize, x1: usize) -> Range<usize>;

    /// Positions in pixels of the point `at`.
    fn point(&self, row: usize, at: usize) -> (f32, f32);

    /// Positions in pixels of the points from `at` on; those beyond the row mean nothing.
    fn points(&self, row: usize, at: usize) -> (Lanes, Lanes);

    /// The pixels whose middles are the points, and nothing else is.
    fn grid(&self) -> Option<&Area>;

    /// Shows a surface at the points from `at` on whose bit in `mask` is set and where it is nearer than what is there.
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, owner: u16, facet: Option<u32>);

    /// The same for one point.
    fn offer_one(&mut self, at: usize, nearness: f32, owner: u16, facet: u32);
}

/// Bits of the first `count` lanes.
#[inline]
pub(super) fn first(count: usize) -> u32 {
    if count >= LANES { (1 << LANES) - 1 } else { (1 << count) - 1 }
}
