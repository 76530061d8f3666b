//! Filters: blur, a random convolution per episode, and a coarser resolution.

use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::view::{Frame, Scratch};

use super::{Distractor, byte, within};

swm_core::settings! {
    /// A separable Gaussian.
    pub(super) struct Blur {
        /// Size of the kernel in pixels, made odd.
        kernel: usize = 5,
        /// Standard deviation in pixels; 0: derived from the kernel.
        sigma: f64 = 0.0,
    }
}

const LARGEST_KERNEL: f64 = 99.0;

impl Blur {
    /// The weights: fixed ones for small kernels without a sigma, as OpenCV has them.
    fn weights(&self) -> Vec<f32> {
        let size = self.kernel | 1;
        match (size, self.sigma > 0.0) {
            (1, _) => return vec![1.0],
            (3, false) => return vec![0.25, 0.5, 0.25],
            (5, false) => return vec![0.0625, 0.25, 0.375, 0.25, 0.0625],
            (7, false) => return vec![0.03125, 0.109375, 0.21875, 0.28125, 0.21875, 0.109375, 0.03125],
            _ => {}
        }
        let middle = (size - 1) as f64 / 2.0;
        let sigma = if self.sigma > 0.0 { self.sigma } else { 0.3 * (middle - 1.0) + 0.8 };
        let all: Vec<f64> = (0..size).map(|i| (-((i as f64 - middle) / sigma).powi(2) / 2.0).exp()).collect();
        let sum: f64 = all.iter().sum();
        all.iter().map(|weight| (weight / sum) as f32).collect()
    }
}

impl Distractor for Blur {
    const NAME: &'static str = "blur";
    const SUMMARY: &'static str = "a Gaussian blur";

    fn check(&self) -> Result<(), String> {
        within("kernel", self.kernel as f64, 1.0, LARGEST_KERNEL)?;
        within("sigma", self.sigma, 0.0, 100.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let weights = self.weights();
        let half = (weights.len() / 2) as isize;
        let Frame { pixels, height, width, scratch, .. } = frame;
        let (height, width) = (*height, *width);
        let Scratch { numbers, .. } = &mut **scratch;
        numbers.clear();
        numbers.resize(pixels.len(), 0.0);
        for y in 0..height {
            for x in 0..width {
                for (weight, offset) in weights.iter().zip(-half..) {
                    let from = (y * width + mirrored(x, offset, width)) * 3;
                    for channel in 0..3 {
                        numbers[(y * width + x) * 3 + channel] += weight * f32::from(pixels[from + channel]);
                    }
                }
            }
        }
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0; 3];
                for (weight, offset) in weights.iter().zip(-half..) {
                    let from = (mirrored(y, offset, height) * width + x) * 3;
                    sum.iter_mut().zip(&numbers[from..]).for_each(|(sum, value)| *sum += weight * value);
                }
                for (channel, sum) in sum.into_iter().enumerate() {
                    pixels[(y * width + x) * 3 + channel] = byte(sum, false);
                }
            }
        }
    }
}

/// `at + offset`, reflected at the ends without repeating them (reflect-101).
fn mirrored(at: usize, offset: isize, len: usize) -> usize {
    if len == 1 {
        return 0;
    }
    let period = 2 * (len as isize - 1);
    let place = (at as isize + offset).rem_euclid(period);
    place.min(period - place) as usize
}

swm_core::settings! {
    /// A convolution with weights that are sampled per episode.
    pub(super) struct RandomConv {
        /// Size of the kernel in pixels, made odd.
        kernel: usize = 3,
        /// Truncate to bytes instead of rounding, as the reference does.
        truncate: bool = false,
    }
}

impl Distractor for RandomConv {
    const NAME: &'static str = "random_conv";
    const SUMMARY: &'static str = "a random convolution, another in every episode";

    fn check(&self) -> Result<(), String> {
        within("kernel", self.kernel as f64, 1.0, 15.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let size = self.kernel | 1;
        let half = (size / 2) as isize;
        let mut rng = frame.of_episode("distractor random_conv");
        let std = 1.0 / ((3 * size * size) as f32).sqrt();
        let Frame { pixels, height, width, scratch, .. } = frame;
        let (height, width) = (*height, *width);
        let Scratch { numbers, bytes } = &mut **scratch;
        bytes.clear();
        bytes.extend_from_slice(pixels);
        // `[out 3, k, k, in 3]`.
        numbers.clear();
        numbers.extend((0..9 * size * size).map(|_| {
            let z: f32 = rng.sample(StandardNormal);
            z * std
        }));
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0; 3];
                for (row, dy) in (-half..=half).enumerate() {
                    for (column, dx) in (-half..=half).enumerate() {
                        let from = (mirrored(y, dy, height) * width + mirrored(x, dx, width)) * 3;
                        for (out, sum) in sum.iter_mut().enumerate() {
                            let weights = &numbers[((out * size + row) * size + column) * 3..][..3];
                            for (weight, &value) in weights.iter().zip(&bytes[from..from + 3]) {
                                *sum += weight * f32::from(value);
                            }
                        }
                    }
                }
                for (out, sum) in sum.into_iter().enumerate() {
                    pixels[(y * width + x) * 3 + out] = byte(sum, self.truncate);
                }
            }
        }
    }
}

swm_core::settings! {
    /// Fewer, larger pixels.
    pub(super) struct Resolution {
        /// Fraction of the height and width that remains.
        scale: f64 = 0.5,
    }
}

impl Distractor for Resolution {
    const NAME: &'static str = "resolution";
    const SUMMARY: &'static str = "a coarser image of the same size";

    fn check(&self) -> Result<(), String> {
        within("scale", self.scale, 1e-3, 1.0)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        let coarse = |size: usize| ((size as f64 * self.scale).round() as usize).clamp(1, size);
        let Frame { pixels, height, width, scratch, .. } = frame;
        let (height, width) = (*height, *width);
        let (rows, columns) = (coarse(height), coarse(width));
        let Scratch { bytes, .. } = &mut **scratch;
        bytes.clear();
        bytes.extend_from_slice(pixels);
        // Means over areas, whose edges may cut pixels, then the nearest of them.
        for row in 0..rows {
            for column in 0..columns {
                let mean = area_mean(bytes, [height, width], [row, column], [rows, columns]);
                for y in covered(row, rows, height) {
                    for x in covered(column, columns, width) {
                        pixels[(y * width + x) * 3..][..3].copy_from_slice(&mean);
                    }
                }
            }
        }
    }
}

/// The pixels whose nearest of `parts` areas is `part`.
fn covered(part: usize, parts: usize, len: usize) -> std::ops::Range<usize> {
    (part * len).div_ceil(parts)..((part + 1) * len).div_ceil(parts)
}

fn area_mean(
    bytes: &[u8],
    [height, width]: [usize; 2],
    [row, column]: [usize; 2],
    [rows, columns]: [usize; 2],
) -> [u8; 3] {
    let span = |part: usize, parts: usize, len: usize| {
        [part as f64 * len as f64 / parts as f64, (part + 1) as f64 * len as f64 / parts as f64]
    };
    let ([top, bottom], [left, right]) = (span(row, rows, height), span(column, columns, width));
    let share = |at: usize, low: f64, high: f64| (high.min(at as f64 + 1.0) - low.max(at as f64)).max(0.0);
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for y in top as usize..(bottom.ceil() as usize).min(height) {
        for x in left as usize..(right.ceil() as usize).min(width) {
            let weight = share(y, top, bottom) * share(x, left, right);
            total += weight;
            let pixel = &bytes[(y * width + x) * 3..][..3];
            sum.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += weight * f64::from(value));
        }
    }
    sum.map(|sum| byte((sum / total) as f32, false))
}
