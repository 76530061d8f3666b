//! In which precision products of matrices are computed: fp32, or bf16 with fp32 weights behind it.
//!
//! A working copy of a network holds the weights of its linear layers in bf16, cast from fp32, and the cast is
//! differentiable. Layers follow the precision of their weights. All else stays in fp32: layer norm, softmax, batch norm, losses,
//! gradients, the optimizer.

use std::fmt;
use std::str::FromStr;

use burn::module::Module;
use burn::tensor::FloatDType;
use serde::{Deserialize, Serialize};

use crate::error::BaselineError;
use swm_nn::params;

/// The precision of linear layers and attention.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Precision {
    /// 32-bit floats.
    #[default]
    Fp32,
    /// 16-bit floats with the exponents of 32-bit ones; weights, norms, losses and the optimizer stay in 32.
    Bf16,
}

impl Precision {
    /// Whether it is the default, which files need not name.
    pub fn is_fp32(&self) -> bool {
        *self == Self::Fp32
    }

    /// A copy of the network that computes in this precision; gradients go on to the network's own tensors.
    pub(crate) fn copy_of<M: Module>(self, network: &M) -> M {
        match self {
            Self::Fp32 => network.clone(),
            Self::Bf16 => params::map(network.clone(), |spec, tensor| {
                // What is multiplied by matrices: linear layers, and the patch embeddings of vision transformers.
                let is_product = spec.place.0 == "Linear" || (spec.place.0 == "Conv" && spec.is_in_vit);
                if is_product { tensor.cast(FloatDType::BF16) } else { tensor }
            }),
        }
    }
}

impl FromStr for Precision {
    type Err = BaselineError;

    /// From `fp32` or `bf16`.
    fn from_str(text: &str) -> Result<Self, BaselineError> {
        match text {
            "fp32" => Ok(Self::Fp32),
            "bf16" => Ok(Self::Bf16),
            _ => Err(BaselineError::Training {
                setting: "precision".to_owned(),
                reason: format!("`{text}`; use fp32 or bf16"),
            }),
        }
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.is_fp32() { "fp32" } else { "bf16" })
    }
}
