//! Normalizations, each with PyTorch's formula.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

use super::linear::parameter;
use crate::kernels::layer_norm;
use crate::pass::Pass;

/// Over the last axis; the variance is the biased one.
#[derive(Module, Debug)]
pub struct LayerNorm {
    weight: Option<Param<Tensor<1>>>,
    bias: Option<Param<Tensor<1>>>,
    #[module(skip)]
    epsilon: f64,
}

impl LayerNorm {
    /// With a scale and a shift, and PyTorch's epsilon of 1e-5.
    pub fn new(dim: usize, device: &Device) -> Self {
        Self::with_epsilon(dim, 1e-5, device)
    }

    /// With a scale and a shift.
    pub fn with_epsilon(dim: usize, epsilon: f64, device: &Device) -> Self {
        let [weight, bias] = [parameter([dim], device), parameter([dim], device)].map(Some);
        Self { weight, bias, epsilon }
    }

    /// Without either.
    pub fn plain(epsilon: f64) -> Self {
        Self { weight: None, bias: None, epsilon }
    }

    /// `[…, W]` → `[…, W]`.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        if let (Some(weight), Some(bias)) = (&self.weight, &self.bias) {
            return layer_norm(input, weight.val(), Some(bias.val()), self.epsilon);
        }
        let dim = input.dims()[D - 1];
        let ones = Tensor::ones([dim], &input.device().inner());
        layer_norm(input, ones, None, self.epsilon)
    }
}

/// Over a batch: its own statistics in training (and where running ones are estimated), running ones otherwise.
#[derive(Module, Debug)]
pub(crate) struct BatchNorm {
    weight: Param<Tensor<1>>,
    bias: Param<Tensor<1>>,
    running_mean: Param<Tensor<1>>,
    running_var: Param<Tensor<1>>,
}

impl BatchNorm {
    const EPSILON: f32 = 1e-5;

    /// For `[N, D]`.
    pub(crate) fn new(dim: usize, device: &Device) -> Self {
        let [weight, bias, running_mean, running_var] = std::array::from_fn(|_| parameter([dim], device));
        Self { weight, bias, running_mean, running_var }
    }

    /// `[N, W]` → `[N, W]`; in training N must be more than 1.
    pub(crate) fn forward(&self, input: Tensor<2>, pass: &mut Pass) -> Tensor<2> {
        let (centered, variance) = if let Some(share) = pass.batch_share() {
            let count = input.dims()[0] as f32;
            let mean = input.clone().mean_dim(0);
            let centered = input - mean.clone();
            let variance = centered.clone().square().mean_dim(0);
            let unbiased = variance.clone() * (count / (count - 1.0));
            follow(&self.running_mean, mean, share, pass);
            follow(&self.running_var, unbiased, share, pass);
            (centered, variance)
        } else {
            (input - self.running_mean.val().unsqueeze(), self.running_var.val().unsqueeze())
        };
        let scale = self.weight.val().unsqueeze() / (variance + Self::EPSILON).sqrt();
        centered * scale + self.bias.val().unsqueeze()
    }
}

fn follow(running: &Param<Tensor<1>>, new: Tensor<2>, share: f32, pass: &mut Pass) {
    let old = running.val() * (1.0 - share);
    let value = old + new.inner().squeeze_dim(0) * share;
    // A layer that is called twice in a step follows both batches.
    pass.statistics.retain(|(id, _)| *id != running.id);
    pass.statistics.push((running.id, value));
}
