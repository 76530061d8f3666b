//! An image drawn from places: what an encoder of places shall know, told by the image itself.
//!
//! As the deep spatial autoencoder (Finn et al. 2016, arXiv 1509.06113), with places drawn as blobs before anything is decoded
//! (Jakab et al. 2018, arXiv 1806.07823). Each cell of a grid is decoded by itself, so it can only be right where places are.

use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::background::Background;
use super::linear::Linear;

/// Cells along each side of the grid.
const CELLS: usize = 32;
/// The std of a blob, where the image is 2 wide: two cells.
const BLOB: f64 = 0.125;
/// Dim of what decodes a cell.
const HIDDEN: usize = 32;
/// What drawings are multiplied by: what moves stands out from the background by several stds of all pixels, and is drawn sooner.
const CONTRAST: f64 = 3.0;

/// Blobs at the places, and an MLP over those of each cell.
#[derive(Module, Debug)]
pub struct Drawing {
    background: Background,
    up: Linear,
    down: Linear,
}

impl Drawing {
    /// Of `places` places, for images of `size` × `size` pixels, a multiple of `CELLS`, 32.
    pub fn new(places: usize, size: usize, device: &Device) -> Self {
        Self {
            background: Background::new([size; 2], device),
            up: Linear::new(places, HIDDEN, device),
            down: Linear::new(HIDDEN, 3, device),
        }
    }

    /// What is wrong with a weight of drawings of such images, if anything is; `has_places` of an encoder that gives some.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(weight: f64, has_places: bool, image: usize) -> Result<(), String> {
        if !(weight.is_finite() && weight >= 0.0) {
            return Err(format!("`weights.drawing` is {weight}; it must be a number of at least 0"));
        }
        match (weight == 0.0, has_places, image.is_multiple_of(CELLS)) {
            (true, ..) | (_, true, true) => Ok(()),
            (_, true, false) => Err(format!(
                "`model.image` is {image}; `weights.drawing` needs a multiple of {CELLS}, or must be 0"
            )),
            (_, false, _) => Err("`weights.drawing` draws from places, and `model.encoder.kind` gives none; take `keypoints`, or \
                                  a weight of 0"
                .to_owned()),
        }
    }

    /// As [`Drawing::unexplained`], of the first and the last image of each clip, as those between differ little: images
    /// `[B, T, 3, S, S]`, places `[B, T, 2 K]`.
    pub fn unexplained_in_clips(&self, images: &Tensor<5>, places: &Tensor<3>) -> Tensor<1> {
        let last = images.dims()[1] - 1;
        let images = |step| images.clone().narrow(1, step, 1).squeeze_dim::<4>(1);
        let places = |step| places.clone().narrow(1, step, 1).squeeze_dim::<2>(1);
        self.unexplained(
            Tensor::cat(vec![images(0), images(last)], 0),
            Tensor::cat(vec![places(0), places(last)], 0),
        )
    }

    /// The share of the variance of images that drawings from their places do not explain: of images `[N, 3, S, S]` without
    /// background, as means over the pixels of each cell; places `[N, 2 K]`, from -1 to 1.
    pub fn unexplained(&self, images: Tensor<4>, places: Tensor<2>) -> Tensor<1> {
        let wanted = means_of_cells(self.background.remove(images));
        let drawn = self.down.forward(relu(self.up.forward(blobs(places))));
        let variance = wanted.clone().square().mean().clamp_min(1e-6);
        (drawn * CONTRAST - wanted).square().mean() / variance
    }
}

/// `[N, 3, S, S]` → `[N, CELLS², 3]`.
fn means_of_cells(images: Tensor<4>) -> Tensor<3> {
    let [count, colors, size, _] = images.dims();
    let side = size / CELLS;
    let cells: Tensor<6> = images.reshape([count, colors, CELLS, side, CELLS, side]);
    let means = cells.mean_dim(5).mean_dim(3).permute([0, 2, 4, 1, 3, 5]);
    means.reshape([count, CELLS * CELLS, colors])
}

/// `[N, 2 K]` → `[N, CELLS², K]`: exp(-d² / 2 BLOB²) of the distance d of each cell's middle to each place.
fn blobs(places: Tensor<2>) -> Tensor<3> {
    let [count, values] = places.dims();
    let device = places.device().inner();
    let middles: Vec<f32> = (0..CELLS).map(|cell| (2 * cell + 1) as f32 / CELLS as f32 - 1.0).collect();
    let middles = Tensor::<1>::from_floats(middles.as_slice(), &device).reshape([1, CELLS, 1]);
    let places: Tensor<3> = places.reshape([count, values / 2, 2]);
    let along = |axis: usize| {
        let places: Tensor<3> = places.clone().narrow(2, axis, 1).swap_dims(1, 2);
        ((middles.clone() - places).square() * (-0.5 / (BLOB * BLOB))).exp()
    };
    let columns: Tensor<4> = along(0).unsqueeze_dim(1);
    let rows: Tensor<4> = along(1).unsqueeze_dim(2);
    (rows * columns).reshape([count, CELLS * CELLS, values / 2])
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;
    use crate::init::initialize;
    use crate::params::host;

    #[test]
    fn blobs_stand_where_places_are() {
        let device = Device::flex();
        // The middles of column 9 of row 2, and of column 0 of row 31.
        let place = |cell: f32| (2.0 * cell + 1.0) / 32.0 - 1.0;
        let places = Tensor::from_floats([[place(9.0), place(2.0), place(0.0), place(31.0)]], &device);
        let found = host(blobs(places));
        let at = |row: usize, column: usize, index: usize| found[(row * CELLS + column) * 2 + index];
        let near = |found: f32, wanted: f32| (found - wanted).abs() < 1e-5;
        assert!(near(at(2, 9, 0), 1.0) && near(at(31, 0, 1), 1.0), "{found:?}");
        // Two cells away along one axis, a std; along both, √2 of it.
        assert!(near(at(2, 11, 0), (-0.5f32).exp()) && near(at(4, 7, 0), (-1.0f32).exp()));
        assert!(near(at(25, 0, 1), (-4.5f32).exp()) && at(31, 18, 1) < 1e-4);
    }

    #[test]
    fn cells_are_means_of_their_pixels() {
        let device = Device::flex();
        let value = |color: usize, y: usize, x: usize| (color * 2000 + y / 2 * 40 + x / 2) as f32;
        let mut pixels = Vec::new();
        for (color, y, x) in (0..3).flat_map(|c| (0..64).flat_map(move |y| (0..64).map(move |x| (c, y, x)))) {
            // The four pixels of a cell differ, around its mean.
            pixels.push(value(color, y, x) + [[-3.0, 1.0], [2.0, 0.0]][y % 2][x % 2]);
        }
        let images = Tensor::<4>::from_data(TensorData::new(pixels, [1, 3, 64, 64]), &device);
        let found = host(means_of_cells(images));
        for (cell, found) in found.chunks_exact(3).enumerate() {
            let wanted = |color| value(color, cell / CELLS * 2, cell % CELLS * 2);
            assert!((0..3).all(|color| (found[color] - wanted(color)).abs() < 1e-3), "{cell}: {found:?}");
        }
    }

    #[test]
    fn a_drawing_without_blobs_is_the_same_in_all_cells() {
        let device = Device::flex();
        let drawing = initialize(Drawing::new(1, 32, &device), 1);
        // All images gray: nothing varies, and nothing is divided by 0.
        let gray = Tensor::<4>::ones([2, 3, 32, 32], &device);
        assert!(host(drawing.unexplained(gray, Tensor::zeros([2, 2], &device)))[0].is_finite());
        let pixels: Vec<f32> = (0..2 * 3072).map(|at| (at as f32 * 0.7).sin()).collect();
        let images = Tensor::<4>::from_data(TensorData::new(pixels.clone(), [2, 3, 32, 32]), &device);
        let far = Tensor::<2>::from_floats([[9.0, 9.0], [9.0, 9.0]], &device);
        // Without blobs, a cell is drawn as its biases say, the same everywhere.
        let drawn = host(drawing.down.forward(relu(drawing.up.forward(Tensor::<2>::zeros([1, 1], &device)))));
        let apart = |at: usize| (pixels[at] - 3.0 * drawn[at / 1024 % 3]).powi(2);
        let error = (0..pixels.len()).map(apart).sum::<f32>();
        let wanted = error / pixels.iter().map(|pixel| pixel.powi(2)).sum::<f32>();
        let found = host(drawing.unexplained(images, far))[0];
        assert!((found - wanted).abs() < 1e-4 * wanted, "{found}, not {wanted}");
    }
}
