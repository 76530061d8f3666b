//! Bilinear resize of a square canvas in 11-bit fixed point, without pre-filter: the reference's way from 512 to 224.
//!
//! Source coordinate f = (d + 1/2) * source/target - 1/2 in f32, s = floor(f); weights w1 = round(2048 (f - s)) and
//! w0 = round(2048 (1 - (f - s))), half to even. Horizontally R = p[s] w0 + p[s+1] w1; vertically
//! (((w0 (R0 >> 4)) >> 16) + ((w1 (R1 >> 4)) >> 16) + 2) >> 2. Beyond an edge the edge pixel is repeated.
//!
//! The weights always add up to 2048 (rounding half to even is symmetric about 1024), so with the nearer pixel n, the
//! farther f and its weight w <= 1024: R >> 4 = 128 n + (((f - n) w) >> 4), and everything fits 16-bit arithmetic.

use std::ops::Range;

use multiversion::multiversion;

use super::Viewers;
use crate::canvas::Canvas;
use crate::error::{RenderError, check_len, check_size};
use crate::region::Region;

/// One target coordinate's source.
#[derive(Debug, Clone, Copy)]
struct Tap {
    /// The first of its two source coordinates, for order and for the vertical pass; may be -1.
    first: i32,
    /// Vertical weights of the first and second.
    weights: [i16; 2],
    near: u32,
    far: u32,
    /// -32 times the farther one's weight.
    far_weight: i16,
}

impl Tap {
    fn new(target: usize, ratio: f64, source: usize) -> Self {
        let f = ((target as f64 + 0.5) * ratio - 0.5) as f32;
        let floor = f.floor();
        let fraction = f - floor;
        let w1 = (2048.0 * fraction).round_ties_even() as i16;
        let w0 = (2048.0 * (1.0 - fraction)).round_ties_even() as i16;
        let first = floor as i32;
        let inside = |s: i32| s.clamp(0, source as i32 - 1) as u32;
        let pair = [inside(first), inside(first + 1)];
        let (near, far, far_weight) = if w1 <= w0 { (pair[0], pair[1], w1) } else { (pair[1], pair[0], w0) };
        Self { first, weights: [w0, w1], near, far, far_weight: -32 * far_weight }
    }
}

/// Resizes square canvases to square `[target, target, 3]` images. Owns tables and two rows of working memory.
#[derive(Debug, Clone)]
pub struct FixedBilinear {
    source: usize,
    target: usize,
    taps: Vec<Tap>,
    viewers: Viewers,
    /// `far_weight` of each tap, three times over: one for each channel.
    far_weights: Vec<i16>,
    /// Gathered pixels of one row, `[target, 3]`, and a byte more because pixels are written as four.
    near: Vec<u8>,
    far: Vec<u8>,
    /// R >> 4 of the two source rows, `[target, 3]`.
    rows: [Vec<i16>; 2],
}

impl FixedBilinear {
    /// The resize from side `source` to side `target`.
    ///
    /// # Errors
    /// If a side is zero or above 4096.
    pub fn new(source: usize, target: usize) -> Result<Self, RenderError> {
        check_size("the source of a resize", source, source)?;
        check_size("the target of a resize", target, target)?;
        let ratio = source as f64 / target as f64;
        let taps: Vec<_> = (0..target).map(|d| Tap::new(d, ratio, source)).collect();
        // Beyond the first edge the edge pixel stands for coordinate -1 too, beyond the last one for that after it.
        let start = |low: usize| {
            let low = if low == 0 { -1 } else { low as i32 };
            taps.partition_point(|tap| tap.first + 1 < low)
        };
        let end = |high: usize| {
            if high == source { target } else { taps.partition_point(|tap| tap.first < high as i32) }
        };
        Ok(Self {
            source,
            target,
            viewers: Viewers::new(source, start, end),
            far_weights: taps.iter().flat_map(|tap| [tap.far_weight; 3]).collect(),
            taps,
            near: vec![0; target * 3 + 1],
            far: vec![0; target * 3 + 1],
            rows: [vec![0; target * 3], vec![0; target * 3]],
        })
    }

    /// Resizes `canvas` into `image`, `[target, target, 3]`.
    ///
    /// # Errors
    /// If the canvas is not of the source's size, or `image` has the wrong length.
    pub fn resize(&mut self, canvas: &Canvas, image: &mut [u8]) -> Result<(), RenderError> {
        let Canvas { height, width, .. } = *canvas;
        if (height, width) != (self.source, self.source) {
            return Err(RenderError::Canvas { height, width, side: self.source });
        }
        check_len("the resized image", image.len(), self.target, self.target)?;
        self.resize_region(canvas, &Region::of(canvas.bounds()), image, &mut Region::default());
        Ok(())
    }

    /// Recomputes the pixels of `image` that depend on the pixels `dirty` of `canvas`, and sets `changed` to them. `dirty`
    /// lies in the canvas; canvas and image have the sizes of this resize.
    pub(crate) fn resize_region(
        &mut self,
        canvas: &Canvas,
        dirty: &Region,
        image: &mut [u8],
        changed: &mut Region,
    ) {
        changed.set_rows(self.viewers.of(dirty.rows()), |y| {
            let [first, second] = self.sources_of(y);
            self.viewers.of(dirty.columns_of(first..second + 1))
        });
        // Source row and columns that each of `rows` holds. When enlarging, neighbors share rows.
        let mut held = [None, None];
        for y in changed.rows() {
            let columns = changed.columns(y);
            let wanted = self.sources_of(y).map(|source| Some((source, columns.clone())));
            if held[1] == wanted[0] {
                self.rows.swap(0, 1);
                held.swap(0, 1);
            }
            for (slot, wanted) in wanted.into_iter().enumerate() {
                if let Some((source, columns)) = &wanted
                    && held[slot] != wanted
                {
                    self.horizontal(canvas.row(*source), columns.clone(), slot);
                    held[slot] = wanted;
                }
            }
            let bytes = columns.start * 3..columns.end * 3;
            let start = y * self.target * 3;
            vertical(
                &self.rows[0][bytes.clone()],
                &self.rows[1][bytes.clone()],
                self.taps[y].weights,
                &mut image[start + bytes.start..start + bytes.end],
            );
        }
    }

    /// The two source coordinates of a target, edges repeated.
    fn sources_of(&self, target: usize) -> [usize; 2] {
        let first = self.taps[target].first;
        [first, first + 1].map(|source| source.clamp(0, self.source as i32 - 1) as usize)
    }

    /// R >> 4 of a source row into `rows[slot]`, for these columns.
    fn horizontal(&mut self, source: &[u32], columns: Range<usize>, slot: usize) {
        let taps = &self.taps[columns.clone()];
        let (near, far) = (&mut self.near[..taps.len() * 3 + 1], &mut self.far[..taps.len() * 3 + 1]);
        // Four bytes at a time; the fourth is the next pixel's, and written again by it.
        for (at, tap) in (0..).step_by(3).zip(taps) {
            near[at..at + 4].copy_from_slice(&source[tap.near as usize].to_le_bytes());
            far[at..at + 4].copy_from_slice(&source[tap.far as usize].to_le_bytes());
        }
        let bytes = columns.start * 3..columns.end * 3;
        mix(&self.near, &self.far, &self.far_weights[bytes.clone()], &mut self.rows[slot][bytes]);
    }
}

#[multiversion(targets("x86_64+avx2"))]
fn mix(near: &[u8], far: &[u8], far_weights: &[i16], out: &mut [i16]) {
    for ((out, (&near, &far)), &weight) in out.iter_mut().zip(near.iter().zip(far)).zip(far_weights) {
        let (near, far) = (i16::from(near), i16::from(far));
        *out = (near << 7) + high_half((near - far) << 7, weight);
    }
}

#[multiversion(targets("x86_64+avx2"))]
fn vertical(first: &[i16], second: &[i16], [w0, w1]: [i16; 2], out: &mut [u8]) {
    for ((out, &r0), &r1) in out.iter_mut().zip(first).zip(second) {
        *out = ((high_half(r0, w0) + high_half(r1, w1) + 2) >> 2) as u8;
    }
}

/// (a * b) >> 16: one instruction for eight lanes on every 64-bit x86 and Arm.
#[inline]
fn high_half(a: i16, b: i16) -> i16 {
    ((i32::from(a) * i32::from(b)) >> 16) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rect::Rect;

    /// The rule as it is stated, one pixel and channel at a time.
    fn by_the_book(canvas: &Canvas, target: usize) -> Vec<u8> {
        let source = canvas.width();
        let coordinate = |d: usize| {
            let f = ((d as f64 + 0.5) * (source as f64 / target as f64) - 0.5) as f32;
            let fraction = f - f.floor();
            let weight = |x: f32| (2048.0 * x).round_ties_even() as i64;
            let inside = |s: f32| s.clamp(0.0, source as f32 - 1.0) as usize;
            (inside(f.floor()), inside(f.floor() + 1.0), weight(1.0 - fraction), weight(fraction))
        };
        let mut out = Vec::new();
        for y in 0..target {
            for x in 0..target {
                for c in 0..3 {
                    let (xa, xb, wa, wb) = coordinate(x);
                    let (ya, yb, va, vb) = coordinate(y);
                    let p = |x, y| i64::from(canvas.get(x, y).expect("inside")[c]);
                    let r = |y| (p(xa, y) * wa + p(xb, y) * wb) >> 4;
                    out.push(((((va * r(ya)) >> 16) + ((vb * r(yb)) >> 16) + 2) >> 2) as u8);
                }
            }
        }
        out
    }

    fn noise(side: usize) -> Canvas {
        let mut state = 1_u32;
        let bytes: Vec<_> = (0..side * side * 3)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                [0, 255, (state >> 24) as u8][(state >> 16) as usize % 3]
            })
            .collect();
        Canvas::from_rgb(side, side, &bytes).expect("the length fits")
    }

    #[test]
    fn sixteen_bit_arithmetic_equals_the_rule() {
        for (source, target) in [(512, 224), (64, 28), (50, 37), (20, 45), (8, 8), (7, 1), (1, 5)] {
            let canvas = noise(source);
            let mut image = vec![0; target * target * 3];
            FixedBilinear::new(source, target)
                .and_then(|mut resize| resize.resize(&canvas, &mut image))
                .expect("sizes and lengths fit");
            assert!(image == by_the_book(&canvas, target), "{source} to {target}");
        }
    }

    #[test]
    fn other_sizes_are_errors() {
        let mut resize = FixedBilinear::new(8, 4).expect("sizes are fine");
        let error = resize.resize(&Canvas::new(4, 16), &mut [0; 48]).expect_err("not square");
        assert_eq!(
            error.to_string(),
            "a canvas of 4 x 16 px cannot be resized by tables made for 8 x 8 px; make tables for its size"
        );
        assert!(resize.resize(&Canvas::new(8, 8), &mut [0; 47]).is_err());
    }

    #[test]
    fn a_region_covers_all_that_depends_on_it() {
        for (source, target) in [(64, 28), (20, 45), (33, 33)] {
            let mut resize = FixedBilinear::new(source, target).expect("sizes are fine");
            let mut canvas = noise(source);
            let mut image = vec![0; target * target * 3];
            resize.resize(&canvas, &mut image).expect("the lengths fit");
            let side = source as i32;
            for dirty in [Rect::new(0, 0, 1, 1), Rect::new(side - 1, 3, side, 4), Rect::new(5, 7, 12, side)] {
                for y in dirty.rows() {
                    for x in dirty.columns() {
                        canvas.pixels[y * source + x] ^= 0x00ff_ffff;
                    }
                }
                resize.resize_region(&canvas, &Region::of(dirty), &mut image, &mut Region::default());
                assert!(image == by_the_book(&canvas, target), "{source} to {target}, {dirty:?}");
            }
        }
    }
}
