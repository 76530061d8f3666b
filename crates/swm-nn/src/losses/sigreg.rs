//! SIGReg: how far a batch of embeddings is from a standard normal distribution, seen along random directions.
//!
//! The statistic of Epps and Pulley compares the characteristic function of each projection with that of N(0, 1), under
//! a Gaussian window, on knots over [0, 3] by the trapezoid rule. Source: arXiv 2511.08544.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::kernels::epps_pulley;
use crate::pass::Pass;

/// How it is computed, and what it is worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SigregConfig {
    /// Its weight in the loss. The statistic is proportional to the clips of a batch: a batch half as large asks for twice the
    /// weight.
    pub weight: f64,
    /// Points at which characteristic functions are compared, at least 2.
    pub knots: usize,
    /// Directions, sampled anew in every step.
    pub projections: usize,
}

impl Default for SigregConfig {
    fn default() -> Self {
        Self { weight: 0.09, knots: 17, projections: 1024 }
    }
}

impl SigregConfig {
    /// What is wrong with it, if anything is.
    ///
    /// # Errors
    ///
    /// What is wrong, which the caller adds the model to.
    pub fn check(&self) -> Result<(), String> {
        let Self { weight, knots, projections } = *self;
        match (weight.is_finite(), knots, projections) {
            (true, 2.., 1..) => Ok(()),
            _ => Err(format!(
                "`sigreg` with weight {weight}, {knots} knots and {projections} projections; it needs a finite weight, \
                 at least 2 knots and 1 projection"
            )),
        }
    }
}

/// Of embeddings `[B, T, W]`: the mean over steps and directions.
pub fn sigreg(states: Tensor<3>, config: &SigregConfig, pass: &mut Pass) -> Tensor<1> {
    let dim = states.dims()[2];
    let directions = pass.normal([dim, config.projections], &states.device());
    sigreg_along(states, directions, config.knots)
}

/// Along these directions: `[W, P]`, scaled to length 1 here.
fn sigreg_along(states: Tensor<3>, directions: Tensor<2>, knots: usize) -> Tensor<1> {
    let lengths = directions.clone().square().sum_dim(0).sqrt();
    let directions = directions / lengths;
    epps_pulley(states.matmul(directions.unsqueeze()), knots)
}

/// Directions for tests: the first axes.
#[cfg(test)]
fn axes(dim: usize, device: &burn::tensor::Device) -> Tensor<2> {
    let values = (0..dim * dim).map(|i| if i / dim == i % dim { 1.0 } else { 0.0 }).collect();
    Tensor::from_data(burn::tensor::TensorData::new::<f32, _>(values, [dim, dim]), device)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::params::host;

    #[test]
    fn a_normal_batch_scores_lower_than_a_collapsed_one() {
        let device = Device::flex();
        let normal: Tensor<3> = Pass::train(3, 0).normal([256, 2, 8], &device);
        let score = |states: Tensor<3>| host(sigreg_along(states, axes(8, &device), 17))[0];
        let (good, collapsed) = (score(normal.clone()), score(normal * 0.0));
        assert!(good < 2.0, "{good}");
        assert!(collapsed > 50.0, "{collapsed}");
    }
}
