//! Linear layers and convolutions.

use burn::module::{Module, Param, ParamId};
use burn::tensor::{Device, FloatDType, Tensor};

use super::activation::Activation;
use super::convolution::{Kernel, convolve};
use crate::kernels::{Then, linear};

/// A parameter of zeros; [`initialize`](crate::init::initialize) gives it its first values.
pub fn parameter<const D: usize>(shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    Param::initialized(ParamId::new(), Tensor::zeros(shape, device))
}

/// x W + b.
#[derive(Module, Debug)]
pub struct Linear {
    /// `[in, out]`.
    weight: Param<Tensor<2>>,
    bias: Option<Param<Tensor<1>>>,
}

impl Linear {
    /// With a bias.
    pub fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        let bias = Some(parameter([outputs], device));
        Self { bias, ..Self::without_bias(inputs, outputs, device) }
    }

    /// Without one.
    pub fn without_bias(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self { weight: parameter([inputs, outputs], device), bias: None }
    }

    /// `[…, in]` → `[…, out]`, in fp32.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        self.forward_narrow(input).cast(FloatDType::F32)
    }

    /// `[…, in]` → `[…, out]`, in the precision of the weights: for what goes into another product.
    pub fn forward_narrow<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        self.forward_then(input, Then::Nothing)
    }

    /// The same, and a GELU after it.
    pub fn forward_gelu<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        self.forward_then(input, Then::Gelu)
    }

    fn forward_then<const D: usize>(&self, input: Tensor<D>, then: Then) -> Tensor<D> {
        let weight = self.weight.val();
        linear(input.cast(weight.dtype()), weight, self.bias.as_ref().map(Param::val), then)
    }
}

/// A convolution over images with square kernels.
#[derive(Module, Debug)]
pub struct Conv {
    /// `[out, in, K, K]`.
    weight: Param<Tensor<4>>,
    bias: Param<Tensor<1>>,
}

impl Conv {
    /// A kernel of `size` × `size` pixels.
    pub fn new([inputs, outputs]: [usize; 2], size: usize, device: &Device) -> Self {
        Self { weight: parameter([outputs, inputs, size, size], device), bias: parameter([outputs], device) }
    }

    /// A kernel with stride K, without overlap: `[N, in, H, W]` → `[N, out, H / K, W / K]`. One product of matrices, whose
    /// gradients are two.
    pub fn forward_patches(&self, input: Tensor<4>) -> Tensor<4> {
        let [outputs, inputs, size, _] = self.weight.dims();
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
        let patches = patches.cast(weight.dtype());
        let output = linear(patches, weight, Some(self.bias.val()), Then::Nothing).cast(FloatDType::F32);
        output.swap_dims(1, 2).reshape([count, outputs, rows, columns])
    }

    /// The kernel at every second pixel, its middle on it, rectified: `[N, H, W, in]` → `[N, ⌈H / 2⌉, ⌈W / 2⌉, out]`.
    pub fn halve(&self, input: Tensor<4>) -> Tensor<4> {
        self.rectified(input, 2)
    }

    /// The kernel at every `stride`-th pixel, rectified, with as many zeros around the image as leave ⌈pixels / stride⌉ places
    /// where the stride divides the pixels: `[N, H, W, in]` → `[N, H / stride, W / stride, out]`.
    pub fn rectified(&self, input: Tensor<4>, stride: usize) -> Tensor<4> {
        let padding = (self.size() - stride).div_ceil(2);
        self.convolve(input, stride, padding, Activation::Relu)
    }

    /// The kernel at every `stride`-th pixel, nothing around the image, then Mish: `[N, H, W, in]` → `[N, H', W', out]`.
    pub fn with_mish(&self, input: Tensor<4>, stride: usize) -> Tensor<4> {
        self.convolve(input, stride, 0, Activation::Mish)
    }

    fn size(&self) -> usize {
        self.weight.dims()[2]
    }

    fn convolve(&self, input: Tensor<4>, stride: usize, padding: usize, activation: Activation) -> Tensor<4> {
        let [outputs, inputs, size, _] = self.weight.dims();
        let weight = self.weight.val().permute([2, 3, 1, 0]).reshape([size * size * inputs, outputs]);
        convolve(input, weight, self.bias.val(), Kernel { size, stride, padding }, activation)
    }
}
