//! Linear layers and convolutions.

use burn::module::{Module, Param, ParamId};
use burn::tensor::module::{conv2d, linear};
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor};

/// A parameter of zeros; [`initialise`](crate::init::initialise) gives it its first numbers.
pub(crate) fn parameter<const D: usize>(shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    Param::initialized(ParamId::new(), Tensor::zeros(shape, device))
}

/// x W + b.
#[derive(Module, Debug)]
pub(crate) struct Linear {
    /// `[in, out]`.
    weight: Param<Tensor<2>>,
    bias: Option<Param<Tensor<1>>>,
}

impl Linear {
    /// With a bias.
    pub(crate) fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        let bias = Some(parameter([outputs], device));
        Self { bias, ..Self::without_bias(inputs, outputs, device) }
    }

    /// Without one.
    pub(crate) fn without_bias(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self { weight: parameter([inputs, outputs], device), bias: None }
    }

    /// `[…, in]` → `[…, out]`.
    pub(crate) fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        linear(input, self.weight.val(), self.bias.as_ref().map(Param::val))
    }
}

/// A convolution over pictures with square kernels.
#[derive(Module, Debug)]
pub(crate) struct Conv {
    /// `[out, in, K, K]`.
    weight: Param<Tensor<4>>,
    bias: Param<Tensor<1>>,
    #[module(skip)]
    stride: usize,
    #[module(skip)]
    padding: usize,
}

impl Conv {
    /// A kernel of `size` × `size` every `stride` pixels.
    pub(crate) fn new(
        channels: [usize; 2],
        size: usize,
        stride: usize,
        padding: usize,
        device: &Device,
    ) -> Self {
        let [inputs, outputs] = channels;
        Self {
            weight: parameter([outputs, inputs, size, size], device),
            bias: parameter([outputs], device),
            stride,
            padding,
        }
    }

    /// `[N, in, H, W]` → `[N, out, H', W']`.
    pub(crate) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let [outputs, inputs, size, _] = self.weight.dims();
        if size == self.stride && self.padding == 0 {
            return self.forward_patches(input, [outputs, inputs, size]);
        }
        let options = ConvOptions::new([self.stride; 2], [self.padding; 2], [1, 1], 1);
        conv2d(input, self.weight.val(), Some(self.bias.val()), options)
    }

    /// As [`Conv::forward`] where patches do not overlap: one product of matrices, whose gradients are two.
    fn forward_patches(&self, input: Tensor<4>, [outputs, inputs, size]: [usize; 3]) -> Tensor<4> {
        let [count, _, height, width] = input.dims();
        let [rows, columns] = [height / size, width / size];
        let input = if [rows * size, columns * size] == [height, width] {
            input
        } else {
            input.slice([0..count, 0..inputs, 0..rows * size, 0..columns * size])
        };
        let patches = input
            .reshape([count, inputs, rows, size, columns, size])
            .permute([0, 2, 4, 1, 3, 5])
            .reshape([count, rows * columns, inputs * size * size]);
        let weight = self.weight.val().reshape([outputs, inputs * size * size]).transpose();
        let output = linear(patches, weight, Some(self.bias.val()));
        output.swap_dims(1, 2).reshape([count, outputs, rows, columns])
    }
}
