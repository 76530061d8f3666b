//! Points of a picture and what is nearest at each: a whole raster, a chosen list, or a map of distances alone.

use std::ops::Range;

use super::lanes::{LANES, Lanes, load, splat};
use super::view::Area;

/// What a sample shows where nothing is.
pub(super) const NOTHING: u16 = u16::MAX;

/// What surfaces are drawn into: points in rows of pixels, from left to right in each.
pub(super) trait Target {
    /// How many points there are along the length of a pixel, at odd halves of their spacing; or many, if they can be
    /// anywhere.
    fn density(&self) -> f32;

    /// The pixels whose points may lie in `left..=right` × `top..=bottom`, which is inside of the picture.
    fn extent(&self, left: f32, right: f32, top: f32, bottom: f32) -> Area;

    /// The points in columns `x0..x1` of a row.
    fn within(&self, row: usize, x0: usize, x1: usize) -> Range<usize>;

    /// Positions in pixels of the point `at`.
    fn point(&self, row: usize, at: usize) -> (f32, f32);

    /// Positions in pixels of the points from `at` on; those beyond the row mean nothing.
    fn points(&self, row: usize, at: usize) -> (Lanes, Lanes);

    /// Shows a surface at the points from `at` on whose bit in `mask` is set and where it is nearer than what is there.
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, owner: u16, facet: Option<u32>);

    /// The same for one point.
    fn offer_one(&mut self, at: usize, nearness: f32, owner: u16, facet: u32);
}

/// What is nearest at the centres of all pixels. The arrays are longer than the pixels by one lane group.
#[derive(Debug, Default)]
pub(super) struct Raster {
    width: usize,
    height: usize,
    /// How near the nearest surface is; surfaces must be nearer to be seen.
    pub(super) nearness: Vec<f32>,
    /// Which instance that is.
    pub(super) owner: Vec<u16>,
    /// Which facet of it, where it is a mesh.
    pub(super) facet: Vec<u32>,
    /// Only surfaces less near than this are seen.
    limit: f32,
}

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

/// How near the nearest surface is, and nothing else.
#[derive(Debug, Default)]
pub(super) struct Distances {
    width: usize,
    height: usize,
    pub(super) nearness: Vec<f32>,
    limit: f32,
}

/// Bits of the first `count` lanes.
#[inline]
pub(super) fn first(count: usize) -> u32 {
    if count >= LANES { (1 << LANES) - 1 } else { (1 << count) - 1 }
}

/// The centres of pixels from column `x` on.
#[inline]
fn centres(x: usize) -> Lanes {
    splat(x as f32) + Lanes::new([0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5])
}

/// Columns (or rows) whose centres lie in `low..=high`.
#[inline]
fn centred(low: f32, high: f32, size: usize) -> (usize, usize) {
    let place = low + 0.5;
    let whole = place as i32;
    let start = if whole as f32 == place { whole - 1 } else { whole };
    (start as usize, ((high + 0.5) as i32 as usize).min(size))
}

impl Raster {
    /// Nothing is seen yet.
    pub(super) fn begin(&mut self, width: usize, height: usize, limit: f32, farthest: f32) {
        let padded = width * height + LANES;
        (self.width, self.height, self.limit) = (width, height, limit);
        self.nearness.clear();
        self.nearness.resize(padded, farthest);
        self.owner.clear();
        self.owner.resize(padded, NOTHING);
        self.facet.resize(padded, 0);
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// How many pixels there are.
    pub(super) fn len(&self) -> usize {
        self.width * self.height
    }
}

impl Target for Raster {
    #[inline]
    fn density(&self) -> f32 {
        1.0
    }

    #[inline]
    fn extent(&self, left: f32, right: f32, top: f32, bottom: f32) -> Area {
        let ((x0, x1), (y0, y1)) = (centred(left, right, self.width), centred(top, bottom, self.height));
        Area { x0, x1, y0, y1 }
    }

    #[inline]
    fn within(&self, row: usize, x0: usize, x1: usize) -> Range<usize> {
        row * self.width + x0..row * self.width + x1
    }

    #[inline]
    fn point(&self, row: usize, at: usize) -> (f32, f32) {
        ((at - row * self.width) as f32 + 0.5, row as f32 + 0.5)
    }

    #[inline]
    fn points(&self, row: usize, at: usize) -> (Lanes, Lanes) {
        (centres(at - row * self.width), splat(row as f32 + 0.5))
    }

    #[inline]
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, owner: u16, facet: Option<u32>) {
        let known = load(&self.nearness[at..], 0.0);
        let seen = (nearness.simd_gt(known) & nearness.simd_lt(splat(self.limit))).to_bitmask() & mask;
        put(
            (&mut self.nearness[at..], &mut self.owner[at..], &mut self.facet[at..]),
            seen,
            nearness,
            owner,
            facet,
        );
    }

    #[inline]
    fn offer_one(&mut self, at: usize, nearness: f32, owner: u16, facet: u32) {
        if nearness > self.nearness[at] && nearness < self.limit {
            self.nearness[at] = nearness;
            self.owner[at] = owner;
            self.facet[at] = facet;
        }
    }
}

/// Writes what is seen at the lanes whose bit is set.
#[inline]
fn put(
    (known, owners, facets): (&mut [f32], &mut [u16], &mut [u32]),
    mask: u32,
    nearness: Lanes,
    owner: u16,
    facet: Option<u32>,
) {
    if mask == 0 {
        return;
    }
    let nearness = nearness.to_array();
    if mask == first(LANES) {
        known[..LANES].copy_from_slice(&nearness);
        owners[..LANES].fill(owner);
        if let Some(facet) = facet {
            facets[..LANES].fill(facet);
        }
        return;
    }
    let mut bits = mask;
    while bits != 0 {
        let lane = bits.trailing_zeros() as usize;
        known[lane] = nearness[lane];
        owners[lane] = owner;
        if let Some(facet) = facet {
            facets[lane] = facet;
        }
        bits &= bits - 1;
    }
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

    /// Starts a list for pictures of this width, of points with this [`Target::density`].
    pub(super) fn begin(&mut self, width: usize, density: f32) {
        self.density = density;
        self.x.clear();
        self.y.clear();
        self.limit.clear();
        self.starts.clear();
        self.width = width;
    }

    /// Appends a point to the last pixel of [`Samples::end_pixels`].
    #[inline]
    pub(super) fn push(&mut self, x: f32, y: f32, limit: f32) {
        self.x.push(x);
        self.y.push(y);
        self.limit.push(limit);
    }

    /// All pixels before number `pixel` of the picture are complete: the next points are of this pixel.
    #[inline]
    pub(super) fn reach(&mut self, pixel: usize) {
        // One more entry per row, for where it ends.
        let entries = pixel + pixel / self.width + 1;
        self.starts.resize(entries, self.x.len() as u32);
    }

    /// Ends the list of a picture with so many rows. Nothing is seen yet.
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

    /// The list of the middles of all pixels of an area in a picture of this width and height. What is `seen` there so far,
    /// pixel by pixel of the picture, hides what is behind it; nothing is nearer than `limit`.
    pub(super) fn window(&mut self, area: &Area, [width, height]: [usize; 2], limit: f32, seen: &[f32]) {
        self.begin(width, 1.0);
        self.height = height;
        self.nearness.clear();
        self.starts.resize(area.y0 * (width + 1), 0);
        for y in area.y0..area.y1 {
            let first = self.x.len() as u32;
            self.x.extend((area.x0..area.x1).map(|x| x as f32 + 0.5));
            self.nearness.extend_from_slice(&seen[y * width + area.x0..y * width + area.x1]);
            let last = self.x.len() as u32;
            self.y.resize(self.x.len(), y as f32 + 0.5);
            self.starts.resize(self.starts.len() + area.x0, first);
            self.starts.extend(first..last);
            self.starts.resize((y + 1) * (width + 1), last);
        }
        let (count, padded) = (self.x.len(), self.x.len() + LANES);
        self.starts.resize(height * (width + 1), count as u32);
        self.limit.resize(count, limit);
        self.limit.resize(padded, f32::NEG_INFINITY);
        self.x.resize(padded, 0.0);
        self.y.resize(padded, 0.0);
        self.nearness.resize(padded, 0.0);
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
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, owner: u16, facet: Option<u32>) {
        let (known, limit) = (load(&self.nearness[at..], 0.0), load(&self.limit[at..], 0.0));
        let seen = (nearness.simd_gt(known) & nearness.simd_lt(limit)).to_bitmask() & mask;
        put(
            (&mut self.nearness[at..], &mut self.owner[at..], &mut self.facet[at..]),
            seen,
            nearness,
            owner,
            facet,
        );
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

impl Distances {
    /// Nothing is near yet.
    pub(super) fn begin(&mut self, width: usize, height: usize, limit: f32, farthest: f32) {
        (self.width, self.height, self.limit) = (width, height, limit);
        self.nearness.clear();
        self.nearness.resize(width * height + LANES, farthest);
    }
}

impl Target for Distances {
    #[inline]
    fn density(&self) -> f32 {
        1.0
    }

    #[inline]
    fn extent(&self, left: f32, right: f32, top: f32, bottom: f32) -> Area {
        let ((x0, x1), (y0, y1)) = (centred(left, right, self.width), centred(top, bottom, self.height));
        Area { x0, x1, y0, y1 }
    }

    #[inline]
    fn within(&self, row: usize, x0: usize, x1: usize) -> Range<usize> {
        row * self.width + x0..row * self.width + x1
    }

    #[inline]
    fn point(&self, row: usize, at: usize) -> (f32, f32) {
        ((at - row * self.width) as f32 + 0.5, row as f32 + 0.5)
    }

    #[inline]
    fn points(&self, row: usize, at: usize) -> (Lanes, Lanes) {
        (centres(at - row * self.width), splat(row as f32 + 0.5))
    }

    #[inline]
    fn offer(&mut self, at: usize, mask: u32, nearness: Lanes, _owner: u16, _facet: Option<u32>) {
        let known = load(&self.nearness[at..], 0.0);
        let seen = (nearness.simd_gt(known) & nearness.simd_lt(splat(self.limit))).to_bitmask() & mask;
        let nearness = nearness.to_array();
        let known = &mut self.nearness[at..][..LANES];
        let mut bits = seen;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            known[lane] = nearness[lane];
            bits &= bits - 1;
        }
    }

    #[inline]
    fn offer_one(&mut self, at: usize, nearness: f32, _owner: u16, _facet: u32) {
        if nearness > self.nearness[at] && nearness < self.limit {
            self.nearness[at] = nearness;
        }
    }
}
