//! Attention of few tokens: too small for products of matrices, so sums of products of rows, on views as they are.

use burn::backend::flex::FlexTensor;
use multiversion::multiversion;
use rayon::prelude::*;

use super::vector::{dot, softmax, softmax_back};
use super::{attention_scale, rows_of_task, tensor_of};

/// Queries, keys and values of all heads.
pub(super) struct SmallAttention {
    qkv: [Rows; 3],
    sizes: Sizes,
}

/// Sizes of a batch's part.
#[derive(Clone, Copy)]
struct Sizes {
    heads: usize,
    queries: usize,
    keys: usize,
    dim: usize,
    causal: bool,
}

impl SmallAttention {
    /// Of `[B, heads, N, E]` queries and `[B, heads, M, E]` keys and values.
    pub(super) fn new(qkv: [&FlexTensor; 3], causal: bool) -> Self {
        let qkv = qkv.map(Rows::of);
        let [_, heads, queries, dim] = qkv[0].shape();
        let [_, _, keys, _] = qkv[1].shape();
        Self { qkv, sizes: Sizes { heads, queries, keys, dim, causal } }
    }

    /// The weights, `[B, heads, N, M]`, and the outputs, `[B, heads, N, E]`, which lie in memory as `[B, N, heads, E]`.
    pub(super) fn forward(&self) -> (Vec<f32>, FlexTensor) {
        let Self { qkv, sizes } = self;
        let [batch, ..] = qkv[0].shape();
        let mut weights = vec![0.0; batch * sizes.weights()];
        let mut outputs = vec![0.0; batch * sizes.outputs()];
        let parts = weights.par_chunks_mut(sizes.weights()).zip(outputs.par_chunks_mut(sizes.outputs()));
        parts.enumerate().with_min_len(rows_of_task(sizes.outputs())).for_each(
            |(index, (weights, outputs))| {
                forward(qkv.each_ref().map(|rows| rows.view(index)), *sizes, weights, outputs);
            },
        );
        (weights, sizes.joined(outputs, batch, sizes.queries))
    }

    /// The gradients of queries, keys and values where that of the outputs is `given`.
    pub(super) fn backward(&self, weights: &[f32], given: &FlexTensor) -> [FlexTensor; 3] {
        let Self { qkv, sizes } = self;
        let [batch, ..] = qkv[0].shape();
        let given = Rows::of(given);
        let of_keys = sizes.keys * sizes.heads * sizes.dim;
        let mut found = [sizes.outputs(), of_keys, of_keys].map(|size| vec![0.0; batch * size]);
        let [q, k, v] = &mut found;
        let parts =
            q.par_chunks_mut(sizes.outputs()).zip(k.par_chunks_mut(of_keys)).zip(v.par_chunks_mut(of_keys));
        let parts = parts.zip(weights.par_chunks(sizes.weights())).enumerate();
        parts.with_min_len(rows_of_task(sizes.outputs())).for_each(|(index, (((q, k), v), weights))| {
            let views = qkv.each_ref().map(|rows| rows.view(index));
            backward(views, given.view(index), *sizes, weights, [q, k, v]);
        });
        let [q, k, v] = found;
        let [k, v] = [k, v].map(|values| sizes.joined(values, batch, sizes.keys));
        [sizes.joined(q, batch, sizes.queries), k, v]
    }
}

impl Sizes {
    fn weights(self) -> usize {
        self.heads * self.queries * self.keys
    }

    fn outputs(self) -> usize {
        self.queries * self.heads * self.dim
    }

    /// Where a token's head begins in `[N, heads, E]`.
    fn at(self, head: usize, token: usize) -> usize {
        (token * self.heads + head) * self.dim
    }

    fn joined(self, values: Vec<f32>, batch: usize, tokens: usize) -> FlexTensor {
        tensor_of(values, [batch, tokens, self.heads, self.dim]).transpose(1, 2)
    }
}

/// `[B, heads, N, E]` in which the values of a row stand beside each other.
struct Rows(FlexTensor);

/// A part of a batch: `[heads, N, E]`.
#[derive(Clone, Copy)]
struct View<'a> {
    values: &'a [f32],
    start: usize,
    head: usize,
    token: usize,
    dim: usize,
}

impl Rows {
    fn of(tensor: &FlexTensor) -> Self {
        let strides = tensor.layout().strides();
        let is_fit = strides[3] == 1 && strides.iter().all(|stride| *stride >= 0);
        Self(if is_fit { tensor.clone() } else { tensor.to_contiguous() })
    }

    fn shape(&self) -> [usize; 4] {
        self.0.layout().shape().dims()
    }

    fn view(&self, index: usize) -> View<'_> {
        let layout = self.0.layout();
        let [batch, head, token] = [0, 1, 2].map(|axis| layout.strides()[axis] as usize);
        let start = layout.start_offset() + index * batch;
        View { values: self.0.storage(), start, head, token, dim: self.shape()[3] }
    }
}

impl<'a> View<'a> {
    #[inline(always)]
    fn row(self, head: usize, token: usize) -> &'a [f32] {
        let start = self.start + head * self.head + token * self.token;
        &self.values[start..start + self.dim]
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn forward([q, k, v]: [View<'_>; 3], sizes: Sizes, weights: &mut [f32], outputs: &mut [f32]) {
    let Sizes { queries, keys, dim, causal, .. } = sizes;
    for (head, weights) in weights.chunks_exact_mut(queries * keys).enumerate() {
        for (query, weights) in weights.chunks_exact_mut(keys).enumerate() {
            for (key, weight) in weights.iter_mut().enumerate() {
                *weight = dot(q.row(head, query), k.row(head, key));
            }
        }
        softmax(weights, keys, attention_scale(dim), causal);
        for (query, weights) in weights.chunks_exact(keys).enumerate() {
            let start = sizes.at(head, query);
            let output = &mut outputs[start..start + dim];
            for (key, weight) in weights.iter().enumerate() {
                add_scaled(output, v.row(head, key), *weight);
            }
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn backward(
    [q, k, v]: [View<'_>; 3],
    given: View<'_>,
    sizes: Sizes,
    weights: &[f32],
    [of_q, of_k, of_v]: [&mut [f32]; 3],
) {
    let Sizes { queries, keys, dim, .. } = sizes;
    let mut scores = vec![0.0; queries * keys];
    for (head, weights) in weights.chunks_exact(queries * keys).enumerate() {
        for (query, scores) in scores.chunks_exact_mut(keys).enumerate() {
            for (key, score) in scores.iter_mut().enumerate() {
                *score = dot(given.row(head, query), v.row(head, key));
            }
        }
        softmax_back(&mut scores, weights, keys, attention_scale(dim));
        for query in 0..queries {
            for key in 0..keys {
                let (score, weight) = (scores[query * keys + key], weights[query * keys + key]);
                let (at_query, at_key) = (sizes.at(head, query), sizes.at(head, key));
                add_scaled(&mut of_q[at_query..at_query + dim], k.row(head, key), score);
                add_scaled(&mut of_k[at_key..at_key + dim], q.row(head, query), score);
                add_scaled(&mut of_v[at_key..at_key + dim], given.row(head, query), weight);
            }
        }
    }
}

#[inline(always)]
fn add_scaled(sums: &mut [f32], values: &[f32], factor: f32) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value * factor;
    }
}
