//! Activations that are part of a convolution, and Mish of any tensor.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use rayon::prelude::*;

use crate::kernels::relu_back;

/// Beyond this, mish(x) is x in 32-bit floats, and exp(2x) would leave their range at last.
const LINEAR: f32 = 20.0;

/// What follows a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Activation {
    /// Negative values become 0.
    Relu,
    /// See [`mish`].
    Mish,
}

impl Activation {
    /// Of a tensor.
    pub(super) fn of<const D: usize>(self, x: Tensor<D>) -> Tensor<D> {
        match self {
            Self::Relu => relu(x),
            Self::Mish => mish(x),
        }
    }

    /// Of a value.
    pub(super) fn of_value(self, x: f32) -> f32 {
        match self {
            Self::Relu => x.max(0.0),
            Self::Mish => {
                let exp = x.min(LINEAR).exp();
                let n = exp * (exp + 2.0);
                x * n / (n + 2.0)
            }
        }
    }

    /// Of values.
    pub(super) fn of_all(self, values: &[f32]) -> Vec<f32> {
        values.par_iter().map(|value| self.of_value(*value)).collect()
    }

    /// The gradients at values where those of the activation are `given`.
    pub(super) fn pass_all_back(self, values: &[f32], given: &[f32]) -> Vec<f32> {
        match self {
            Self::Relu => {
                let mut passed = vec![0.0; given.len()];
                relu_back(values, given, &mut passed);
                passed
            }
            Self::Mish => values.iter().zip(given).map(|(x, given)| self.pass_back(*x, *given)).collect(),
        }
    }

    /// The gradient at `x` where that of the activation is `given`. Of ReLU, `x` may also be its value.
    fn pass_back(self, x: f32, given: f32) -> f32 {
        match self {
            Self::Relu if x > 0.0 => given,
            Self::Relu => 0.0,
            // With n = e (e + 2) of e = exp x: x n / (n + 2), and n' = 2 e (e + 1).
            Self::Mish if x > LINEAR => given,
            Self::Mish => {
                let exp = x.exp();
                let n = exp * (exp + 2.0);
                let more = n + 2.0;
                given * (n + 4.0 * x * exp * (exp + 1.0) / more) / more
            }
        }
    }
}

/// Mish (Misra 2019, arXiv 1908.08681): x tanh(ln(1 + eˣ)) = x n / (n + 2) with n = eˣ (eˣ + 2), which needs one exponential.
pub fn mish<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let exp = x.clone().clamp_max(LINEAR).exp();
    let n = exp.clone() * (exp + 2.0);
    x * n.clone() / (n + 2.0)
}
