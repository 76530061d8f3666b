//! Filled circles as Matplotlib and its renderer Agg make them: eight cubic curves, flattened by halving until they are nearly
//! straight, corners in 1/256 px, the exact area of every pixel in 256 levels.

use std::f64::consts::FRAC_1_SQRT_2;

use swm_render::{Rect, Rgb};

/// Distance of a curve's control points from its ends along the tangents, for an eighth of the unit circle.
const CONTROL: f64 = 0.265_203_1;
/// A curve is straight enough where its control points' distances from the chord add up to less, px.
const FLATNESS_PX: f64 = 0.5;
/// Most corners of a flattened circle, for radii of up to 2,000 px.
const MAX_CORNERS: usize = 520;
/// Longest row of pixels that is covered.
const MAX_COLUMNS: usize = 1024;

/// A circle that is about to be filled.
pub(super) struct Circle {
    corners: [[f64; 2]; MAX_CORNERS],
    count: usize,
}

impl Circle {
    /// The outline of a circle of `radius` about `center`, then scaled to pixels along x and y; y is down already.
    pub(super) fn new(center: [f64; 2], radius: f64, scale: [f64; 2]) -> Self {
        let mut circle = Self { corners: [[0.0; 2]; MAX_CORNERS], count: 0 };
        let place =
            |[x, y]: [f64; 2]| [(center[0] + radius * x) * scale[0], (center[1] + radius * y) * scale[1]];
        // A quarter, then turned.
        let d = CONTROL * FRAC_1_SQRT_2;
        let s = FRAC_1_SQRT_2;
        let eighths = [
            [[0.0, -1.0], [CONTROL, -1.0], [s - d, -s - d], [s, -s]],
            [[s, -s], [s + d, -s + d], [1.0, -CONTROL], [1.0, 0.0]],
        ];
        for quarter in 0..4 {
            for eighth in eighths {
                let turned = eighth.map(|[x, y]| match quarter {
                    0 => [x, y],
                    1 => [-y, x],
                    2 => [-x, -y],
                    _ => [y, -x],
                });
                let curve = turned.map(place);
                circle.add(curve[0]);
                circle.flatten(curve, 0);
            }
        }
        circle
    }

    fn add(&mut self, corner: [f64; 2]) {
        if let Some(free) = self.corners.get_mut(self.count) {
            *free = corner.map(|c| (c * 256.0).round() / 256.0);
            self.count += 1;
        }
    }

    /// Adds the corners between the ends of a cubic curve.
    fn flatten(&mut self, [a, b, c, d]: [[f64; 2]; 4], depth: u32) {
        let middle = |p: [f64; 2], q: [f64; 2]| [(p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0];
        let (ab, bc, cd) = (middle(a, b), middle(b, c), middle(c, d));
        let (abc, bcd) = (middle(ab, bc), middle(bc, cd));
        let half = middle(abc, bcd);
        let chord = [d[0] - a[0], d[1] - a[1]];
        let off = |p: [f64; 2]| ((p[0] - d[0]) * chord[1] - (p[1] - d[1]) * chord[0]).abs();
        let sum = off(b) + off(c);
        let squared_length = chord[0] * chord[0] + chord[1] * chord[1];
        if sum * sum <= FLATNESS_PX * FLATNESS_PX * squared_length || depth > 5 {
            self.add(bc);
            return;
        }
        self.flatten([a, ab, abc, half], depth + 1);
        self.flatten([half, bcd, cd, d], depth + 1);
    }

    fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.count]
    }

    /// The pixels that it touches in an image of `[height, width]`.
    fn bounds(&self, [height, width]: [usize; 2]) -> Rect {
        let span = |axis: usize, size: usize| {
            let all = || self.corners().iter().map(|corner| corner[axis]);
            let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
            let start = low.floor().clamp(0.0, size as f64) as i32;
            [start, (high.ceil().clamp(0.0, size as f64) as i32).min(start + MAX_COLUMNS as i32)]
        };
        let ([x0, x1], [y0, y1]) = (span(0, width), span(1, height));
        Rect::new(x0, y0, x1, y1)
    }

    /// Calls `paint(x, y, level)` for every pixel of an image of `[height, width]` of which it covers `level` of 255, more than
    /// 0, and returns the pixels that it may have called it for.
    pub(super) fn cover(&self, size: [usize; 2], mut paint: impl FnMut(usize, usize, u8)) -> Rect {
        let bounds = self.bounds(size);
        if bounds.is_empty() {
            return bounds;
        }
        let columns = (bounds.x1 - bounds.x0) as usize;
        let mut changes = [0.0; MAX_COLUMNS + 1];
        for y in bounds.y0..bounds.y1 {
            let changes = &mut changes[..=columns];
            changes.fill(0.0);
            let next = self.corners().iter().cycle().skip(1);
            for (from, to) in self.corners().iter().zip(next) {
                add_edge(changes, f64::from(bounds.x0), f64::from(y), *from, *to);
            }
            let mut covered = 0.0_f64;
            for (offset, change) in changes[..columns].iter().enumerate() {
                covered += change;
                let level = ((covered.abs() * 256.0 + 1e-6) as u32).min(255) as u8;
                if level > 0 {
                    paint(bounds.x0 as usize + offset, y as usize, level);
                }
            }
        }
        bounds
    }
}

/// Adds what one edge changes in the coverage of the row of pixels at `y`, from the column `first` on: pixel by pixel, the
/// area to the right of the edge.
fn add_edge(changes: &mut [f64], first: f64, y: f64, from: [f64; 2], to: [f64; 2]) {
    let (low, high, sign) = if from[1] < to[1] { (from, to, 1.0) } else { (to, from, -1.0) };
    let (top, bottom) = (low[1].max(y), high[1].min(y + 1.0));
    if top >= bottom {
        return;
    }
    let slope = (high[0] - low[0]) / (high[1] - low[1]);
    let x_at = |y: f64| low[0] + (y - low[1]) * slope - first;
    let last = (changes.len() - 1) as f64;
    let mut add = |x_from: f64, x_to: f64, height: f64| {
        let middle = ((x_from + x_to) / 2.0).clamp(0.0, last);
        let column = (middle.floor().min(last - 1.0)).max(0.0);
        let right = middle - column;
        changes[column as usize] += sign * height * (1.0 - right);
        changes[column as usize + 1] += sign * height * right;
    };
    let (start, end) = (x_at(top), x_at(bottom));
    let (left, right) = (start.min(end), start.max(end));
    // Piece by piece between the borders of pixels.
    let mut x = left;
    while x < right {
        let stop = (x.floor() + 1.0).min(right);
        add(x, stop, (bottom - top) * (stop - x) / (right - left));
        x = stop;
    }
    if left == right {
        add(left, left, bottom - top);
    }
}

/// A pixel with a color blended over it, whose weight is `alpha` of 255, as Agg does in whole numbers.
pub(super) fn blend(pixel: &mut [u8; 3], color: Rgb, alpha: u8) {
    if alpha == 255 {
        *pixel = color;
        return;
    }
    let alpha = i32::from(alpha);
    for (old, new) in pixel.iter_mut().zip(color) {
        let before = i32::from(*old) * 255;
        *old = ((((i32::from(new) << 8) - before) * alpha + (before << 8)) / (65_280 + alpha)) as u8;
    }
}

/// The product of two weights of 255.
pub(super) fn product(a: u8, b: u8) -> u8 {
    let product = u32::from(a) * u32::from(b) + 128;
    (((product >> 8) + product) >> 8) as u8
}
