//! Dots with the profile of a Gaussian, blended over packed RGB bytes: exactly as the reference computes them, or
//! quickly, at the size of the frame. Which dots there are is `drawing.rs`'s business.

use swm_render::{Rect, Rgb};

use super::room::IMAGE_PX;

/// A dot in the world: its centre and its standard deviation in pixels of the 224-px picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dot {
    pub(super) center: [f32; 2],
    pub(super) radius: f32,
    pub(super) color: Rgb,
}

/// Beyond this exponent a dot changes no byte: its weight is below half of the last bit of 1 - weight, and 255 times its
/// weight below that of any brightness. (Truncation makes a dot darken white up to an exponent of about 17.3.)
const LAST_EXPONENT: f32 = 18.0;

impl Dot {
    /// All pixels of a picture of `[height, width]` that the dot can change, if a pixel is `scale` world pixels wide, per
    /// axis x, y.
    fn bounds(&self, [height, width]: [usize; 2], scale: [f32; 2], radius: [f32; 2]) -> Rect {
        let span = |axis: usize, size: usize| {
            // Pixel i is at (i + 1/2) scale - 1/2 in the 224-px picture.
            let pixel = |world: f32| (world + 0.5) / scale[axis] - 0.5;
            let reach = (2.0 * LAST_EXPONENT).sqrt() * radius[axis];
            let clamp = |pixel: f32| pixel.clamp(0.0, size as f32) as i32;
            let (low, high) = (self.center[axis] - reach, self.center[axis] + reach);
            [clamp(pixel(low).floor()), clamp(pixel(high).ceil() + 1.0)]
        };
        let ([x0, x1], [y0, y1]) = (span(0, width), span(1, height));
        Rect::new(x0, y0, x1, y1)
    }

    /// Blends the dot over a `[224, 224, 3]` picture and returns the pixels that may have changed.
    ///
    /// weight = exp(-d^2 / (2 r^2)) in f32, divided by its largest value in the picture; byte = trunc(old (1 - weight) +
    /// colour weight), in f32. The exponential is rounded correctly, which the reference's is to the last bit but one.
    pub(super) fn blend_exactly(&self, picture: &mut [u8]) -> Rect {
        let bounds = self.bounds([IMAGE_PX; 2], [1.0; 2], [self.radius; 2]);
        let radius = f64::from(self.radius);
        let spread = (2.0 * radius * radius) as f32;
        let largest = {
            let [dx, dy] = self.center.map(|c| c.round().clamp(0.0, (IMAGE_PX - 1) as f32) - c);
            exp(-(dx * dx + dy * dy) / spread)
        };
        let mut weights = [0.0; IMAGE_PX];
        let columns = bounds.x0 as usize..bounds.x1 as usize;
        for y in bounds.y0..bounds.y1 {
            let dy = y as f32 - self.center[1];
            // The columns of this row in which the exponent matters.
            let reach = (LAST_EXPONENT * spread - dy * dy).max(0.0).sqrt();
            let first = ((self.center[0] - reach).floor().max(0.0) as usize).max(columns.start);
            let end = ((self.center[0] + reach).ceil().max(0.0) as usize + 1).min(columns.end);
            if first >= end {
                continue;
            }
            let weights = &mut weights[..end - first];
            for (offset, weight) in weights.iter_mut().enumerate() {
                let dx = (first + offset) as f32 - self.center[0];
                *weight = exp(-(dx * dx + dy * dy) / spread) / largest;
            }
            let row = (y as usize * IMAGE_PX + first) * 3;
            blend(&mut picture[row..row + weights.len() * 3], weights, self.color);
        }
        bounds
    }

    /// Blends the dot over a `[height, width, 3]` picture of the whole world as if it had been drawn at 224 px and
    /// resized, and returns the pixels that may have changed.
    ///
    /// The filter of the resize, a triangle, is taken for a Gaussian of its variance, so that the dot stays one: wider, and
    /// fainter at its peak.
    pub(super) fn blend_quickly(&self, picture: &mut [u8], [height, width]: [usize; 2]) -> Rect {
        let scale = [width, height].map(|size| IMAGE_PX as f32 / size as f32);
        // A triangle of half-width h has the variance h^2 / 6.
        let variance = scale.map(|scale| self.radius * self.radius + scale.max(1.0) * scale.max(1.0) / 6.0);
        let bounds = self.bounds([height, width], scale, variance.map(f32::sqrt));
        let profile = |axis: usize, pixel: i32| {
            let distance = (pixel as f32 + 0.5) * scale[axis] - 0.5 - self.center[axis];
            let peak = self.radius / variance[axis].sqrt();
            peak * exp(-distance * distance / (2.0 * variance[axis]))
        };
        // Wider frames are drawn in strips, so that the table has a fixed size.
        const STRIP: i32 = 256;
        let (mut across, mut weights) = ([0.0; STRIP as usize], [0.0; STRIP as usize]);
        for left in (bounds.x0..bounds.x1).step_by(STRIP as usize) {
            let right = (left + STRIP).min(bounds.x1);
            let count = (right - left) as usize;
            for (offset, weight) in across[..count].iter_mut().enumerate() {
                *weight = profile(0, left + offset as i32);
            }
            for y in bounds.y0..bounds.y1 {
                let down = profile(1, y);
                for (weight, &across) in weights[..count].iter_mut().zip(&across[..count]) {
                    *weight = (across * down).min(1.0);
                }
                let row = (y as usize * width + left as usize) * 3;
                blend(&mut picture[row..row + count * 3], &weights[..count], self.color);
            }
        }
        bounds
    }
}

/// Moves each pixel towards `color` by its weight. The bytes are truncated, as the reference does.
fn blend(bytes: &mut [u8], weights: &[f32], color: Rgb) {
    let color = color.map(f32::from);
    for (pixel, &weight) in bytes.as_chunks_mut::<3>().0.iter_mut().zip(weights) {
        let rest = 1.0 - weight;
        for (byte, color) in pixel.iter_mut().zip(color) {
            *byte = (f32::from(*byte) * rest + color * weight) as i32 as u8;
        }
    }
}

/// exp(x) for -700 < x <= 0, correctly rounded but for one in a million: 2^k exp(r) in f64, with an error of 2e-13.
///
/// Not the standard library's, which differs between machines and works on one number at a time.
fn exp(x: f32) -> f32 {
    // Adding this to a small number leaves the number, rounded, in the lowest bits.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    let x = f64::from(x);
    let shifted = x * std::f64::consts::LOG2_E + SHIFT;
    let r = x - (shifted - SHIFT) * std::f64::consts::LN_2;
    let power = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1.0_f64.to_bits()));
    let series = INVERSE_FACTORIALS.iter().fold(0.0, |sum, term| sum * r + term);
    (power * series) as f32
}

/// 1/10!, 1/9!, ..., 1/0!.
const INVERSE_FACTORIALS: [f64; 11] = {
    let (mut terms, mut factorial, mut n) = ([1.0; 11], 1.0, 1);
    while n < 11 {
        factorial *= n as f64;
        terms[10 - n] = 1.0 / factorial;
        n += 1;
    }
    terms
};
