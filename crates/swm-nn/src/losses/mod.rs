//! The terms of losses, on tensors. Each file is one term or a family, with its source; what they are worth to a model
//! stands in the model.

mod sigreg;
mod straightening;
mod vicreg;

use burn::tensor::Tensor;

pub use sigreg::SigregConfig;
pub use sigreg::sigreg;
pub use straightening::straightening;
pub use vicreg::{Vicreg, vicreg};

/// The mean of squared differences.
pub fn mean_squared_error<const D: usize>(a: Tensor<D>, b: Tensor<D>) -> Tensor<1> {
    (a - b).square().mean()
}

/// Squared differences to `targets` that weigh `share` where the target is higher and 1 - `share` where it is lower.
pub fn expectile<const D: usize>(values: Tensor<D>, targets: Tensor<D>, share: f64) -> Tensor<1> {
    let residual = targets - values;
    let is_lower = residual.clone().detach().lower_elem(0.0).float();
    let weight = (is_lower * -1.0 + share).abs();
    (weight * residual.square()).mean()
}

/// The terms of one loss.
pub struct Terms {
    /// What is minimized.
    pub total: Tensor<1>,
    /// Its parts and other metrics, as they are before they are weighed.
    pub parts: Vec<(&'static str, Tensor<1>)>,
}

impl Terms {
    /// Their values alone: what gradients needed of the network can go.
    pub fn inner(self) -> Self {
        let parts = self.parts.into_iter().map(|(name, part)| (name, part.inner()));
        Self { total: self.total.inner(), parts: parts.collect() }
    }

    /// Adds a part, weighed.
    pub fn add(&mut self, name: &'static str, weight: f64, part: Tensor<1>) {
        self.total = self.total.clone() + part.clone() * weight;
        self.parts.push((name, part));
    }
}
