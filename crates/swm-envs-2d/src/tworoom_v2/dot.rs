//! Dots with the profile of a Gaussian, blended over packed RGB bytes: exactly as the reference computes them, or
//! quickly, at the size of the frame. Which dots there are is `rendering.rs`'s business.

use swm_fov::Fov;
use swm_render::{Rect, Rgb};

use super::room::IMAGE_PX;
use crate::artist::Sprite;

/// A dot in the world: its center and its standard deviation in pixels of the 224-px image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dot {
    pub(crate) center: [f32; 2],
    pub(crate) radius: f32,
    pub(crate) color: Rgb,
}

/// Beyond this exponent a dot changes no byte: its weight is below half of the last bit of 1 - weight, and 255 times its
/// weight below that of any brightness. (Truncation makes a dot darken white up to an exponent of about 17.3.)
const LAST_EXPONENT: f32 = 18.0;

impl Dot {
    /// The agent of an episode.
    pub(crate) fn new(fov: &Fov, center: [f32; 2]) -> Self {
        Self { center, radius: fov.f32("agent.radius"), color: fov.rgb("agent.color") }
    }

    /// All pixels of an image of `[height, width]` that the dot can change, if a pixel is `scale` world pixels wide, per
    /// axis x, y.
    fn bounds(&self, [height, width]: [usize; 2], scale: [f32; 2], radius: [f32; 2]) -> Rect {
        let span = |axis: usize, size: usize| {
            // Pixel i is at (i + 1/2) scale - 1/2 in the 224-px image.
            let pixel = |world: f32| (world + 0.5) / scale[axis] - 0.5;
            let reach = (2.0 * LAST_EXPONENT).sqrt() * radius[axis];
            let clamp = |pixel: f32| pixel.clamp(0.0, size as f32) as i32;
            let (low, high) = (self.center[axis] - reach, self.center[axis] + reach);
            [clamp(pixel(low).floor()), clamp(pixel(high).ceil() + 1.0)]
        };
        let ([x0, x1], [y0, y1]) = (span(0, width), span(1, height));
        Rect::new(x0, y0, x1, y1)
    }
}

impl Sprite for Dot {
    fn at(self, center: [f32; 2]) -> Self {
        Self { center, ..self }
    }

    /// Blends the dot over a `[224, 224, 3]` image and returns the pixels that may have changed.
    ///
    /// weight = exp(-d^2 / (2 r^2)) in f32, divided by its largest value in the image; byte = trunc(old (1 - weight) +
    /// color weight), in f32. The reference's exponential is not always rounded correctly either; one byte in 400,000 differs.
    fn blend_exactly(&self, image: &mut [u8]) -> Rect {
        let bounds = self.bounds([IMAGE_PX; 2], [1.0; 2], [self.radius; 2]);
        let radius = f64::from(self.radius);
        let spread = (2.0 * radius * radius) as f32;
        let largest = {
            let [dx, dy] = self.center.map(|c| c.round().clamp(0.0, (IMAGE_PX - 1) as f32) - c);
            exp_of_minus((dx * dx + dy * dy) / spread)
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
                *weight = exp_of_minus((dx * dx + dy * dy) / spread) / largest;
            }
            let row = (y as usize * IMAGE_PX + first) * 3;
            blend(&mut image[row..row + weights.len() * 3], weights, self.color);
        }
        bounds
    }

    /// Blends the dot over a `[height, width, 3]` image of the whole world as if it had been rendered at 224 px and
    /// resized, and returns the pixels that may have changed.
    ///
    /// The filter of the resize, a triangle, is taken for a Gaussian of its variance, so that the dot stays one: wider, and
    /// fainter at its peak.
    fn blend_quickly(&self, image: &mut [u8], [height, width]: [usize; 2]) -> Rect {
        let scale = [width, height].map(|size| IMAGE_PX as f32 / size as f32);
        // A triangle of half-width h has the variance h^2 / 6.
        let variance = scale.map(|scale| self.radius * self.radius + scale.max(1.0) * scale.max(1.0) / 6.0);
        let bounds = self.bounds([height, width], scale, variance.map(f32::sqrt));
        let profile = |axis: usize, pixel: i32| {
            let distance = (pixel as f32 + 0.5) * scale[axis] - 0.5 - self.center[axis];
            let peak = self.radius / variance[axis].sqrt();
            peak * exp_of_minus(distance * distance / (2.0 * variance[axis]))
        };
        // Wider frames are rendered in strips, so that the table has a fixed size.
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
                blend(&mut image[row..row + count * 3], &weights[..count], self.color);
            }
        }
        bounds
    }
}

/// Moves each pixel towards `color` by its weight. The bytes are truncated, as the reference does.
fn blend(bytes: &mut [u8], weights: &[f32], color: Rgb) {
    // Groups of a fixed size, laid out byte by byte, become vector instructions.
    const PIXELS: usize = 4;
    const BYTES: usize = 3 * PIXELS;
    let colors: [f32; BYTES] = std::array::from_fn(|i| f32::from(color[i % 3]));
    let (groups, last) = bytes.as_chunks_mut::<BYTES>();
    let (group_weights, last_weights) = weights.as_chunks::<PIXELS>();
    for (group, &[a, b, c, d]) in groups.iter_mut().zip(group_weights) {
        let weights = [a, a, a, b, b, b, c, c, c, d, d, d];
        let mixed: [i32; BYTES] = std::array::from_fn(|i| mix(group[i], colors[i], weights[i]));
        *group = mixed.map(|value| value as u8);
    }
    for (index, byte) in last.iter_mut().enumerate() {
        *byte = mix(*byte, colors[index], last_weights[index / 3]) as u8;
    }
}

fn mix(byte: u8, color: f32, weight: f32) -> i32 {
    (f32::from(byte) * (1.0 - weight) + color * weight) as i32
}

/// exp(-x) for x >= 0, correctly rounded but for one in a thousand, which are the neighbor; as for 24 beyond.
///
/// From a table and three terms of the series, in f64: not by the standard library, whose result differs between machines.
fn exp_of_minus(x: f32) -> f32 {
    // Adding this to a number of moderate size leaves it, rounded, in the lowest bits.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    let x = f64::from(x.min(LAST_ENTRY as f32 / ENTRIES_PER_UNIT as f32));
    let shifted = x * ENTRIES_PER_UNIT as f64 + SHIFT;
    let entry = shifted.to_bits() as u32 as usize;
    let rest = x - (shifted - SHIFT) * (1.0 / ENTRIES_PER_UNIT as f64);
    let series = 1.0 - rest * (1.0 - rest * (1.0 / 2.0 - rest * (1.0 / 6.0)));
    (EXP_OF_MINUS[entry.min(LAST_ENTRY)] * series) as f32
}

const ENTRIES_PER_UNIT: usize = 64;
const LAST_ENTRY: usize = 24 * ENTRIES_PER_UNIT;

/// exp(-i / 64), to 1e-12.
static EXP_OF_MINUS: [f64; LAST_ENTRY + 1] = {
    let step = {
        let (mut sum, mut term, mut n) = (1.0, 1.0, 1);
        while n < 12 {
            term /= -((ENTRIES_PER_UNIT * n) as f64);
            sum += term;
            n += 1;
        }
        sum
    };
    let (mut table, mut i) = ([1.0; LAST_ENTRY + 1], 1);
    while i <= LAST_ENTRY {
        table[i] = table[i - 1] * step;
        i += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_rounded_correctly_but_for_one_in_a_thousand() {
        let (mut differing, count) = (0, 240_000);
        for i in 0..count {
            let x = i as f32 * 1e-4;
            let [own, exact] = [exp_of_minus(x), f64::from(-x).exp() as f32];
            assert!(own.to_bits().abs_diff(exact.to_bits()) <= 1, "exp(-{x}) = {exact}, not {own}");
            differing += u32::from(own != exact);
        }
        assert!(differing * 1000 <= count, "{differing} of {count}");
    }
}
