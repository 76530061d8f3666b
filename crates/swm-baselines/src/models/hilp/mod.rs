//! HILP: GCIVL whose value is minus a distance between learned embeddings, so that it is a metric by construction.
//!
//! Source: Park, Kreiman and Levine, *Foundation Policies with Hilbert Representations* (2024). As in the reference, the policy
//! is extracted from the value; the paper's policy over latent directions is not part of it.

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use swm_data::loader::GoalWeights;

use crate::data::DataDims;
use crate::error::BaselineError;
use crate::models::gcivl::{GcivlConfig, ValueConfig};
use crate::models::goal::{GoalConfig, ValueLearner};
use crate::network::{Network, Parts};
use swm_nn::MetricValue;
use swm_nn::optim::OptimConfig;

/// Its name.
pub(crate) const NAME: &str = "hilp";

/// Goals of the value: no current step, whose value is 0 by construction.
const GOALS: GoalWeights = GoalWeights { random: 0.375, geometric: 0.625, uniform: 0.0, current: 0.0 };

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct HilpConfig {
    /// The network. The value's transformer has the size of the policy's; it looks at frames alone, and its last block has one
    /// learned query per frame.
    pub model: GoalConfig,
    /// Dim of the embeddings whose distance is the value.
    pub embed_dim: usize,
    /// The optimizer of both phases.
    pub optim: OptimConfig,
    /// Settings of the value, and of the policy extracted from it.
    pub value: ValueConfig,
}

impl HilpConfig {
    /// The reference's settings.
    pub fn paper() -> Self {
        Self::of(GcivlConfig::paper())
    }

    /// Settings for a CPU, as GCIVL's.
    pub fn small() -> Self {
        Self::of(GcivlConfig::small())
    }

    fn of(GcivlConfig { model, optim, value }: GcivlConfig) -> Self {
        Self { model, embed_dim: 64, optim, value }
    }
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &HilpConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let HilpConfig { model, embed_dim, optim, value } = config;
    let tokens = model.tokens();
    let values = || MetricValue::new(&model.predictor, &tokens, *embed_dim, device);
    ValueLearner::make(NAME, (model, optim, value), GOALS, values, dims, device)
}
