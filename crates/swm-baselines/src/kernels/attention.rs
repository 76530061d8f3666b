//! Attention of many tokens: softmax(q kᵀ / √E) v, head by head, so that the weights of a head stay in the cache of a core.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::{FlexTensor, Layout};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::ops::AttentionModuleOptions;
use burn::tensor::{DType, Shape, Tensor, module};
use rayon::prelude::*;

use super::{is_ours, owned, tensor_of, values_mut, values_of, vector};

/// The least number of weights of a head for which a head is worth a task; with fewer, burn's attention is faster.
const LEAST: usize = 1 << 10;

/// softmax(q kᵀ / √E) v: `[B, heads, N, E]` queries, `[B, heads, M, E]` keys and values → `[B, heads, N, E]`. With `causal`, the last
/// query sees all keys, and each one key more than the query before it. Queries of no key get zeros.
pub(crate) fn attention([q, k, v]: [Tensor<4>; 3], causal: bool) -> Tensor<4> {
    let is_large = q.dims()[2] * k.dims()[2] >= LEAST;
    if !(is_large && [&q, &k, &v].into_iter().all(is_ours)) {
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
        let heads = Heads::of(&q);
        let outputs = heads.each(|head| heads.forward(head, [&q, &k, &v], causal).1);
        heads.joined(outputs.iter())
    }
}

/// The gradient.
#[derive(Debug)]
struct Attended;

/// What it needs.
#[derive(Clone, Debug)]
struct Seen {
    qkv: [FlexTensor; 3],
    /// Of each head: `[N, M]`.
    weights: Vec<FlexTensor>,
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
            OpsKind::Tracked(ops) => {
                let heads = Heads::of(&q);
                let (weights, outputs): (Vec<_>, Vec<_>) =
                    heads.each(|head| heads.forward(head, [&q, &k, &v], causal)).into_iter().unzip();
                ops.finish(Seen { qkv: [q, k, v], weights }, heads.joined(outputs.iter()))
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::attend(q, k, v, causal)),
        }
    }
}

impl Backward<Flex, 3> for Attended {
    type State = Seen;

    fn backward(self, ops: Ops<Seen, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let given = gradients.consume::<Flex>(&ops.node);
        let Seen { qkv: [q, k, v], weights } = ops.state;
        let heads = Heads::of(&q);
        let found = heads.each(|head| heads.backward(head, [&q, &k, &v], &weights[head], &given));
        let of_keys = Heads::of(&k);
        let joined = [
            heads.joined(found.iter().map(|[q, _, _]| q)),
            of_keys.joined(found.iter().map(|[_, k, _]| k)),
            of_keys.joined(found.iter().map(|[_, _, v]| v)),
        ];
        for (parent, gradient) in ops.parents.into_iter().zip(joined) {
            if let Some(parent) = parent {
                gradients.register::<Flex>(parent.id, gradient);
            }
        }
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

    fn scale(self) -> f32 {
        (1.0 / (self.dim as f64).sqrt()) as f32
    }

    /// The weights of a head, `[N, M]`, and its outputs, `[N, E]`.
    fn forward(self, head: usize, qkv: [&FlexTensor; 3], causal: bool) -> (FlexTensor, FlexTensor) {
        let [q, k, v] = qkv.map(|tensor| self.one(tensor, head));
        let mut weights = owned(Flex::float_matmul(q, k.transpose(0, 1)));
        let [_, keys] = weights.layout().shape().dims();
        vector::softmax(values_mut(&mut weights), keys, self.scale(), causal);
        let outputs = Flex::float_matmul(weights.clone(), v);
        (weights, outputs)
    }

    /// The gradients of a head's queries, keys and values.
    fn backward(
        self,
        head: usize,
        qkv: [&FlexTensor; 3],
        weights: &FlexTensor,
        given: &FlexTensor,
    ) -> [FlexTensor; 3] {
        let [q, k, v] = qkv.map(|tensor| self.one(tensor, head));
        let given = self.one(given, head);
        let of_v = Flex::float_matmul(weights.transpose(0, 1), given.clone());
        let mut scores = owned(Flex::float_matmul(given, v.transpose(0, 1)));
        let [_, keys] = scores.layout().shape().dims();
        vector::softmax_back(values_mut(&mut scores), values_of(weights), keys, self.scale());
        let of_k = Flex::float_matmul(scores.transpose(0, 1), q);
        [Flex::float_matmul(scores, k), of_k, of_v]
    }

    /// One head of a tensor, without a copy: `[N, E]`.
    fn one(self, tensor: &FlexTensor, head: usize) -> FlexTensor {
        let [_, _, tokens, dim] = tensor.layout().shape().dims();
        let strides = tensor.layout().strides();
        let offset = (head / self.heads) as isize * strides[0] + (head % self.heads) as isize * strides[1];
        let start = tensor.layout().start_offset() as isize + offset;
        let layout = Layout::new(Shape::new([tokens, dim]), strides[2..].to_vec(), start as usize);
        FlexTensor::from_arc(tensor.data_arc(), layout, DType::F32)
    }

    /// `[B, heads, N, E]` of its heads. In memory the heads of a token stand beside each other: to join them costs nothing.
    fn joined<'a>(self, heads: impl Iterator<Item = &'a FlexTensor>) -> FlexTensor {
        let Self { batch, heads: count, tokens, dim } = self;
        let mut values = vec![0.0; batch * count * tokens * dim];
        for (index, head) in heads.enumerate() {
            let image = &mut values[index / count * count * tokens * dim..];
            let places = image[index % count * dim..].chunks_mut(count * dim);
            for (place, token) in places.zip(values_of(head).chunks_exact(dim)) {
                place[..dim].copy_from_slice(token);
            }
        }
        tensor_of(values, [batch, tokens, count, dim]).transpose(1, 2)
    }
}
