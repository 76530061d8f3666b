//! The middles of pixels side by side and what is nearest at each: of an image, a window in one, or a map of distances alone.

use std::ops::Range;

use super::lanes::{LANES, Lanes, load, splat};
use super::target::{NOTHING, Target, first};
use super::view::Area;

/// What is nearest at the middles of all pixels of an area. The arrays are longer than the pixels by one lane group.
#[derive(Debug, Default)]
pub(super) struct Grid<K> {
    area: Area,
    /// How near the nearest surface is; surfaces must be nearer to be seen.
    pub(super) nearness: Vec<f32>,
    /// What else is known of it.
    pub(super) known: K,
    /// Only surfaces less near than this are seen.
    limit: f32,
}

/// Which surface it is, too.
pub(super) type Raster = Grid<Owners>;

/// How near it is, and nothing else.
pub(super) type Distances = Grid<()>;

/// What grids keep of the nearest surfaces.
pub(super) trait Known {
    /// Nothing is seen at so many points.
    fn clear(&mut self, points: usize);

    /// A surface is seen at the points from `at` on whose bit in `mask` is set.
    fn mark(&mut self, at: usize, mask: u32, owner: u16, facet: Option<u32>);

    /// The same for one point.
    fn mark_one(&mut self, at: usize, owner: u16, facet: u32);
}

/// Which instances are seen.
#[derive(Debug, Default)]
pub(super) struct Owners {
    pub(super) owner: Vec<u16>,
    /// Which facet of it, where it is a mesh.
    pub(super) facet: Vec<u32>,
}

impl Known for () {
    fn clear(&mut self, _points: usize) {}

    fn mark(&mut self, _at: usize, _mask: u32, _owner: u16, _facet: Option<u32>) {}

    fn mark_one(&mut self, _at: usize, _owner: u16, _facet: u32) {}
}

impl Known for Owners {
    fn clear(&mut self, points: usize) {
        self.owner.clear();
        self.owner.resize(points, NOTHING);
        self.facet.resize(points, 0);
    }

    #[inline]
    fn mark(&mut self, at: usize, seen: u32, owner: u16, facet: Option<u32>) {
        mark((&mut self.owner[at..], &mut self.facet[at..]), seen, owner, facet);
    }

    #[inline]
    fn mark_one(&mut self, at: usize, owner: u16, facet: u32) {
        self.owner[at] = owner;
        self.facet[at] = facet;
    }
}

impl<K: Known> Grid<K> {
    /// Nothing is seen yet in an image of this width and height.
    pub(super) fn begin(&mut self, [width, height]: [usize; 2], limit: f32, farthest: f32) {
        (self.area, self.limit) = (Area { x0: 0, x1: width, y0: 0, y1: height }, limit);
        let points = self.len() + LANES;
        self.nearness.clear();
        self.nearness.resize(points, farthest);
        self.known.clear(points);
    }

    /// A window in an image: what is nearest there hides what is behind it, but is not known.
    pub(super) fn begin_window(&mut self, area: Area, image: &Self) {
        (self.area, self.limit) = (area, image.limit);
        let points = self.len() + LANES;
        self.nearness.clear();
        self.nearness.reserve(points);
        for row in area.y0..area.y1 {
            self.nearness.extend_from_slice(&image.nearness[image.within(row, area.x0, area.x1)]);
        }
        self.nearness.resize(points, 0.0);
        self.known.clear(points);
    }

    /// Makes room for so many pixels.
    pub(super) fn reserve(&mut self, pixels: usize) {
        self.nearness.reserve(pixels + LANES);
        self.known.clear(pixels + LANES);
    }

    pub(super) fn area(&self) -> &Area {
        &self.area
    }

    pub(super) fn width(&self) -> usize {
        self.area.x1 - self.area.x0
    }

    /// How many pixels there are.
    pub(super) fn len(&self) -> usize {
        self.width() * (self.area.y1 - self.area.y0)
    }
}

impl<K: Known> Target for Grid<K> {
    #[inline]
    fn density(&self) -> f32 {
        1.0
    }

    #[inline]
    fn extent(&self, left: f32, right: f32, top: f32, bottom: f32) -> Area {
        let Area { x0, x1, y0, y1 } = self.area;
        let ((x0, x1), (y0, y1)) = (centered(left, right, x0, x1), centered(top, bottom, y0, y1));
        Area { x0, x1, y0, y1 }
    }

    #[inline]
    fn within(&self, row: usize, x0: usize, x1: usize) -> Range<usize> {
        let start = (row - self.area.y0) * self.width();
        start + x0 - self.area.x0..start + x1 - self.area.x0
    }

    #[inline]
    fn point(&self, row: usize, at: usize) -> (f32, f32) {
        let start = (row - self.area.y0) * self.width();
        ((at + self.area.x0 - start) as i32 as f32 + 0.5, row as i32 as f32 + 0.5)
    }

    #[inline]
    fn points(&self, row: usize, at: usize) -> (Lanes, Lanes) {
        let start = (row - self.area.y0) * self.width();
        (centers(at + self.area.x0 - start), splat(row as i32 as f32 + 0.5))
    }

    #[inline]
    fn grid(&self) -> Option<&Area> {
        Some(&self.area)
    }

    #[inline]
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, owner: u16, facet: Option<u32>) {
        let nearest = load(&self.nearness[at..], 0.0);
        let seen = (nearness.simd_gt(nearest) & nearness.simd_lt(splat(self.limit))).to_bitmask() & mask;
        if seen != 0 {
            put(&mut self.nearness[at..], seen, nearness);
            self.known.mark(at, seen, owner, facet);
        }
    }

    #[inline]
    fn offer_one(&mut self, at: usize, nearness: f32, owner: u16, facet: u32) {
        if nearness > self.nearness[at] && nearness < self.limit {
            self.nearness[at] = nearness;
            self.known.mark_one(at, owner, facet);
        }
    }
}

/// The centers of pixels from column `x` on.
#[inline]
fn centers(x: usize) -> Lanes {
    splat(x as i32 as f32) + Lanes::new([0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5])
}

/// Columns (or rows) from `start` to `end` whose centers lie in `low..=high`.
#[inline]
fn centered(low: f32, high: f32, start: usize, end: usize) -> (usize, usize) {
    let place = low + 0.5;
    let whole = place as i32;
    let from = if whole as f32 == place { whole - 1 } else { whole };
    ((from as usize).max(start), ((high + 0.5) as i32 as usize).min(end))
}

/// Writes how near a surface is at the lanes whose bit is set.
#[inline]
pub(super) fn put(nearest: &mut [f32], mask: u32, nearness: Lanes) {
    let nearness = nearness.to_array();
    if mask == first(LANES) {
        nearest[..LANES].copy_from_slice(&nearness);
        return;
    }
    let nearest = &mut nearest[..LANES];
    let mut bits = mask;
    while bits != 0 {
        let lane = bits.trailing_zeros() as usize;
        nearest[lane] = nearness[lane];
        bits &= bits - 1;
    }
}

/// Writes which surface it is at the lanes whose bit is set.
#[inline]
pub(super) fn mark((owners, facets): (&mut [u16], &mut [u32]), mask: u32, owner: u16, facet: Option<u32>) {
    let (owners, facets) = (&mut owners[..LANES], &mut facets[..LANES]);
    if mask == first(LANES) {
        owners.fill(owner);
        if let Some(facet) = facet {
            facets.fill(facet);
        }
        return;
    }
    let mut bits = mask;
    while bits != 0 {
        let lane = bits.trailing_zeros() as usize;
        owners[lane] = owner;
        if let Some(facet) = facet {
            facets[lane] = facet;
        }
        bits &= bits - 1;
    }
}
