//! What a policy does that knows how many decisions are left: an MLP of a frame, of what sets the goal apart from it, and of
//! that number.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

use super::linear::{Linear, parameter};
use super::norm::LayerNorm;
use crate::kernels::gelu;

/// Actions from the tokens of a frame s and a goal g, k decisions before it: with n the normalization of each token, or what is
/// seen as it is, the first layer is A n(s) + B (n(g) - n(s)) + e_k. Being linear, it is computed once per image, whatever pairs of images are made.
#[derive(Module, Debug)]
pub struct CountdownPredictor {
    token_norm: Option<LayerNorm>,
    frame: Linear,
    difference: Linear,
    /// `[K, H]`: e_1 to e_K.
    left: Param<Tensor<2>>,
    norm: LayerNorm,
    layers: Vec<Hidden>,
    out: Linear,
}

/// Linear and layer norm.
#[derive(Module, Debug)]
struct Hidden {
    linear: Linear,
    norm: LayerNorm,
}

/// Sizes.
#[derive(Clone, Copy, Debug)]
pub struct CountdownSizes {
    /// Values in all tokens of an image.
    pub inputs: usize,
    /// Whether each token is normalized.
    pub normalizes: bool,
    /// H: dim of hidden layers.
    pub hidden: usize,
    /// Hidden layers, at least 1.
    pub depth: usize,
    /// D: values of a decision.
    pub outputs: usize,
    /// K: decisions that are left, at most.
    pub horizon: usize,
}

/// The shares of images in the first layer, `[B, T, H]` each.
pub struct Looks {
    /// As a frame to act in: A n(s) - B n(s).
    pub from: Tensor<3>,
    /// As a goal: B n(g).
    pub to: Tensor<3>,
}

impl CountdownPredictor {
    /// Of these sizes.
    pub fn new(sizes: CountdownSizes, device: &Device) -> Self {
        let CountdownSizes { inputs, normalizes, hidden, depth, outputs, horizon } = sizes;
        let layer =
            |_| Hidden { linear: Linear::new(hidden, hidden, device), norm: LayerNorm::new(hidden, device) };
        Self {
            token_norm: normalizes.then(|| LayerNorm::plain(1e-5)),
            frame: Linear::new(inputs, hidden, device),
            difference: Linear::without_bias(inputs, hidden, device),
            left: parameter([horizon, hidden], device),
            norm: LayerNorm::new(hidden, device),
            layers: (1..depth).map(layer).collect(),
            out: Linear::new(hidden, outputs, device),
        }
    }

    /// K.
    pub fn horizon(&self) -> usize {
        self.left.dims()[0]
    }

    /// Tokens `[B, T, P, W]`.
    pub fn look(&self, tokens: Tensor<4>) -> Looks {
        let tokens = match &self.token_norm {
            Some(norm) => norm.forward(tokens),
            None => tokens,
        };
        let tokens: Tensor<3> = tokens.flatten(2, 3);
        let to = self.difference.forward(tokens.clone());
        Looks { from: self.frame.forward(tokens) - to.clone(), to }
    }

    /// The first layer of frames `from` with goals `to`, `[B, N, H]` each, `left` decisions before them, 1 to K.
    pub fn join(&self, from: Tensor<3>, to: Tensor<3>, left: usize) -> Tensor<3> {
        let row = left.clamp(1, self.horizon()) - 1;
        from + to + self.left.val().narrow(0, row, 1).unsqueeze_dim(0)
    }

    /// From the first layer, `[B, N, H]`, to actions `[B, N, D]`.
    pub fn decide(&self, first: Tensor<3>) -> Tensor<3> {
        let first = gelu(self.norm.forward(first));
        let next = |state, layer: &Hidden| gelu(layer.norm.forward(layer.linear.forward(state)));
        self.out.forward(self.layers.iter().fold(first, next))
    }
}
