//! Attention: softmax(q kᵀ / √E) v. Of many tokens it is computed head by head, so that the weights of a head stay in the cache of a
//! core; of few tokens by [`small_attention`](super::small_attention).

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::{FlexTensor, Layout};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::ops::AttentionModuleOptions;
use burn::tensor::{DType, Shape, Tensor, module};
use rayon::prelude::*;

use super::product::{Matrix, as_matrix, product};
use super::small_attention::SmallAttention;
use super::{attention_scale, is_ours, tensor_of, vector};

/// The most weights of a head that [`SmallAttention`] is for.
const FEW: usize = 64;

/// softmax(q kᵀ / √E) v: `[B, heads, N, E]` queries, `[B, heads, M, E]` keys and values → `[B, heads, N, E]`. With `causal`, the last
/// query sees all keys, and each one key more than the query before it. Queries of no key get zeros.
pub(crate) fn attention([q, k, v]: [Tensor<4>; 3], causal: bool) -> Tensor<4> {
    let sizes = [q.dims(), k.dims(), v.dims()];
    // Values are of the dim of keys everywhere here.
    let is_plain = sizes[1] == sizes[2] && sizes.iter().all(|sizes| !sizes.contains(&0));
    if !(is_plain && [&q, &k, &v].into_iter().all(is_ours)) {
        let options = AttentionModuleOptions { scale: None, softcap: None, is_causal: causal };
        return module::attention(q, k, v, None, None, options);
    }
    let [q, k, v] = [q, k, v].map(Tensor::into_dispatch);
    Tensor::from_dispatch(<Dispatch as Attend>::attend(q, k, v, causal))
}

#[backend_extension(Flex, Autodiff)]
trait Attend: Backend {
    fn attend(
        q: FloatTensor<Self>,
        k: FloatTensor<Self>,
        v: FloatTensor<Self>,
        causal: bool,
    ) -> FloatTensor<Self>;
}

impl Attend for Flex {
    fn attend(q: FlexTensor, k: FlexTensor, v: FlexTensor, causal: bool) -> FlexTensor {
        if is_small(&q, &k) {
            return SmallAttention::new([&q, &k, &v], causal).forward().1;
        }
        let heads = Heads::of(&q);
        let outputs = heads.each(|head| heads.forward(head, [&q, &k, &v], causal).1);
        heads.joined(outputs.iter())
    }
}

/// Whether heads have few weights.
fn is_small(q: &FlexTensor, k: &FlexTensor) -> bool {
    let [[_, _, queries, _], [_, _, keys, _]] = [q, k].map(|tensor| tensor.layout().shape().dims());
    queries * keys <= FEW
}

/// The gradient.
#[derive(Debug)]
struct Attended;

/// What it needs.
#[derive(Clone, Debug)]
struct Seen {
    qkv: [FlexTensor; 3],
    weights: Weights,
    causal: bool,
}

#[derive(Clone, Debug)]
enum Weights {
    /// Of few tokens: `[B, heads, N, M]`.
    Together(Vec<f32>),
    /// Of each head: `[N, M]`.
    Apart(Vec<Vec<f32>>),
}

impl<C: CheckpointStrategy> Attend for Autodiff<Flex, C> {
    fn attend(
        q: FloatTensor<Self>,
        k: FloatTensor<Self>,
        v: FloatTensor<Self>,
        causal: bool,
    ) -> FloatTensor<Self> {
        let ((q, of_q), (k, of_k), (v, of_v)) = (q.into_parts(), k.into_parts(), v.into_parts());
        match Attended.prepare::<C>([of_q, of_k, of_v]).compute_bound().stateful() {
            OpsKind::Tracked(ops) if is_small(&q, &k) => {
                let (weights, outputs) = SmallAttention::new([&q, &k, &v], causal).forward();
                ops.finish(Seen { qkv: [q, k, v], weights: Weights::Together(weights), causal }, outputs)
            }
            OpsKind::Tracked(ops) => {
                let heads = Heads::of(&q);
                let (weights, outputs): (Vec<_>, Vec<_>) =
                    heads.each(|head| heads.forward(head, [&q, &k, &v], causal)).into_iter().unzip();
                let weights = Weights::Apart(weights);
                ops.finish(Seen { qkv: [q, k, v], weights, causal }, heads.joined(outputs.iter()))
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::attend(q, k, v, causal)),
        }
    }
}

impl Backward<Flex, 3> for Attended {
    type State = Seen;

    fn backward(self, ops: Ops<Seen, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let given = gradients.consume::<Flex>(&ops.node);
        let found = ops.state.gradients(&given);
        for (parent, gradient) in ops.parents.into_iter().zip(found) {
            if let Some(parent) = parent {
                gradients.register::<Flex>(parent.id, gradient);
            }
        }
    }
}

impl Seen {
    /// Those of queries, keys and values where that of the outputs is `given`.
    fn gradients(&self, given: &FlexTensor) -> [FlexTensor; 3] {
        let Self { qkv: [q, k, v], weights, causal } = self;
        let weights = match weights {
            Weights::Together(weights) => {
                return SmallAttention::new([q, k, v], *causal).backward(weights, given);
            }
            Weights::Apart(weights) => weights,
        };
        let (heads, of_keys) = (Heads::of(q), Heads::of(k));
        let found = heads.each(|head| heads.backward(head, [q, k, v], &weights[head], given));
        [
            heads.joined(found.iter().map(|[q, _, _]| q)),
            of_keys.joined(found.iter().map(|[_, k, _]| k)),
            of_keys.joined(found.iter().map(|[_, _, v]| v)),
        ]
    }
}

/// Sizes of a tensor of heads, `[B, heads, N, E]`.
#[derive(Clone, Copy)]
struct Heads {
    batch: usize,
    heads: usize,
    tokens: usize,
    dim: usize,
}

impl Heads {
    fn of(tensor: &FlexTensor) -> Self {
        let [batch, heads, tokens, dim] = tensor.layout().shape().dims();
        Self { batch, heads, tokens, dim }
    }

    /// What `work` makes of each head, in order.
    fn each<T: Send>(self, work: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        (0..self.batch * self.heads).into_par_iter().map(work).collect()
    }

    /// The weights of a head, `[N, M]`, and its outputs, `[N, E]`.
    fn forward(self, head: usize, qkv: [&FlexTensor; 3], causal: bool) -> (Vec<f32>, Vec<f32>) {
        let qkv = qkv.map(|tensor| self.one(tensor, head));
        let [q, k, v] = qkv.each_ref().map(Matrix::of);
        let mut weights = product(q, k.transposed());
        let keys = weights.len() / self.tokens;
        vector::softmax(&mut weights, keys, attention_scale(self.dim), causal);
        let outputs = product(Matrix::new(&weights, keys), v);
        (weights, outputs)
    }

    /// The gradients of a head's queries, keys and values.
    fn backward(
        self,
        head: usize,
        qkv: [&FlexTensor; 3],
        weights: &[f32],
        given: &FlexTensor,
    ) -> [Vec<f32>; 3] {
        let (qkv, given) = (qkv.map(|tensor| self.one(tensor, head)), self.one(given, head));
        let ([q, k, v], given) = (qkv.each_ref().map(Matrix::of), Matrix::of(&given));
        let keys = weights.len() / self.tokens;
        let of_v = product(Matrix::new(weights, keys).transposed(), given);
        let mut scores = product(given, v.transposed());
        vector::softmax_back(&mut scores, weights, keys, attention_scale(self.dim));
        let scores = Matrix::new(&scores, keys);
        [product(scores, k), product(scores.transposed(), q), of_v]
    }

    /// One head of a tensor, without a copy unless its rows are in pieces: `[N, E]`.
    fn one(self, tensor: &FlexTensor, head: usize) -> FlexTensor {
        let [_, _, tokens, dim] = tensor.layout().shape().dims();
        let strides = tensor.layout().strides();
        let offset = (head / self.heads) as isize * strides[0] + (head % self.heads) as isize * strides[1];
        let start = tensor.layout().start_offset() as isize + offset;
        let layout = Layout::new(Shape::new([tokens, dim]), strides[2..].to_vec(), start as usize);
        as_matrix(FlexTensor::from_arc(tensor.data_arc(), layout, DType::F32))
    }

    /// `[B, heads, N, E]` of its heads. In memory the heads of a token stand beside each other: to join them costs nothing.
    fn joined<'a>(self, heads: impl Iterator<Item = &'a Vec<f32>>) -> FlexTensor {
        let Self { batch, heads: count, tokens, dim } = self;
        let mut values = vec![0.0; batch * count * tokens * dim];
        for (index, head) in heads.enumerate() {
            let image = &mut values[index / count * count * tokens * dim..];
            let places = image[index % count * dim..].chunks_mut(count * dim);
            for (place, token) in places.zip(head.chunks_exact(dim)) {
                place[..dim].copy_from_slice(token);
            }
        }
        tensor_of(values, [batch, tokens, count, dim]).transpose(1, 2)
    }
}
