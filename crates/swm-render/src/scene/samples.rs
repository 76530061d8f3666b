//! Points of a picture and what is nearest at each: a whole raster, or a chosen list.

use super::lanes::LANES;
use super::view::Area;

/// What a sample shows where nothing is.
pub(super) const NOTHING: u16 = u16::MAX;

/// Sample points, row of pixels by row of pixels, from left to right in each. The arrays are longer than the samples by
/// one lane group of points that nothing can be nearer at.
#[derive(Debug, Default)]
pub(super) struct Samples {
    /// Positions in pixels.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    /// How near the nearest surface is; surfaces must be nearer to be seen.
    pub(super) nearness: Vec<f32>,
    /// Only surfaces less near than this are seen.
    pub(super) limit: Vec<f32>,
    /// Which instance that is.
    pub(super) owner: Vec<u16>,
    /// Which facet of it.
    pub(super) facet: Vec<u32>,
    /// Where each row begins; one more than rows.
    rows: Vec<usize>,
    /// Width of a raster; 0 for a list.
    width: usize,
}

impl Samples {
    /// The centres of all pixels.
    pub(super) fn set_raster(&mut self, width: usize, height: usize, nearest: f32, farthest: f32) {
        if self.width == width && self.rows.len() == height + 1 {
            let count = width * height;
            self.limit[..count].fill(nearest);
        } else {
            self.begin();
            self.width = width;
            for y in 0..height {
                for x in 0..width {
                    self.push(x as f32 + 0.5, y as f32 + 0.5, nearest);
                }
                self.end_row();
            }
            self.end();
        }
        self.clear(farthest);
    }

    /// Starts a list.
    pub(super) fn begin(&mut self) {
        self.x.clear();
        self.y.clear();
        self.limit.clear();
        self.rows.clear();
        self.rows.push(0);
        self.width = 0;
    }

    pub(super) fn push(&mut self, x: f32, y: f32, limit: f32) {
        self.x.push(x);
        self.y.push(y);
        self.limit.push(limit);
    }

    pub(super) fn end_row(&mut self) {
        self.rows.push(self.x.len());
    }

    /// Ends a list: all rows are there.
    pub(super) fn end(&mut self) {
        let padded = self.x.len() + LANES;
        self.x.resize(padded, 0.0);
        self.y.resize(padded, 0.0);
        self.limit.resize(padded, f32::NEG_INFINITY);
        self.nearness.resize(padded, 0.0);
        self.owner.resize(padded, NOTHING);
        self.facet.resize(padded, 0);
    }

    /// Forgets what was seen.
    pub(super) fn clear(&mut self, farthest: f32) {
        let count = self.len();
        self.nearness[..count].fill(farthest);
        self.nearness[count..].fill(f32::INFINITY);
        self.owner.fill(NOTHING);
    }

    /// Whether a sample can lie in a part of the picture: between the pixels' centres of a raster there is none.
    #[inline]
    pub(super) fn may_meet(&self, [left, right]: [f32; 2], [top, bottom]: [f32; 2]) -> bool {
        let centre = |low: f32, high: f32| (low + 0.5) as usize != (high + 0.5) as usize;
        self.width == 0 || (centre(left, right) && centre(top, bottom))
    }

    /// How many samples there are.
    pub(super) fn len(&self) -> usize {
        self.rows.last().copied().unwrap_or(0)
    }

    /// The samples of one row of an area.
    #[inline]
    pub(super) fn within(&self, row: usize, area: &Area) -> std::ops::Range<usize> {
        let (start, end) = (self.rows[row], self.rows[row + 1]);
        if self.width > 0 {
            return start + area.x0..start + area.x1;
        }
        let xs = &self.x[start..end];
        let first = xs.partition_point(|&x| x < area.x0 as f32);
        let last = xs.partition_point(|&x| x <= area.x1 as f32);
        start + first..start + last
    }
}
