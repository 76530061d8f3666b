//! Attention and the network between two of them, as the reference's predictors have them: each normalizes its own
//! input.

use burn::module::Module;
use burn::tensor::activation::softmax;
use burn::tensor::module;
use burn::tensor::ops::AttentionModuleOptions;
use burn::tensor::{Bool, DType, Device, FloatDType, Tensor};

use super::linear::Linear;
use super::norm::LayerNorm;
use crate::kernels::attention;
use crate::pass::Pass;

/// Which keys a query may look at.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one at a time")]
pub(crate) enum Attend {
    /// All.
    All,
    /// Those up to its own.
    Causal,
    /// Those that are false here: `[1, 1, queries, keys]`.
    Unless(Tensor<4, Bool>),
}

/// softmax(q kᵀ / √E) v for all heads: `[B, heads, N, E]`, in their precision; softmax in fp32. `dropout` falls on the
/// weights, in training.
pub(crate) fn attend([q, k, v]: [Tensor<4>; 3], who: &Attend, dropout: f64, pass: &mut Pass) -> Tensor<4> {
    let is_plain = dropout == 0.0 || !pass.is_training();
    if is_plain && q.dtype() == DType::F32 {
        return match who {
            Attend::All => attention([q, k, v], false),
            Attend::Causal => attention([q, k, v], true),
            Attend::Unless(mask) => {
                let ([batch, heads, queries, _], keys) = (q.dims(), k.dims()[2]);
                let mask = mask.clone().expand([batch, heads, queries, keys]);
                module::attention(q, k, v, Some(mask), None, AttentionModuleOptions::default())
            }
        };
    }
    let dim = q.dims()[3] as f64;
    let scores = q.matmul(k.swap_dims(2, 3)).cast(FloatDType::F32) * (1.0 / dim.sqrt());
    let [_, _, queries, keys] = scores.dims();
    let scores = match who {
        Attend::All => scores,
        Attend::Causal => {
            let mask = Tensor::<2, Bool>::tril_mask([queries, keys], 0, &scores.device().inner());
            scores.mask_fill(mask.unsqueeze(), f32::NEG_INFINITY)
        }
        Attend::Unless(mask) => scores.mask_fill(mask.clone(), f32::NEG_INFINITY),
    };
    pass.dropout(softmax(scores, 3), dropout).cast(v.dtype()).matmul(v)
}

/// `[B, N, heads × E]` → `[B, heads, N, E]`.
pub(crate) fn split(input: Tensor<3>, heads: usize) -> Tensor<4> {
    let [batch, count, dim] = input.dims();
    input.reshape([batch, count, heads, dim / heads]).swap_dims(1, 2)
}

/// `[B, heads, N, E]` → `[B, N, heads × E]`.
pub(crate) fn join(input: Tensor<4>) -> Tensor<3> {
    let [batch, heads, count, dim] = input.dims();
    input.swap_dims(1, 2).reshape([batch, count, heads * dim])
}

/// Multi-head self-attention of the world models' predictors.
#[derive(Module, Debug)]
pub(crate) struct Attention {
    norm: LayerNorm,
    to_qkv: Linear,
    to_out: Option<Linear>,
    #[module(skip)]
    heads: usize,
    #[module(skip)]
    dropout: f64,
}

impl Attention {
    /// `heads` heads of `head_dim` values.
    pub(crate) fn new(dim: usize, heads: usize, head_dim: usize, dropout: f64, device: &Device) -> Self {
        let inner = heads * head_dim;
        let projects = !(heads == 1 && head_dim == dim);
        Self {
            norm: LayerNorm::new(dim, device),
            to_qkv: Linear::without_bias(dim, 3 * inner, device),
            to_out: projects.then(|| Linear::new(inner, dim, device)),
            heads,
            dropout,
        }
    }

    /// `[B, N, W]` → `[B, N, W]`.
    pub(crate) fn forward(&self, input: Tensor<3>, who: &Attend, pass: &mut Pass) -> Tensor<3> {
        let qkv = self.queries_keys_values(input);
        self.project(attend(qkv, who, self.dropout, pass), pass)
    }

    /// Causal attention of N tokens that follow those whose keys and values are `seen`, which theirs join:
    /// `[B, N, W]` → `[B, N, W]`, or `[B, 1, W]` if only the last is asked for. N is 1 where any were seen before.
    pub(crate) fn extend(
        &self,
        input: Tensor<3>,
        seen: &mut Option<KeysValues>,
        only_last: bool,
        pass: &mut Pass,
    ) -> Tensor<3> {
        let [q, k, v] = self.queries_keys_values(input);
        let [k, v] = match seen.take() {
            Some([keys, values]) => [Tensor::cat(vec![keys, k], 2), Tensor::cat(vec![values, v], 2)],
            None => [k, v],
        };
        *seen = Some([k.clone(), v.clone()]);
        let count = q.dims()[2];
        let q = if only_last { q.narrow(2, count - 1, 1) } else { q };
        let who = if q.dims()[2] == 1 { Attend::All } else { Attend::Causal };
        self.project(attend([q, k, v], &who, self.dropout, pass), pass)
    }

    fn queries_keys_values(&self, input: Tensor<3>) -> [Tensor<4>; 3] {
        // As parts of all heads: to split a part into heads would copy it.
        let all = split(self.to_qkv.forward_narrow(self.norm.forward(input)), 3 * self.heads);
        [0, 1, 2].map(|part| all.clone().narrow(1, part * self.heads, self.heads))
    }

    fn project(&self, heads: Tensor<4>, pass: &mut Pass) -> Tensor<3> {
        let output = join(heads);
        match &self.to_out {
            Some(to_out) => pass.dropout(to_out.forward(output), self.dropout),
            None => output.cast(FloatDType::F32),
        }
    }
}

/// Keys and values of tokens: `[B, heads, N, E]` each.
pub(crate) type KeysValues = [Tensor<4>; 2];

/// Two linear layers with a GELU between them.
#[derive(Module, Debug)]
pub(crate) struct FeedForward {
    norm: LayerNorm,
    up: Linear,
    down: Linear,
    #[module(skip)]
    dropout: f64,
}

impl FeedForward {
    /// From and to `dim` by way of `hidden`.
    pub(crate) fn new(dim: usize, hidden: usize, dropout: f64, device: &Device) -> Self {
        Self {
            norm: LayerNorm::new(dim, device),
            up: Linear::new(dim, hidden, device),
            down: Linear::new(hidden, dim, device),
            dropout,
        }
    }

    /// `[B, N, W]` → `[B, N, W]`.
    pub(crate) fn forward(&self, input: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let hidden = self.up.forward_gelu(self.norm.forward(input));
        let output = self.down.forward(pass.dropout(hidden, self.dropout));
        pass.dropout(output, self.dropout)
    }
}
