//! Chosen points of an image and what is nearest at each.

use std::ops::Range;

use super::grid::{mark, put};
use super::lanes::{LANES, Lanes, load};
use super::target::{NOTHING, Target};
use super::view::Area;

/// Where the four points of a pixel are that is an edge.
const POINTS: [(f32, f32); 4] = [(0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)];

/// What is nearest at chosen points. The arrays are longer than the points by one lane group.
#[derive(Debug, Default)]
pub(super) struct Samples {
    /// Positions in pixels.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) nearness: Vec<f32>,
    /// Only surfaces less near than this are seen.
    limit: Vec<f32>,
    pub(super) owner: Vec<u16>,
    pub(super) facet: Vec<u32>,
    /// `[H, W + 1]`: where the points of each pixel begin.
    starts: Vec<u32>,
    width: usize,
    height: usize,
    density: f32,
}

impl Samples {
    /// Makes room for so many points and pixels.
    pub(super) fn reserve(&mut self, points: usize, pixels: usize) {
        for column in [&mut self.x, &mut self.y, &mut self.nearness, &mut self.limit] {
            column.reserve(points);
        }
        self.owner.reserve(points);
        self.facet.reserve(points);
        self.starts.reserve(pixels);
    }

    /// Starts a list for images of this width, of points with this [`Target::density`].
    pub(super) fn begin(&mut self, width: usize, density: f32) {
        self.density = density;
        self.x.clear();
        self.y.clear();
        self.limit.clear();
        self.starts.clear();
        self.width = width;
    }

    /// Appends a point to the pixel that was [reached](Samples::reach) last.
    #[inline]
    pub(super) fn push(&mut self, x: f32, y: f32, limit: f32) {
        self.x.push(x);
        self.y.push(y);
        self.limit.push(limit);
    }

    /// Appends the row `y`, of which the pixels whose flag is not 0 have the four [`POINTS`] each, and the numbers of these
    /// pixels to `pixels`. Limits are set by [`Samples::end_with`].
    pub(super) fn push_row(&mut self, flags: &[u8], y: usize, pixels: &mut Vec<u32>) {
        let mut count = self.x.len() as u32;
        let (top, first) = (y as i32 as f32, (y * self.width) as u32);
        for (chunk, flags) in flags.chunks(LANES).enumerate() {
            if flags.iter().all(|&flag| flag == 0) {
                self.starts.extend_from_slice(&[count; LANES][..flags.len()]);
                continue;
            }
            for (&flag, column) in flags.iter().zip((LANES * chunk) as u32..) {
                self.starts.push(count);
                if flag != 0 {
                    let left = column as i32 as f32;
                    self.x.extend_from_slice(&POINTS.map(|(x, _)| left + x));
                    self.y.extend_from_slice(&POINTS.map(|(_, y)| top + y));
                    pixels.push(first + column);
                    count += POINTS.len() as u32;
                }
            }
        }
        self.starts.push(count);
    }

    /// All pixels before number `pixel` of the image are complete: the next points are of this pixel.
    #[inline]
    pub(super) fn reach(&mut self, pixel: usize) {
        // One more entry per row, for where it ends.
        let entries = pixel + pixel / self.width + 1;
        self.starts.resize(entries, self.x.len() as u32);
    }

    /// [`Samples::end`], where all points have the same limit.
    pub(super) fn end_with(&mut self, height: usize, farthest: f32, limit: f32) {
        self.limit.resize(self.x.len(), limit);
        self.end(height, farthest);
    }

    /// Ends the list of an image with so many rows. Nothing is seen yet.
    pub(super) fn end(&mut self, height: usize, farthest: f32) {
        let (count, padded) = (self.x.len(), self.x.len() + LANES);
        self.height = height;
        self.starts.resize(height * (self.width + 1), count as u32);
        self.x.resize(padded, 0.0);
        self.y.resize(padded, 0.0);
        self.limit.resize(padded, f32::NEG_INFINITY);
        self.nearness.clear();
        self.nearness.resize(padded, farthest);
        self.owner.clear();
        self.owner.resize(padded, NOTHING);
        self.facet.resize(padded, 0);
    }

    /// How many points there are.
    pub(super) fn len(&self) -> usize {
        self.x.len() - LANES
    }
}

impl Target for Samples {
    #[inline]
    fn density(&self) -> f32 {
        self.density
    }

    #[inline]
    fn extent(&self, left: f32, right: f32, top: f32, bottom: f32) -> Area {
        Area {
            x0: left as i32 as usize,
            x1: (right as i32 as usize + 1).min(self.width),
            y0: top as i32 as usize,
            y1: (bottom as i32 as usize + 1).min(self.height),
        }
    }

    #[inline]
    fn within(&self, row: usize, x0: usize, x1: usize) -> Range<usize> {
        let starts = &self.starts[row * (self.width + 1)..][..=self.width];
        starts[x0] as usize..starts[x1] as usize
    }

    #[inline]
    fn point(&self, _row: usize, at: usize) -> (f32, f32) {
        (self.x[at], self.y[at])
    }

    #[inline]
    fn points(&self, _row: usize, at: usize) -> (Lanes, Lanes) {
        (load(&self.x[at..], 0.0), load(&self.y[at..], 0.0))
    }

    #[inline]
    fn grid(&self) -> Option<&Area> {
        None
    }

    #[inline]
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, owner: u16, facet: Option<u32>) {
        let (known, limit) = (load(&self.nearness[at..], 0.0), load(&self.limit[at..], 0.0));
        let seen = (nearness.simd_gt(known) & nearness.simd_lt(limit)).to_bitmask() & mask;
        if seen != 0 {
            put(&mut self.nearness[at..], seen, nearness);
            mark((&mut self.owner[at..], &mut self.facet[at..]), seen, owner, facet);
        }
    }

    #[inline]
    fn offer_one(&mut self, at: usize, nearness: f32, owner: u16, facet: u32) {
        if nearness > self.nearness[at] && nearness < self.limit[at] {
            self.nearness[at] = nearness;
            self.owner[at] = owner;
            self.facet[at] = facet;
        }
    }
}
