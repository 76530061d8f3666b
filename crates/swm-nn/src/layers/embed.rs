//! Embedders of actions and of proprioception.

use burn::module::{Module, Param};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};

use super::linear::{Linear, parameter};
use crate::kernels::{Then, linear};

/// A convolution of size 1 over time: a linear layer with the weights of a convolution.
#[derive(Module, Debug)]
pub struct StateEmbedder {
    patch_embed: PointConv,
}

#[derive(Module, Debug)]
struct PointConv {
    /// `[out, in, 1]`.
    weight: Param<Tensor<3>>,
    bias: Param<Tensor<1>>,
}

impl PointConv {
    fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self { weight: parameter([outputs, inputs, 1], device), bias: parameter([outputs], device) }
    }

    /// `[B, T, in]` → `[B, T, out]`.
    fn forward(&self, input: Tensor<3>) -> Tensor<3> {
        let weight = self.weight.val().squeeze_dim::<2>(2).transpose();
        linear(input, weight, Some(self.bias.val()), Then::Nothing)
    }
}

impl StateEmbedder {
    /// From `inputs` to `outputs` values.
    pub fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self { patch_embed: PointConv::new(inputs, outputs, device) }
    }

    /// `[B, T, in]` → `[B, T, out]`.
    pub fn forward(&self, input: Tensor<3>) -> Tensor<3> {
        self.patch_embed.forward(input)
    }

    /// Dim of an embedding.
    pub fn dim(&self) -> usize {
        self.patch_embed.bias.dims()[0]
    }
}

/// What LeWM and PLDM make of the actions of a step: a convolution of size 1, then two linear layers with a SiLU.
#[derive(Module, Debug)]
pub struct ActionEmbedder {
    patch_embed: PointConv,
    up: Linear,
    down: Linear,
}

impl ActionEmbedder {
    /// From `inputs` by way of `smoothed` and four times `outputs` to `outputs` values.
    pub fn new(inputs: usize, smoothed: usize, outputs: usize, device: &Device) -> Self {
        Self {
            patch_embed: PointConv::new(inputs, smoothed, device),
            up: Linear::new(smoothed, 4 * outputs, device),
            down: Linear::new(4 * outputs, outputs, device),
        }
    }

    /// `[B, T, in]` → `[B, T, out]`.
    pub fn forward(&self, input: Tensor<3>) -> Tensor<3> {
        self.down.forward(silu(self.up.forward(self.patch_embed.forward(input))))
    }
}
