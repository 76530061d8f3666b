//! Projectors and heads of few layers.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::linear::Linear;
use super::norm::{BatchNorm, LayerNorm};
use crate::kernels::gelu;
use crate::pass::Pass;

/// Linear, batch norm, GELU, linear.
#[derive(Module, Debug)]
pub struct Mlp {
    up: Linear,
    norm: BatchNorm,
    down: Linear,
}

impl Mlp {
    /// From `inputs` by way of `hidden` to `outputs`.
    pub fn new(inputs: usize, hidden: usize, outputs: usize, device: &Device) -> Self {
        Self {
            up: Linear::new(inputs, hidden, device),
            norm: BatchNorm::new(hidden, device),
            down: Linear::new(hidden, outputs, device),
        }
    }

    /// `[N, in]` → `[N, out]`.
    pub fn forward(&self, input: Tensor<2>, pass: &mut Pass) -> Tensor<2> {
        self.down.forward(gelu(self.norm.forward(self.up.forward(input), pass)))
    }

    /// `[B, T, in]` → `[B, T, out]`, one batch of B × T for the norm.
    pub fn forward_frames(&self, input: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let [batch, frames, dim] = input.dims();
        let output = self.forward(input.reshape([batch * frames, dim]), pass);
        let dim = output.dims()[1];
        output.reshape([batch, frames, dim])
    }
}

/// Tells the actions between two states.
#[derive(Module, Debug)]
pub struct InverseDynamics {
    up: Linear,
    norm: LayerNorm,
    down: Linear,
}

impl InverseDynamics {
    /// From two latents of `dim` values.
    pub fn new(dim: usize, hidden: usize, actions: usize, device: &Device) -> Self {
        Self {
            up: Linear::new(2 * dim, hidden, device),
            norm: LayerNorm::new(hidden, device),
            down: Linear::new(hidden, actions, device),
        }
    }

    /// `[B, T, W]` → `[B, T - 1, D]`: the actions that led from each state to the next. The later state comes first.
    pub fn forward(&self, states: Tensor<3>) -> Tensor<3> {
        let frames = states.dims()[1];
        let pairs =
            Tensor::cat(vec![states.clone().narrow(1, 1, frames - 1), states.narrow(1, 0, frames - 1)], 2);
        self.down.forward(gelu(self.norm.forward(self.up.forward(pairs))))
    }
}
