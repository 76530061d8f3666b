//! Temporal straightening: consecutive changes of an embedding shall point the same way (arXiv 2603.12231).

use burn::tensor::Tensor;

/// The least product of lengths that a cosine divides by, as PyTorch's.
const EPSILON: f32 = 1e-8;

/// Of embeddings `[B, T, W]` with T of 3 or more: the mean of minus the cosine between changes.
pub(crate) fn straightening(states: Tensor<3>) -> Tensor<1> {
    let steps = states.dims()[1];
    let changes = states.clone().narrow(1, 1, steps - 1) - states.narrow(1, 0, steps - 1);
    let (before, after) = (changes.clone().narrow(1, 0, steps - 2), changes.narrow(1, 1, steps - 2));
    let length = |change: &Tensor<3>| change.clone().square().sum_dim(2).sqrt().clamp_min(EPSILON);
    let lengths = length(&before) * length(&after);
    ((before * after).sum_dim(2) / lengths).mean() * -1.0
}
