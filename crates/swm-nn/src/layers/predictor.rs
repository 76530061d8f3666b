//! The predictor of LeWM and PLDM: a causal transformer that actions steer through AdaLN-zero.

use burn::module::{Module, Param};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::attention::{Attend, Attention, FeedForward, KeysValues};
use super::linear::{Linear, parameter};
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
    /// Dim of an attention head.
    #[serde(alias = "head_width")]
    pub head_dim: usize,
    /// Hidden dim of the MLP after each attention.
    pub hidden: usize,
    /// Dropout rate.
    pub dropout: f64,
}

impl Default for PredictorConfig {
    fn default() -> Self {
        Self { depth: 6, heads: 16, head_dim: 64, hidden: 2048, dropout: 0.1 }
    }
}

/// Predicts each next state from those before it and the actions taken.
#[derive(Module, Debug)]
pub struct Predictor {
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
    /// For latents of `dim` values and at most `frames` of them.
    pub fn new(config: &PredictorConfig, dim: usize, frames: usize, device: &Device) -> Self {
        let block = || ConditionalBlock::new(config, dim, device);
        Self {
            pos_embedding: parameter([1, frames, dim], device),
            transformer: Transformer {
                norm: LayerNorm::new(dim, device),
                layers: std::iter::repeat_with(block).take(config.depth).collect(),
            },
        }
    }

    /// `[B, T, W]` states and `[B, T, W]` embedded actions → `[B, T, W]`.
    pub fn forward(&self, states: Tensor<3>, actions: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let frames = states.dims()[1];
        let mut state = states + self.pos_embedding.val().narrow(1, 0, frames);
        for (block, condition) in self.transformer.layers.iter().zip(self.conditions(actions)) {
            state = block.forward(state, condition, pass);
        }
        self.transformer.norm.forward(state)
    }

    /// What embedded actions `[B, T, W]` ask of each block: `[B, T, 6 × W]`.
    pub fn conditions(&self, actions: Tensor<3>) -> Vec<Tensor<3>> {
        let actions = silu(actions);
        self.transformer.layers.iter().map(|block| block.modulation.forward(actions.clone())).collect()
    }

    /// What comes after the last of N states `[B, N, W]` that follow those in `seen`: `[B, 1, W]`. `conditions` are those of
    /// the N states' actions. Equal to the last of [`Predictor::forward`] over all of them, and cheaper: what was computed
    /// of earlier states is not computed again. N is 1 where any were seen before.
    pub fn extend(
        &self,
        states: Tensor<3>,
        conditions: &[Tensor<3>],
        seen: &mut SeenStates,
        pass: &mut Pass,
    ) -> Tensor<3> {
        let count = states.dims()[1];
        let mut state = states + self.pos_embedding.val().narrow(1, seen.count, count);
        seen.count += count;
        seen.blocks.resize_with(self.transformer.layers.len(), || None);
        let last = self.transformer.layers.len().saturating_sub(1);
        for (index, (block, condition)) in self.transformer.layers.iter().zip(conditions).enumerate() {
            state = block.extend(state, condition.clone(), &mut seen.blocks[index], index == last, pass);
        }
        let rest = state.dims()[1];
        self.transformer.norm.forward(state.narrow(1, rest - 1, 1))
    }
}

/// What a predictor keeps of states that it has seen.
#[derive(Default)]
pub struct SeenStates {
    count: usize,
    blocks: Vec<Option<KeysValues>>,
}

impl ConditionalBlock {
    fn new(config: &PredictorConfig, dim: usize, device: &Device) -> Self {
        let &PredictorConfig { heads, head_dim, hidden, dropout, .. } = config;
        Self {
            attn: Attention::new(dim, heads, head_dim, dropout, device),
            mlp: FeedForward::new(dim, hidden, dropout, device),
            norm1: LayerNorm::plain(1e-6),
            norm2: LayerNorm::plain(1e-6),
            modulation: Linear::new(dim, 6 * dim, device),
        }
    }

    /// `condition` is what the actions ask of this block.
    fn forward(&self, state: Tensor<3>, condition: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let [shift_a, scale_a, gate_a, shift_m, scale_m, gate_m] = six(condition);
        let input = modulate(self.norm1.forward(state.clone()), shift_a, scale_a);
        let state = state + gate_a * self.attn.forward(input, &Attend::Causal, pass);
        let input = modulate(self.norm2.forward(state.clone()), shift_m, scale_m);
        state + gate_m * self.mlp.forward(input, pass)
    }

    /// As [`ConditionalBlock::forward`] for states that follow others; of the last alone, if that is all one asks for.
    fn extend(
        &self,
        state: Tensor<3>,
        condition: Tensor<3>,
        seen: &mut Option<KeysValues>,
        only_last: bool,
        pass: &mut Pass,
    ) -> Tensor<3> {
        let count = state.dims()[1];
        let [shift_a, scale_a, gate_a, shift_m, scale_m, gate_m] = six(condition);
        let input = modulate(self.norm1.forward(state.clone()), shift_a, scale_a);
        let looked = self.attn.extend(input, seen, only_last, pass);
        let asked = |tensor: Tensor<3>| if only_last { tensor.narrow(1, count - 1, 1) } else { tensor };
        let state = asked(state) + asked(gate_a) * looked;
        let input = modulate(self.norm2.forward(state.clone()), asked(shift_m), asked(scale_m));
        state + asked(gate_m) * self.mlp.forward(input, pass)
    }
}

/// Shifts, scales and gates of both branches.
fn six(condition: Tensor<3>) -> [Tensor<3>; 6] {
    condition.chunk(6, 2).try_into().expect("six parts of a dim that six divides")
}

fn modulate(input: Tensor<3>, shift: Tensor<3>, scale: Tensor<3>) -> Tensor<3> {
    input * (scale + 1.0) + shift
}
