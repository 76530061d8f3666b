//! The predictor of LeWM and PLDM: a causal transformer that actions steer through AdaLN-zero.

use burn::module::{Module, Param};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::attention::{Attend, Attention, FeedForward};
use super::layers::{Linear, parameter};
use super::norm::LayerNorm;
use crate::pass::Pass;

/// Its size. The defaults are the paper's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PredictorConfig {
    /// Blocks.
    pub depth: usize,
    /// Heads of attention.
    pub heads: usize,
    /// Numbers of a head.
    pub head_width: usize,
    /// Hidden numbers of the network after each attention.
    pub hidden: usize,
    /// Share of numbers dropped in training.
    pub dropout: f64,
}

impl Default for PredictorConfig {
    fn default() -> Self {
        Self { depth: 6, heads: 16, head_width: 64, hidden: 2048, dropout: 0.1 }
    }
}

/// Predicts each next state from those before it and the actions taken.
#[derive(Module, Debug)]
pub(crate) struct Predictor {
    /// `[1, frames, W]`.
    pos_embedding: Param<Tensor<3>>,
    transformer: Transformer,
}

#[derive(Module, Debug)]
struct Transformer {
    norm: LayerNorm,
    layers: Vec<ConditionalBlock>,
}

#[derive(Module, Debug)]
struct ConditionalBlock {
    attn: Attention,
    mlp: FeedForward,
    norm1: LayerNorm,
    norm2: LayerNorm,
    modulation: Linear,
}

impl Predictor {
    /// For states of `width` numbers and at most `frames` of them.
    pub(crate) fn new(config: &PredictorConfig, width: usize, frames: usize, device: &Device) -> Self {
        let block = || ConditionalBlock::new(config, width, device);
        Self {
            pos_embedding: parameter([1, frames, width], device),
            transformer: Transformer {
                norm: LayerNorm::new(width, device),
                layers: std::iter::repeat_with(block).take(config.depth).collect(),
            },
        }
    }

    /// `[B, T, W]` states and `[B, T, W]` embedded actions → `[B, T, W]`.
    pub(crate) fn forward(&self, states: Tensor<3>, actions: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let frames = states.dims()[1];
        let mut state = states + self.pos_embedding.val().narrow(1, 0, frames);
        let actions = silu(actions);
        for block in &self.transformer.layers {
            state = block.forward(state, actions.clone(), pass);
        }
        self.transformer.norm.forward(state)
    }
}

impl ConditionalBlock {
    fn new(config: &PredictorConfig, width: usize, device: &Device) -> Self {
        let &PredictorConfig { heads, head_width, hidden, dropout, .. } = config;
        Self {
            attn: Attention::new(width, heads, head_width, dropout, device),
            mlp: FeedForward::new(width, hidden, dropout, device),
            norm1: LayerNorm::plain(1e-6),
            norm2: LayerNorm::plain(1e-6),
            modulation: Linear::new(width, 6 * width, device),
        }
    }

    /// `actions` have gone through the SiLU that comes before the modulation.
    fn forward(&self, state: Tensor<3>, actions: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let parts = self.modulation.forward(actions).chunk(6, 2);
        let parts: [Tensor<3>; 6] = parts.try_into().expect("six parts of a width that six divides");
        let [shift_a, scale_a, gate_a, shift_m, scale_m, gate_m] = parts;
        let input = modulate(self.norm1.forward(state.clone()), shift_a, scale_a);
        let state = state + gate_a * self.attn.forward(input, &Attend::Causal, pass);
        let input = modulate(self.norm2.forward(state.clone()), shift_m, scale_m);
        state + gate_m * self.mlp.forward(input, pass)
    }
}

fn modulate(input: Tensor<3>, shift: Tensor<3>, scale: Tensor<3>) -> Tensor<3> {
    input * (scale + 1.0) + shift
}
