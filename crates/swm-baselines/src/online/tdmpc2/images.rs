//! TD-MPC2's encoder of images, before SimNorm, as the reference computes it and with its names of tensors.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use swm_nn::{Conv, Linear};

/// Kernel and stride of each convolution.
const KERNELS: [[usize; 2]; 4] = [[7, 2], [5, 2], [3, 2], [3, 1]];

/// The smallest side of images of which the convolutions leave something.
pub(super) const LEAST_SIDE: usize = 39;

/// Four convolutions without padding, each followed by Mish, then one linear layer.
#[derive(Module, Debug)]
pub(super) struct ImageEncoder {
    convolutions: ImageConvolutions,
    output: Linear,
}

#[derive(Module, Debug)]
struct ImageConvolutions {
    first: Conv,
    second: Conv,
    third: Conv,
    fourth: Conv,
}

impl ImageEncoder {
    /// For images of `side` × `side` pixels, [`LEAST_SIDE`] or more.
    pub(super) fn new(side: usize, channels: usize, outputs: usize, device: &Device) -> Self {
        let conv = |index: usize, inputs| Conv::new([inputs, channels], KERNELS[index][0], device);
        let left = side_left(side);
        Self {
            convolutions: ImageConvolutions {
                first: conv(0, 3),
                second: conv(1, channels),
                third: conv(2, channels),
                fourth: conv(3, channels),
            },
            output: Linear::new(channels * left * left, outputs, device),
        }
    }

    /// `[N, 3, S, S]`, normalized → `[N, outputs]`.
    pub(super) fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let ImageConvolutions { first, second, third, fourth } = &self.convolutions;
        let layers = [first, second, third, fourth];
        let maps = layers
            .iter()
            .zip(KERNELS)
            .fold(images.permute([0, 2, 3, 1]), |maps, (layer, [_, stride])| layer.with_mish(maps, stride));
        self.output.forward(maps.permute([0, 3, 1, 2]).flatten(1, 3))
    }
}

/// The side of what the convolutions leave of an image of [`LEAST_SIDE`] or more.
fn side_left(side: usize) -> usize {
    KERNELS.iter().fold(side, |side, [kernel, stride]| (side - kernel) / stride + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn convolutions_leave_what_the_references_do() {
        assert_eq!([64, 48, LEAST_SIDE].map(side_left), [4, 2, 1]);
        let device = Device::flex();
        let encoder = ImageEncoder::new(48, 5, 7, &device);
        assert_eq!(encoder.forward(Tensor::zeros([2, 3, 48, 48], &device)).dims(), [2, 7]);
    }
}
