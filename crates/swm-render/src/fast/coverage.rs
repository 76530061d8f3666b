//! How much of a pixel's filter a shape covers, and painting with it.
//!
//! The exact pipeline amounts to one linear filter: the canvas's own pixels, the bilinear step to the image, and the
//! triangle of the antialiased step to the frame. Here the three are one triangle of the same variance, and an edge
//! that passes at signed distance d of its center covers the integral of that triangle up to d.

use crate::geometry::Geometry;
use crate::painter::Rgb;
use crate::rect::Rect;

/// The filter of the frame's pixels, in canvas pixels.
#[derive(Debug, Clone)]
pub(super) struct Lens {
    frame: Rect,
    /// Canvas pixels per frame pixel, along x and y, and the inverses.
    step: [f32; 2],
    per_canvas: [f32; 2],
    /// Half-width of the triangle along x and y.
    reach: [f32; 2],
}

/// Variance of a canvas pixel's own square (1/12) and of interpolating between two (1/6 on average).
const CANVAS_VARIANCE: f64 = 1.0 / 12.0 + 1.0 / 6.0;

impl Lens {
    pub(super) fn new(geometry: Geometry) -> Self {
        let Geometry { canvas, image, height, width, .. } = geometry;
        let step = [canvas[1] as f64 / width as f64, canvas[0] as f64 / height as f64];
        let reach = [(1, width), (0, height)].map(|(axis, side)| {
            // A triangle of half-width w has variance w^2 / 6.
            let per_image = canvas[axis] as f64 / image[axis] as f64;
            let resize = if side == image[axis] { 0.0 } else { step[1 - axis].max(per_image) };
            (6.0 * CANVAS_VARIANCE + resize * resize).sqrt() as f32
        });
        Self {
            frame: Rect::of_size(height, width),
            step: step.map(|step| step as f32),
            per_canvas: step.map(|step| (1.0 / step) as f32),
            reach,
        }
    }

    pub(super) fn frame(&self) -> Rect {
        self.frame
    }

    /// Half-widths of the filter along x and y.
    pub(super) fn reach(&self) -> [f32; 2] {
        self.reach
    }

    /// Half-width of the filter along a unit vector.
    pub(super) fn reach_along(&self, [x, y]: [f32; 2]) -> f32 {
        let [rx, ry] = self.reach;
        (x * x * rx * rx + y * y * ry * ry).sqrt()
    }

    /// The frame pixels that something within `radius` of the points' bounding box can touch.
    pub(super) fn bounds(&self, points: &[[f32; 2]], radius: f32) -> Rect {
        let mut rect = [[0; 2]; 2];
        let last = [self.frame.x1, self.frame.y1];
        for axis in 0..2 {
            let all = points.iter().map(|point| point[axis]);
            let margin = radius + self.reach[axis];
            let low = (all.clone().fold(f32::INFINITY, f32::min) - margin) * self.per_canvas[axis] - 1.0;
            let high = (all.fold(f32::NEG_INFINITY, f32::max) + margin) * self.per_canvas[axis] + 1.0;
            rect[axis] = [low, high].map(|side| side.clamp(0.0, last[axis] as f32) as i32);
            rect[axis][1] = (rect[axis][1] + 1).min(last[axis]);
        }
        Rect::new(rect[0][0], rect[1][0], rect[0][1], rect[1][1])
    }
}

/// The share of the filter's triangle below an edge, where `distance` is that of the filter's center from the edge,
/// positive outside, in half-widths of the triangle.
#[inline(always)]
pub(super) fn share(distance: f32) -> f32 {
    let tail = (1.0 - distance.abs()).max(0.0);
    let half = 0.5 * tail * tail;
    if distance < 0.0 { 1.0 - half } else { half }
}

/// What a shape covers of one row of pixel centers, as intervals of x in canvas pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    /// Outside of it nothing is covered.
    pub(super) touched: [f32; 2],
    /// Inside of it everything is; may be empty (start after end).
    pub(super) solid: [f32; 2],
}

/// An interval that holds nothing.
pub(super) const NOWHERE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// A shape that can tell what it covers. Coordinates are canvas pixels.
pub(super) trait Coverage {
    /// What is covered of the row at height `y`, if anything.
    fn extent(&self, y: f32) -> Option<Extent>;

    /// The shares of the filters centered at (x, y) that are covered, from 0 to 1.
    fn at(&self, x: Lanes, y: f32) -> Lanes;
}

/// Neighboring pixels of a row. They are worked on side by side, in the registers of every CPU; an edge of a shape is hardly wider.
pub(super) type Lanes = [f32; LANES];
const LANES: usize = 8;

/// A frame being drawn on, within a clip rectangle.
#[derive(Debug)]
pub(super) struct Target<'a> {
    frame: &'a mut [u8],
    lens: &'a Lens,
    clip: Rect,
}

impl<'a> Target<'a> {
    pub(super) fn new(frame: &'a mut [u8], lens: &'a Lens, clip: Rect) -> Self {
        Self { frame, lens, clip: clip.intersect(&lens.frame) }
    }

    pub(super) fn clip(&self) -> Rect {
        self.clip
    }

    /// The whole clip rectangle in one color.
    pub(super) fn fill(&mut self, color: Rgb) {
        for y in self.clip.rows() {
            fill_pixels(row_mut(self.frame, self.lens, y, self.clip.columns()), color);
        }
    }

    /// Paints a shape within `visible`, which must lie in the clip rectangle.
    #[inline(always)]
    pub(super) fn paint(&mut self, shape: &impl Coverage, visible: Rect, color: Rgb) {
        let [step_x, step_y] = self.lens.step;
        let per_canvas = self.lens.per_canvas[0];
        let (low, high) = (visible.x0, visible.x1);
        for row in visible.rows() {
            let y = (row as f32 + 0.5) * step_y;
            let Some(Extent { touched, solid }) = shape.extent(y) else { continue };
            // The first pixel whose center is not before x. Rounding errors do not matter: what a shape covers of a pixel at either end
            // of an extent is far below a 256th, or short of all by as little.
            let column = |x: f32| (x * per_canvas + 0.5).max(0.0) as i32;
            let start = column(touched[0]).clamp(low, high);
            let end = column(touched[1]).clamp(start, high);
            let solid_start = column(solid[0]).clamp(start, end);
            let solid_end = column(solid[1]).clamp(solid_start, end);
            for columns in [start..solid_start, solid_end..end] {
                let indices = columns.start as usize..columns.end as usize;
                let pixels = row_mut(self.frame, self.lens, row, indices);
                let pixels = pixels.as_chunks_mut::<3>().0.chunks_mut(LANES);
                for (first, pixels) in columns.step_by(LANES).zip(pixels) {
                    let x = std::array::from_fn(|lane| ((first + lane as i32) as f32 + 0.5) * step_x);
                    let alphas = shape.at(x, y).map(|share| nearest_integer(share * 256.0));
                    let pixels = pixels.as_flattened_mut();
                    let mut bytes = [0; 3 * LANES];
                    bytes[..pixels.len()].copy_from_slice(pixels);
                    let blended: [u8; 3 * LANES] = std::array::from_fn(|at| {
                        let (before, new) = (i32::from(bytes[at]), i32::from(color[at % 3]));
                        (before + (((new - before) * alphas[at / 3] + 128) >> 8)) as u8
                    });
                    pixels.copy_from_slice(&blended[..pixels.len()]);
                }
            }
            let indices = solid_start as usize..solid_end as usize;
            fill_pixels(row_mut(self.frame, self.lens, row, indices), color);
        }
    }
}

/// The integer part of `value + 0.5`, for values from 0 to 256. A cast that saturates would be done one by one.
#[inline(always)]
fn nearest_integer(value: f32) -> i32 {
    // So large a number has no bits for fractions: the sum is rounded to an integer, in its lowest bits.
    const NO_FRACTION: f32 = 8_388_608.0;
    let value = value + 0.5;
    let sum = value + NO_FRACTION;
    let rounded = (sum.to_bits() & 0x1ff) as i32;
    rounded - i32::from(sum - NO_FRACTION > value)
}

fn row_mut<'f>(frame: &'f mut [u8], lens: &Lens, y: usize, columns: std::ops::Range<usize>) -> &'f mut [u8] {
    let start = y * lens.frame.x1 as usize;
    &mut frame[(start + columns.start) * 3..(start + columns.end) * 3]
}

fn fill_pixels(pixels: &mut [u8], color: Rgb) {
    pixels.as_chunks_mut::<3>().0.fill(color);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_is_the_integral_of_a_triangle() {
        let steps = 20_000;
        let mut integral = 0.0;
        for i in 0..steps {
            let t = -1.0 + (f64::from(i) + 0.5) * 2.0 / f64::from(steps);
            integral += (1.0 - t.abs()) * 2.0 / f64::from(steps);
            // The triangle up to t lies beyond an edge at -t.
            let error = f64::from(share(-(t as f32))) - integral;
            assert!(error.abs() < 1e-3, "at {t}: {error}");
        }
        assert_eq!(share(1.5), 0.0);
        assert_eq!(share(-1.5), 1.0);
    }

    #[test]
    fn integers_are_those_of_a_cast() {
        for step in 0..=256 * 4096 {
            let value = step as f32 / 4096.0;
            assert_eq!(nearest_integer(value), (value + 0.5) as i32, "{value}");
        }
        assert_eq!(nearest_integer(-1e-5), 0);
    }

    #[test]
    fn reach_is_that_of_the_stages() {
        let reach = |height, width| Lens::new(Geometry::new(height, width)).reach();
        assert_eq!(reach(224, 224), [1.5_f32.sqrt(); 2]);
        assert_eq!(reach(64, 64), [65.5_f32.sqrt(); 2]);
        assert!(reach(64, 32)[0] > reach(64, 32)[1]);
    }
}
