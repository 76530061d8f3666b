//! The predictor of DINO-WM: a transformer over the tokens of some frames, in which tokens see their own and earlier frames.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

use super::attention::{Attention, FeedForward};
use super::goal::{TokenForm, later_frames};
use super::linear::parameter;
use super::norm::LayerNorm;
use super::predictor::PredictorConfig;
use crate::pass::Pass;

/// Predicts the tokens of each next frame.
#[derive(Module, Debug)]
pub struct FramePredictor {
    /// `[1, T × P, W]`.
    pos_embedding: Param<Tensor<3>>,
    transformer: FrameTransformer,
}

#[derive(Module, Debug)]
struct FrameTransformer {
    norm: LayerNorm,
    layers: Vec<FramePair>,
}

#[derive(Module, Debug)]
struct FramePair {
    attention: Attention,
    feed_forward: FeedForward,
}

impl FramePredictor {
    /// For frames of this form.
    pub fn new(config: &PredictorConfig, form: &TokenForm, device: &Device) -> Self {
        let &PredictorConfig { heads, head_dim, hidden, dropout, .. } = config;
        let pair = || FramePair {
            attention: Attention::new(form.dim, heads, head_dim, dropout, device),
            feed_forward: FeedForward::new(form.dim, hidden, dropout, device),
        };
        Self {
            pos_embedding: parameter([1, form.frames * form.patches, form.dim], device),
            transformer: FrameTransformer {
                norm: LayerNorm::new(form.dim, device),
                layers: std::iter::repeat_with(pair).take(config.depth).collect(),
            },
        }
    }

    /// `[B, T, P, W]` → `[B, T, P, W]`.
    pub fn forward(&self, frames: Tensor<4>, pass: &mut Pass) -> Tensor<4> {
        let shape @ [_, count, patches, _] = frames.dims();
        let positions = self.pos_embedding.val().narrow(1, 0, count * patches);
        let mut state = frames.flatten::<3>(1, 2) + positions;
        let who = later_frames(count, patches, patches, &state);
        for layer in &self.transformer.layers {
            state = layer.attention.forward(state.clone(), &who, pass) + state;
            state = layer.feed_forward.forward(state.clone(), pass) + state;
        }
        self.transformer.norm.forward(state).reshape(shape)
    }
}
