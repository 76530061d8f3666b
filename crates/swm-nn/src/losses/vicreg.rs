//! The variance and covariance terms of VICReg, over the batch and over time, as PLDM weighs them (arXiv 2502.14819).

use burn::tensor::Tensor;
use burn::tensor::activation::relu;

/// Under the square root of the variance.
const EPSILON: f32 = 1e-4;

/// The four terms.
pub struct Vicreg {
    /// How far stds over the batch fall short of 1.
    pub std: Tensor<1>,
    /// How far stds over time do.
    pub std_t: Tensor<1>,
    /// Mean square of the covariances of latent components over the batch.
    pub cov: Tensor<1>,
    /// And over time.
    pub cov_t: Tensor<1>,
}

/// Of embeddings `[B, T, W]`. All terms see them less their mean over the batch.
pub fn vicreg(states: Tensor<3>) -> Vicreg {
    let mean = states.clone().mean_dim(0);
    let centered = states - mean;
    let by_step = centered.clone().swap_dims(0, 1);
    Vicreg {
        std: shortfall(by_step.clone()),
        std_t: shortfall(centered.clone()),
        cov: covariance(by_step),
        cov_t: covariance(centered),
    }
}

/// Of G groups of N samples `[G, N, W]`: the mean of max(0, 1 - std).
fn shortfall(groups: Tensor<3>) -> Tensor<1> {
    let samples = groups.dims()[1] as f32;
    let mean = groups.clone().mean_dim(1);
    let variance = (groups - mean).square().sum_dim(1) / (samples - 1.0);
    relu((variance + EPSILON).sqrt() * -1.0 + 1.0).mean()
}

/// Of G groups of N samples `[G, N, W]`: squares of xᵀx / (N - 1) off the diagonal, their mean. The reference does
/// not center x a second time, so neither does this.
fn covariance(groups: Tensor<3>) -> Tensor<1> {
    let [count, samples, dim] = groups.dims();
    let products = groups.clone().swap_dims(1, 2).matmul(groups.clone()) / (samples as f32 - 1.0);
    let diagonal = groups.square().sum_dim(1) / (samples as f32 - 1.0);
    let off_diagonal = products.square().sum() - diagonal.square().sum();
    off_diagonal / (count * (dim * dim - dim)) as f32
}
