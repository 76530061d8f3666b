//! Antialiased bilinear resize of `[H, W, 3]` u8 images, byte-equal to Pillow's `Image.resize(..., BILINEAR)`.
//!
//! Separable, with u8 in between: first horizontally, then vertically, each only if its size changes. Since version 13
//! Pillow goes vertically first where the height H shrinks to h, the width W goes to w, and H - h > 2 (W - w) (found by
//! comparing results); so do we. A square image made into a square one never does. A target pixel d is centered on
//! c = (d + 1/2) scale, scale = source/target; its filter is a triangle of half-width max(scale, 1) about c, sampled at
//! the pixel centers, normalized in f64, and rounded half away from zero to 22-bit fixed point. A sum of products is
//! rounded to the nearest byte.

use multiversion::multiversion;

use super::Viewers;
use crate::error::{RenderError, check_len, check_size};
use crate::rect::Rect;
use crate::region::Region;

/// Fraction bits of the weights: 32 less 8 of the pixel and 2 of headroom.
const PRECISION_BITS: u32 = 32 - 8 - 2;
const ONE_HALF: u32 = 1 << (PRECISION_BITS - 1);

/// Resizes `[H, W, 3]` images of one size to another. Owns tables and the half-resized image.
#[derive(Debug, Clone)]
pub struct AntialiasBilinear {
    source: [usize; 2],
    target: [usize; 2],
    /// Taps of each axis whose size changes.
    rows: Option<Axis>,
    columns: Option<Axis>,
    rows_first: bool,
    /// `[H source, W target, 3]`, or `[H target, W source, 3]` with rows first. Empty unless both axes change.
    half: Vec<u8>,
    /// What changes in the half-resized image and in the result.
    half_region: Region,
    out_region: Region,
    /// The rectangle of [`Self::update`].
    updated: Region,
}

impl AntialiasBilinear {
    /// The resize from `source` to `target`, each `[height, width]`.
    ///
    /// # Errors
    /// If a side is zero or above 4096.
    pub fn new(source: [usize; 2], target: [usize; 2]) -> Result<Self, RenderError> {
        check_size("the source of a resize", source[0], source[1])?;
        check_size("the target of a resize", target[0], target[1])?;
        let axis = |i: usize| (source[i] != target[i]).then(|| Axis::new(source[i], target[i]));
        let (rows, columns) = (axis(0), axis(1));
        let rows_first = target[0] < source[0] && source[0] + 2 * target[1] > target[0] + 2 * source[1];
        let half_len = match (&rows, &columns, rows_first) {
            (Some(_), Some(_), true) => target[0] * source[1] * 3,
            (Some(_), Some(_), false) => source[0] * target[1] * 3,
            _ => 0,
        };
        Ok(Self {
            source,
            target,
            rows,
            columns,
            rows_first,
            half: vec![0; half_len],
            half_region: Region::default(),
            out_region: Region::default(),
            updated: Region::default(),
        })
    }

    /// Resizes `image`, `[H source, W source, 3]`, into `out`, `[H target, W target, 3]`.
    ///
    /// # Errors
    /// If a slice has the wrong length.
    pub fn resize(&mut self, image: &[u8], out: &mut [u8]) -> Result<(), RenderError> {
        self.update(image, Rect::of_size(self.source[0], self.source[1]), out)
    }

    /// Resizes again what depends on the pixels `dirty` of `image`; the others must be those of the call before, and
    /// `out` what it wrote. The result is that of [`resize`](Self::resize).
    ///
    /// # Errors
    /// If a slice has the wrong length.
    pub fn update(&mut self, image: &[u8], dirty: Rect, out: &mut [u8]) -> Result<(), RenderError> {
        check_len("the image to resize", image.len(), self.source[0], self.source[1])?;
        check_len("the resized image", out.len(), self.target[0], self.target[1])?;
        let dirty = dirty.intersect(&Rect::of_size(self.source[0], self.source[1]));
        if !dirty.is_empty() {
            let mut region = std::mem::take(&mut self.updated);
            region.set(dirty);
            self.resize_region(image, &region, out);
            self.updated = region;
        }
        Ok(())
    }

    /// Recomputes the pixels of `out` that depend on the pixels `dirty` of `image`. The other pixels of `image` must be
    /// those of the call before. `dirty` lies in the image; slices have the sizes of this resize.
    pub(crate) fn resize_region(&mut self, image: &[u8], dirty: &Region, out: &mut [u8]) {
        let [width, resized] = [self.source[1] * 3, self.target[1] * 3];
        let Self { half, half_region, out_region, .. } = self;
        match (&self.columns, &self.rows) {
            (Some(columns), Some(rows)) if self.rows_first => {
                across_rows(rows, Stage { image, region: dirty, stride: width }, half, half_region);
                along_rows(
                    columns,
                    Stage { image: half, region: half_region, stride: width },
                    out,
                    resized,
                    out_region,
                );
            }
            (Some(columns), Some(rows)) => {
                along_rows(
                    columns,
                    Stage { image, region: dirty, stride: width },
                    half,
                    resized,
                    half_region,
                );
                across_rows(
                    rows,
                    Stage { image: half, region: half_region, stride: resized },
                    out,
                    out_region,
                );
            }
            (Some(columns), None) => {
                along_rows(columns, Stage { image, region: dirty, stride: width }, out, resized, out_region);
            }
            (None, Some(rows)) => {
                across_rows(rows, Stage { image, region: dirty, stride: width }, out, out_region);
            }
            (None, None) => {
                for y in dirty.rows() {
                    let columns = dirty.columns(y);
                    let bytes = y * width + columns.start * 3..y * width + columns.end * 3;
                    out[bytes.clone()].copy_from_slice(&image[bytes]);
                }
            }
        }
    }
}

/// What goes into a resize of one axis: an image, the pixels of it that have changed, and the bytes from row to row.
#[derive(Clone, Copy)]
struct Stage<'a> {
    image: &'a [u8],
    region: &'a Region,
    stride: usize,
}

/// The taps of one axis.
#[derive(Debug, Clone)]
struct Axis {
    windows: Vec<Window>,
    /// All windows' weights, one after the other.
    weights: Vec<u32>,
    viewers: Viewers,
}

/// Where one target pixel looks.
#[derive(Debug, Clone, Copy)]
struct Window {
    source: usize,
    weights: usize,
    count: usize,
}

impl Axis {
    fn new(source: usize, target: usize) -> Self {
        let scale = source as f64 / target as f64;
        let stretch = scale.max(1.0);
        let mut windows: Vec<Window> = Vec::with_capacity(target);
        let mut weights = Vec::new();
        let mut triangle = Vec::new();
        for d in 0..target {
            let center = (d as f64 + 0.5) * scale;
            // Truncation, not floor: below zero both end at zero.
            let low = (center - stretch + 0.5).max(0.0) as usize;
            let high = ((center + stretch + 0.5) as usize).min(source);
            triangle.clear();
            triangle.extend((low..high).map(|s| {
                let distance = ((s as f64 - center + 0.5) * (1.0 / stretch)).abs();
                if distance < 1.0 { 1.0 - distance } else { 0.0 }
            }));
            let sum: f64 = triangle.iter().sum();
            windows.push(Window { source: low, weights: weights.len(), count: high - low });
            let fixed = |weight: f64| (0.5 + weight / sum * f64::from(1 << PRECISION_BITS)) as u32;
            weights.extend(triangle.iter().map(|&weight| fixed(weight)));
        }
        let start = |s| windows.partition_point(|window| window.source + window.count <= s);
        let end = |s| windows.partition_point(|window| window.source < s);
        let viewers = Viewers::new(source, start, end);
        Self { windows, weights, viewers }
    }

    fn taps(&self, target: usize) -> (usize, &[u32]) {
        let Window { source, weights, count } = self.windows[target];
        (source, &self.weights[weights..weights + count])
    }
}

/// Resizes an image along x; `changed` becomes the pixels of `out` that were written.
#[multiversion(targets("x86_64+avx2"))]
fn along_rows(axis: &Axis, from: Stage<'_>, out: &mut [u8], stride: usize, changed: &mut Region) {
    changed.set_rows(from.region.rows(), |y| axis.viewers.of(from.region.columns(y)));
    for y in changed.rows() {
        let targets = changed.columns(y);
        let row = &from.image[y * from.stride..];
        let out = &mut out[y * stride + targets.start * 3..y * stride + targets.end * 3];
        for (at, target) in (0..).step_by(3).zip(targets) {
            let (source, weights) = axis.taps(target);
            let window = &row[source * 3..];
            // Four channels at a time are what SIMD takes. The fourth is the next pixel's, and written again by it.
            match (out.get_mut(at..at + 4), window.get(..weights.len() * 3 + 1)) {
                (Some(pixel), Some(window)) => pixel.copy_from_slice(&weighted::<4>(weights, window)),
                _ => out[at..at + 3].copy_from_slice(&weighted::<3>(weights, window)),
            }
        }
    }
}

/// The sum of a pixel's window by its weights. Neighbors in the window are three bytes apart.
#[inline(always)]
fn weighted<const CHANNELS: usize>(weights: &[u32], window: &[u8]) -> [u8; CHANNELS] {
    let mut sums = [ONE_HALF; CHANNELS];
    for (&weight, bytes) in weights.iter().zip(window.windows(CHANNELS).step_by(3)) {
        for (sum, &byte) in sums.iter_mut().zip(bytes) {
            *sum = sum.wrapping_add(weight * u32::from(byte));
        }
    }
    sums.map(to_byte)
}

/// Resizes an image along y; `changed` becomes the pixels of `out` that were written.
#[multiversion(targets("x86_64+avx2"))]
fn across_rows(axis: &Axis, from: Stage<'_>, out: &mut [u8], changed: &mut Region) {
    const LANES: usize = 16;
    let Stage { image, region, stride } = from;
    changed.set_rows(axis.viewers.of(region.rows()), |target| {
        let (source, weights) = axis.taps(target);
        region.columns_of(source..source + weights.len())
    });
    for target in changed.rows() {
        let (source, weights) = axis.taps(target);
        let columns = changed.columns(target);
        let (left, right) = (columns.start * 3, columns.end * 3);
        let mut x = left;
        while x < right {
            let lanes = LANES.min(right - x);
            let mut sums = [ONE_HALF; LANES];
            for (index, &weight) in weights.iter().enumerate() {
                let start = (source + index) * stride + x;
                let bytes = &image[start..start + lanes];
                if let Some(bytes) = bytes.first_chunk::<LANES>() {
                    for (sum, &byte) in sums.iter_mut().zip(bytes) {
                        *sum += weight * u32::from(byte);
                    }
                } else {
                    for (sum, &byte) in sums.iter_mut().zip(bytes) {
                        *sum += weight * u32::from(byte);
                    }
                }
            }
            let start = target * stride + x;
            for (byte, sum) in out[start..start + lanes].iter_mut().zip(sums) {
                *byte = to_byte(sum);
            }
            x += lanes;
        }
    }
}

fn to_byte(sum: u32) -> u8 {
    (sum >> PRECISION_BITS).min(255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One sum per channel, without SIMD: `get(s)` is the channel at source `s`.
    fn by_the_rule(axis: &Axis, target: usize, get: impl Fn(usize) -> u8) -> u8 {
        let (source, weights) = axis.taps(target);
        let products = (source..).zip(weights).map(|(s, &weight)| u64::from(weight) * u64::from(get(s)));
        let sum = u64::from(ONE_HALF) + products.sum::<u64>();
        (sum >> PRECISION_BITS).min(255) as u8
    }

    /// Whichever version of the loops this CPU takes: the bytes are those of the rule.
    #[test]
    fn every_version_gives_the_bytes_of_the_rule() {
        let mut state = 1_u32;
        for [source, target] in [[224, 64], [224, 96], [64, 224], [37, 16], [16, 37], [9, 1], [1, 3], [7, 6]]
        {
            let image: Vec<u8> = (0..source * source * 3)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    [0, 255, (state >> 24) as u8][(state >> 16) as usize % 3]
                })
                .collect();
            let axis = Axis::new(source, target);
            let mut half = vec![0; source * target * 3];
            for (at, byte) in half.iter_mut().enumerate() {
                let (y, x, c) = (at / (target * 3), at / 3 % target, at % 3);
                *byte = by_the_rule(&axis, x, |s| image[(y * source + s) * 3 + c]);
            }
            let mut expected = vec![0; target * target * 3];
            for (at, byte) in expected.iter_mut().enumerate() {
                let (y, rest) = (at / (target * 3), at % (target * 3));
                *byte = by_the_rule(&axis, y, |s| half[s * target * 3 + rest]);
            }
            let mut out = vec![0; target * target * 3];
            let resized = AntialiasBilinear::new([source; 2], [target; 2])
                .and_then(|mut resize| resize.resize(&image, &mut out));
            assert!(resized.is_ok() && out == expected, "{source} to {target}");
        }
    }
}
