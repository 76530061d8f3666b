//! From an image to an image of the same size: convolutions that halve it three times, and back, with a look at what each half had
//! before (U-Net, Ronneberger et al. 2015, arXiv 1505.04597). Made for images of 64 pixels and a CPU.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::linear::{Conv, Linear};

/// How often the image is halved.
pub const HALVINGS: usize = 3;
/// Pixels along a side of what the last layer draws at each place.
const BLOCK: usize = 2;

/// The network.
#[derive(Module, Debug)]
pub struct ImageTranslator {
    half: Conv,
    quarter: Conv,
    quarter_again: Conv,
    eighth: Conv,
    eighth_again: Conv,
    up_to_quarter: Conv,
    up_to_half: Conv,
    blocks: Linear,
}

impl ImageTranslator {
    /// From `inputs` maps to three colors; `channels` at a half, a quarter and an eighth of the image.
    pub fn new(inputs: usize, channels: [usize; HALVINGS], device: &Device) -> Self {
        let [half, quarter, eighth] = channels;
        let small = |maps| Conv::new(maps, 3, device);
        Self {
            half: Conv::new([inputs, half], 5, device),
            quarter: small([half, quarter]),
            quarter_again: small([quarter; 2]),
            eighth: small([quarter, eighth]),
            eighth_again: small([eighth; 2]),
            up_to_quarter: small([eighth + quarter, quarter]),
            up_to_half: small([quarter + half, half]),
            blocks: Linear::new(half, 3 * BLOCK * BLOCK, device),
        }
    }

    /// `[N, H, W, inputs]` → `[N, 3, H, W]`; sides are multiples of 8.
    pub fn forward(&self, seen: Tensor<4>) -> Tensor<4> {
        let half = self.half.halve(seen);
        let quarter = self.quarter_again.rectified(self.quarter.halve(half.clone()), 1);
        let eighth = self.eighth_again.rectified(self.eighth.halve(quarter.clone()), 1);
        let up = |coarse: Tensor<4>, fine: Tensor<4>| Tensor::cat(vec![doubled(coarse), fine], 3);
        let quarter = self.up_to_quarter.rectified(up(eighth, quarter), 1);
        let half = self.up_to_half.rectified(up(quarter, half), 1);
        let [count, rows, columns, _] = half.dims();
        let blocks: Tensor<6> = self.blocks.forward(half).reshape([count, rows, columns, BLOCK, BLOCK, 3]);
        blocks.permute([0, 5, 1, 3, 2, 4]).reshape([count, 3, rows * BLOCK, columns * BLOCK])
    }
}

/// Each place as two by two: `[N, H, W, C]` → `[N, 2 H, 2 W, C]`.
fn doubled(maps: Tensor<4>) -> Tensor<4> {
    let [count, rows, columns, channels] = maps.dims();
    let maps: Tensor<6> = maps.reshape([count, rows, 1, columns, 1, channels]);
    maps.expand([count, rows, 2, columns, 2, channels]).reshape([count, 2 * rows, 2 * columns, channels])
}

/// x and y of each pixel, from -1 to 1: `[count, side, side, 2]`.
pub fn coordinates(count: usize, side: usize, device: &Device) -> Tensor<4> {
    let place = |index: usize| (2 * index + 1) as f32 / side as f32 - 1.0;
    let values: Vec<f32> = (0..side * side).flat_map(|at| [place(at % side), place(at / side)]).collect();
    let one = Tensor::<4>::from_data(TensorData::new(values, [1, side, side, 2]), device);
    one.expand([count, side, side, 2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::initialize;
    use crate::params::host;

    #[test]
    fn images_keep_their_size_and_places_their_order() {
        let device = Device::flex();
        let network = initialize(ImageTranslator::new(5, [4, 6, 8], &device), 1);
        for side in [16, 24, 64] {
            let drawn = network.forward(Tensor::zeros([2, side, side, 5], &device));
            assert_eq!(drawn.dims(), [2, 3, side, side]);
        }
        // What is seen in one corner changes what is drawn there, and not in the opposite one.
        let mut values = vec![0.0; 64 * 64 * 5];
        let dark = host(network.forward(Tensor::zeros([1, 64, 64, 5], &device)));
        values[..4 * 5].fill(9.0);
        let seen = Tensor::<4>::from_data(TensorData::new(values, [1, 64, 64, 5]), &device);
        let lit = host(network.forward(seen));
        let differs = |y: usize, x: usize| dark[y * 64 + x] != lit[y * 64 + x];
        assert!((0..4).any(|x| differs(0, x)) && !differs(63, 63));
    }

    #[test]
    fn doubled_places_are_neighbors() {
        let device = Device::flex();
        let maps = Tensor::<1>::from_floats([1.0, 2.0, 3.0, 4.0], &device).reshape([1, 2, 2, 1]);
        let wanted = [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 4.0, 4.0];
        assert_eq!(host(doubled(maps)), wanted);
        let corners = host(coordinates(2, 2, &device));
        assert_eq!(corners[..8], [-0.5, -0.5, 0.5, -0.5, -0.5, 0.5, 0.5, 0.5]);
        assert_eq!(corners[..8], corners[8..]);
    }
}
