//! A convolutional encoder that keeps the grid of the image: a feature map instead of one vector, so that what stands where
//! needs not be told by a linear layer.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::background::Background;
use super::linear::Conv;
use super::projector::Mlp;
use crate::pass::Pass;

/// Side and stride of the first kernel.
const STEM: [usize; 2] = [8, 4];

/// A stem of 8 × 8 pixels at every fourth, convolutions that halve the map, a residual convolution at the last size, and an MLP
/// over the channels of each cell.
#[derive(Module, Debug)]
pub struct FeatureMapEncoder {
    background: Background,
    stem: Conv,
    layers: Vec<Conv>,
    residual: Conv,
    projector: Mlp,
}

impl FeatureMapEncoder {
    /// For images of `image` × `image` pixels; `channels` of the stem and of each layer after it, at least one; tokens of
    /// `token_dim` values by way of `hidden`.
    pub fn new(image: usize, channels: &[usize], hidden: usize, token_dim: usize, device: &Device) -> Self {
        let last = channels[channels.len() - 1];
        let layer = |pair: &[usize]| Conv::new([pair[0], pair[1]], 3, device);
        Self {
            background: Background::new([image; 2], device),
            stem: Conv::new([3, channels[0]], STEM[0], device),
            layers: channels.windows(2).map(layer).collect(),
            residual: Conv::new([last; 2], 3, device),
            projector: Mlp::new(last, hidden, token_dim, device),
        }
    }

    /// What is wrong with a configuration, if anything is.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(image: usize, channels: &[usize]) -> Result<(), String> {
        if image < STEM[0] {
            return Err(format!(
                "`model.image` is {image}; the first convolution covers {0} × {0} pixels: use {0} or more",
                STEM[0]
            ));
        }
        if channels.is_empty() || channels.contains(&0) {
            return Err(
                "`model.channels` must list the channels of at least one layer, none of them 0".to_owned()
            );
        }
        Ok(())
    }

    /// The side of the map of an image of this side.
    pub fn grid(image: usize, channels: &[usize]) -> usize {
        (1..channels.len()).fold(image / STEM[1], |side, _| side.div_ceil(2))
    }

    /// `[N, 3, S, S]` → `[N, G, G, C]`.
    pub fn forward(&self, images: Tensor<4>, pass: &mut Pass) -> Tensor<4> {
        let seen = self.background.remove(images).permute([0, 2, 3, 1]);
        let maps =
            self.layers.iter().fold(self.stem.rectified(seen, STEM[1]), |maps, layer| layer.halve(maps));
        let maps = maps.clone() + self.residual.rectified(maps, 1);
        let [count, rows, columns, channels] = maps.dims();
        let tokens = self.projector.forward(maps.reshape([count * rows * columns, channels]), pass);
        let dim = tokens.dims()[1];
        tokens.reshape([count, rows, columns, dim])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::initialize;

    #[test]
    fn maps_have_the_grid_that_is_computed() {
        let device = Device::flex();
        for (image, channels, grid) in
            [(96, &[4, 4, 4][..], 6), (64, &[4, 4, 4], 4), (30, &[4, 4], 4), (8, &[4], 2)]
        {
            assert_eq!(FeatureMapEncoder::grid(image, channels), grid);
            let encoder = initialize(FeatureMapEncoder::new(image, channels, 5, 3, &device), 1);
            let images = Tensor::ones([2, 3, image, image], &device);
            assert_eq!(encoder.forward(images, &mut Pass::evaluate()).dims(), [2, grid, grid, 3], "{image}");
        }
        assert!(FeatureMapEncoder::check(7, &[4]).is_err() && FeatureMapEncoder::check(8, &[]).is_err());
    }
}
