//! Images as models see them: to [0, 1], minus ImageNet's mean, divided by its std, then resized. In this order, which is
//! the reference's (`ToImage`, `Normalize`, `Resize` with antialiasing).

use burn::tensor::{DType, Device, Int, Tensor, TensorData};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::BaselineError;
use swm_nn::params::host;
use swm_nn::placement::Placement;

/// RGB images: `[B, T, 3, H, W]` or `[B, T, H, W, 3]`.
#[derive(Clone, Copy, Debug)]
pub struct Images<'a> {
    /// B × T × 3 × H × W values.
    pub values: &'a [u8],
    /// B.
    pub rows: usize,
    /// T.
    pub steps: usize,
    /// H.
    pub height: usize,
    /// W.
    pub width: usize,
    /// Whether colors come last, as environments give them, or before the pixels, as the loader can.
    pub channels_last: bool,
}

/// How the values of images, in [0, 1], are standardized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Normalization {
    /// By ImageNet's mean and std of red, green and blue.
    #[default]
    Imagenet,
    /// To [-1, 1], as the authors' DINO-WM.
    Half,
}

impl Normalization {
    /// Mean and std of red, green and blue.
    fn moments(self) -> [[f32; 3]; 2] {
        match self {
            Self::Imagenet => [[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]],
            Self::Half => [[0.5; 3]; 2],
        }
    }
}

/// `[B, T, 3, size, size]`.
pub(crate) fn to_tensor(
    column: &'static str,
    images: &Images<'_>,
    (size, normalization): (usize, Normalization),
    device: &Device,
) -> Result<Tensor<5>, BaselineError> {
    let &Images { values, rows, steps, height, width, .. } = images;
    if values.len() != rows * steps * 3 * height * width || values.is_empty() {
        let shape = [rows, steps, 3, height, width];
        let reason = format!("{} values are no images of shape {shape:?}", values.len());
        return Err(BaselineError::data(column, reason));
    }
    if height != width {
        let reason =
            format!("{height} × {width} pixels; square images are wanted: cut them, or render square ones");
        return Err(BaselineError::data(column, reason));
    }
    let weights = (height != size).then(|| Resampling::new(height, size));
    if Placement::of(device) == Placement::Device {
        return Ok(on_device(images, weights.as_ref(), normalization, device));
    }
    let mut floats = vec![0.0; rows * steps * 3 * size * size];
    let of_one = 3 * size * size;
    floats.par_chunks_exact_mut(of_one).zip(values.par_chunks_exact(3 * height * width)).for_each(
        |(out, image)| {
            for (channel, out) in out.chunks_exact_mut(size * size).enumerate() {
                match &weights {
                    None => plane(image, images.channels_last, channel, normalization, out),
                    Some(weights) => {
                        let mut stored = vec![0.0; height * width];
                        plane(image, images.channels_last, channel, normalization, &mut stored);
                        weights.apply(&stored, out);
                    }
                }
            }
        },
    );
    Ok(Tensor::from_data(TensorData::new(floats, [rows, steps, 3, size, size]), device))
}

/// The same by operations of the device, which gets bytes: a quarter of the transfer.
fn on_device(
    images: &Images<'_>,
    weights: Option<&Resampling>,
    normalization: Normalization,
    device: &Device,
) -> Tensor<5> {
    let &Images { values, rows, steps, height, width, channels_last } = images;
    let shape =
        if channels_last { [rows * steps, height, width, 3] } else { [rows * steps, 3, height, width] };
    let bytes = TensorData::new(values.to_vec(), shape);
    let pixels = Tensor::<4, Int>::from_data(bytes, (device, DType::U8)).float();
    let pixels = if channels_last { pixels.permute([0, 3, 1, 2]) } else { pixels };
    let [mean, std] = normalization.moments();
    let of_color = |values: [f32; 3]| Tensor::<1>::from_data(values, device).reshape([1, 3, 1, 1]);
    let pixels = (pixels / 255.0 - of_color(mean)) / of_color(std);
    let pixels = match weights {
        None => pixels,
        Some(weights) => {
            // Along rows, then along columns.
            let weights = weights.matrix(device).unsqueeze::<4>();
            weights.clone().matmul(pixels.matmul(weights.transpose()))
        }
    };
    let [.., height, width] = pixels.dims();
    pixels.reshape([rows, steps, 3, height, width])
}

/// Images `[N, 3, S, S]` as bytes `[N, S, S, 3]`: [`to_tensor`] the other way round.
pub(crate) fn to_bytes(images: Tensor<4>, normalization: Normalization) -> Vec<u8> {
    let [mean, std] = normalization.moments();
    let values = host(images.permute([0, 2, 3, 1]));
    let byte = |(at, value): (usize, &f32)| {
        let value = value * std[at % 3] + mean[at % 3];
        // `as` saturates, and what is not a number becomes 0.
        (value * 255.0).round() as u8
    };
    values.iter().enumerate().map(byte).collect()
}

/// One color of an image, normalized: `[H, W]`.
fn plane(image: &[u8], channels_last: bool, channel: usize, normalization: Normalization, out: &mut [f32]) {
    let (first, stride) = if channels_last { (channel, 3) } else { (channel * out.len(), 1) };
    let [mean, std] = normalization.moments().map(|of_colors| of_colors[channel]);
    let table: [f32; 256] = std::array::from_fn(|value| (value as f32 / 255.0 - mean) / std);
    for (value, byte) in out.iter_mut().zip(image[first..].iter().step_by(stride)) {
        *value = table[usize::from(*byte)];
    }
}

/// Bilinear resampling of square images with antialiasing, as PyTorch does it.
struct Resampling {
    from: usize,
    /// For each new place, the first old one and the weights from there on.
    places: Vec<(usize, Vec<f32>)>,
}

impl Resampling {
    fn new(from: usize, to: usize) -> Self {
        let scale = from as f64 / to as f64;
        let support = scale.max(1.0);
        let places = (0..to).map(|place| {
            let center = (place as f64 + 0.5) * scale;
            let first = (center - support + 0.5).max(0.0) as usize;
            let end = ((center + support + 0.5) as usize).min(from);
            let weight = |old: usize| (1.0 - ((old as f64 - center + 0.5) / support).abs()).max(0.0);
            let sum: f64 = (first..end).map(weight).sum();
            (first, (first..end).map(|old| (weight(old) / sum) as f32).collect())
        });
        Self { from, places: places.collect() }
    }

    /// `[to, from]`: the weight of each old place in each new one.
    fn matrix(&self, device: &Device) -> Tensor<2> {
        let mut values = vec![0.0; self.places.len() * self.from];
        for (row, (first, weights)) in values.chunks_exact_mut(self.from).zip(&self.places) {
            row[*first..][..weights.len()].copy_from_slice(weights);
        }
        Tensor::from_data(TensorData::new(values, [self.places.len(), self.from]), device)
    }

    /// `[from, from]` → `[to, to]`: along rows, then along columns.
    fn apply(&self, image: &[f32], out: &mut [f32]) {
        let size = self.places.len();
        let mut rows = vec![0.0; self.from * size];
        for (row, out) in image.chunks_exact(self.from).zip(rows.chunks_exact_mut(size)) {
            for (value, (first, weights)) in out.iter_mut().zip(&self.places) {
                *value = weights.iter().zip(&row[*first..]).map(|(weight, old)| weight * old).sum();
            }
        }
        out.fill(0.0);
        for (out, (first, weights)) in out.chunks_exact_mut(size).zip(&self.places) {
            for (weight, row) in weights.iter().zip(rows.chunks_exact(size).skip(*first)) {
                out.iter_mut().zip(row).for_each(|(value, old)| *value += weight * old);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use swm_nn::placement::as_on_a_device;

    fn images(values: &[u8], side: usize, channels_last: bool) -> Images<'_> {
        Images { values, rows: 1, steps: 1, height: side, width: side, channels_last }
    }

    #[test]
    fn both_orders_of_axes_give_the_same() {
        let last: Vec<u8> = (0..12).collect();
        let first: Vec<u8> = (0..12).map(|i| last[i % 4 * 3 + i / 4]).collect();
        let device = Device::flex();
        let [a, b] = [(&last, true), (&first, false)].map(|(values, order)| {
            host(
                to_tensor("pixels", &images(values, 2, order), (2, Normalization::Imagenet), &device)
                    .unwrap(),
            )
        });
        assert_eq!(a, b);
        assert!((a[0] - (0.0 - 0.485) / 0.229).abs() < 1e-6);
    }

    #[test]
    fn bytes_come_back_as_they_were() {
        let device = Device::flex();
        let values: Vec<u8> = (0..=255).cycle().take(3 * 256).collect();
        for normalization in [Normalization::Imagenet, Normalization::Half] {
            let tensor =
                to_tensor("pixels", &images(&values, 16, true), (16, normalization), &device).unwrap();
            assert_eq!(to_bytes(tensor.flatten(0, 1), normalization), values);
        }
        // Beyond black and white, and no number.
        let odd = Tensor::<1>::from_floats([-9.0, 9.0, f32::NAN], &device).reshape([1, 3, 1, 1]);
        assert_eq!(to_bytes(odd, Normalization::Half), [0, 255, 0]);
    }

    #[test]
    fn a_device_that_gets_bytes_sees_the_same_images() {
        let device = Device::flex();
        let values: Vec<u8> =
            (0..2 * 3 * 9 * 9).map(|i: usize| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        for (size, channels_last) in [(9, true), (9, false), (6, true), (14, false)] {
            let images = Images { values: &values, rows: 1, steps: 2, height: 9, width: 9, channels_last };
            let make = || to_tensor("pixels", &images, (size, Normalization::Imagenet), &device).unwrap();
            let (host_made, device_made) = (make(), as_on_a_device(make));
            assert_eq!(host_made.dims(), device_made.dims());
            for (a, b) in host(host_made).iter().zip(host(device_made)) {
                assert!((a - b).abs() < 1e-5, "{size}, {channels_last}: {a} and {b}");
            }
        }
    }

    #[test]
    fn resizing_keeps_even_images_and_refuses_oblong_ones() {
        let even = vec![128; 3 * 7 * 7];
        let tensor =
            to_tensor("pixels", &images(&even, 7, true), (4, Normalization::Imagenet), &Device::flex())
                .unwrap();
        assert_eq!(tensor.dims(), [1, 1, 3, 4, 4]);
        let red = (128.0 / 255.0 - 0.485) / 0.229;
        assert!(host(tensor)[..16].iter().all(|value| (value - red).abs() < 1e-5));
        let oblong = Images { height: 3, width: 1, ..images(&even[..9], 1, true) };
        let error = to_tensor("pixels", &oblong, (4, Normalization::Imagenet), &Device::flex())
            .unwrap_err()
            .to_string();
        assert!(error.contains("`pixels`: 3 × 1 pixels"), "{error}");
    }
}
