//! HILP's value network: minus the distance between embeddings of frames and goal. Both go through the same transformer, so
//! that values are symmetric and keep the triangle inequality.
//!
//! Source: Park, Kreiman and Levine, *Foundation Policies with Hilbert Representations* (2024), equation 3.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

use super::goal::{AttentionPair, GoalTransformerConfig, Looks, TokenForm, ValueNetwork, placed};
use super::linear::{Linear, parameter};
use super::norm::LayerNorm;
use crate::pass::Pass;

/// The least squared distance: below it the root's gradient would grow without bound.
const LEAST: f32 = 1e-6;

/// V(s, g) = −‖φ(s) − φ(g)‖.
#[derive(Module, Debug)]
pub struct MetricValue {
    /// `[1, T × P, W]`.
    pos_embedding: Param<Tensor<3>>,
    /// `[1, P, W]`: unused, as goals take the first rows of the other; files of the reference have it.
    pos_embedding_goal: Param<Tensor<3>>,
    transformer: FrameTransformer,
    embed_proj: Linear,
}

/// Blocks that look at the frames up to their own, the last from one query per frame.
#[derive(Module, Debug)]
struct FrameTransformer {
    norm: LayerNorm,
    layers: Vec<AttentionPair>,
}

impl MetricValue {
    /// With embeddings of `embed_dim` values. How a frame becomes one vector is fixed: `config.pool` does not matter.
    pub fn new(config: &GoalTransformerConfig, form: &TokenForm, embed_dim: usize, device: &Device) -> Self {
        let block = |index| {
            let looks = if index + 1 == config.depth { Looks::PerFrame } else { Looks::AtFrames };
            AttentionPair::new(config, looks, form, device)
        };
        Self {
            pos_embedding: parameter([1, form.frames * form.patches, form.dim], device),
            pos_embedding_goal: parameter([1, form.patches, form.dim], device),
            transformer: FrameTransformer {
                norm: LayerNorm::new(form.dim, device),
                layers: (0..config.depth).map(block).collect(),
            },
            embed_proj: Linear::new(form.dim, embed_dim, device),
        }
    }

    /// φ: `[B, T, P, W]` → `[B, T, E]`.
    fn embed(&self, frames: Tensor<4>, pass: &mut Pass) -> Tensor<3> {
        let FrameTransformer { norm, layers } = &self.transformer;
        let tokens = placed(frames, &self.pos_embedding);
        let state = layers.iter().fold(tokens, |state, layer| layer.forward(state, None, pass));
        self.embed_proj.forward(norm.forward(state))
    }
}

impl ValueNetwork for MetricValue {
    fn value(&self, frames: Tensor<4>, goal: Tensor<4>, pass: &mut Pass) -> Tensor<3> {
        let difference = self.embed(frames, pass) - self.embed(goal, pass);
        -difference.square().sum_dim(2).clamp_min(LEAST).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;
    use crate::init::initialize;
    use crate::layers::Pool;
    use crate::params::host;

    #[test]
    fn values_are_a_metric() {
        let config = GoalTransformerConfig {
            depth: 3,
            heads: 2,
            head_dim: 4,
            hidden: 8,
            dropout: 0.0,
            pool: Pool::Attention,
            compare: false,
        };
        let device = Device::flex();
        let form = TokenForm { patches: 2, frames: 1, dim: 6 };
        let network = initialize(MetricValue::new(&config, &form, 5, &device), 4);
        let places: Vec<Tensor<4>> = (0..6)
            .map(|place| {
                let values = (0..12).map(|value| ((place * 12 + value) as f32).sin()).collect::<Vec<_>>();
                Tensor::from_data(TensorData::new(values, [1, 1, 2, 6]), &device)
            })
            .collect();
        let distance = |from: usize, to: usize| {
            let [from, to] = [from, to].map(|place| places[place].clone());
            -host(network.value(from, to, &mut Pass::evaluate()))[0]
        };
        for a in 0..6 {
            assert!((distance(a, a) - 1e-3).abs() < 1e-8);
            for b in (0..6).filter(|&b| b != a) {
                assert_eq!(distance(a, b), distance(b, a));
                assert!(distance(a, b) > 0.01, "{}", distance(a, b));
                for c in 0..6 {
                    assert!(distance(a, c) <= distance(a, b) + distance(b, c) + 1e-5);
                }
            }
        }
    }
}
