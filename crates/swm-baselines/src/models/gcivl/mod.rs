//! GCIVL: goal-conditioned implicit value learning. First a value, by expectile regression on a target
//! network's value of the next observation; then a policy, by advantage-weighted regression.

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use swm_data::loader::GoalWeights;

use crate::data::DataDims;
use crate::error::BaselineError;
use crate::models::goal::{GoalConfig, ValueLearner};
use crate::network::{Network, Parts};
use swm_nn::GoalPredictor;
use swm_nn::optim::{OptimConfig, Schedule};

/// Its name.
pub(crate) const NAME: &str = "gcivl";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct GcivlConfig {
    /// The network. The value takes the mean of a frame's tokens; the policy what is set here.
    pub model: GoalConfig,
    /// The optimizer of both phases.
    pub optim: OptimConfig,
    /// Settings of the value, and of the policy extracted from it.
    pub value: ValueConfig,
}

/// Settings of goal-conditioned values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct ValueConfig {
    /// Discount per step.
    pub discount: f64,
    /// The expectile of the regression.
    pub expectile: f64,
    /// EMA decay of the target network, per step.
    pub momentum: f64,
    /// Inverse temperature of the advantage weights.
    pub alpha: f64,
    /// Goals of the policy that is extracted.
    pub policy_goals: PolicyGoals,
}

/// Goals of a policy that is extracted from a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum PolicyGoals {
    /// The reference's: any step of any episode, and later steps of the episode, half of each.
    #[default]
    Mixed,
    /// Later steps of the episode, as near as `model.goal_gamma` says.
    Geometric,
}

impl PolicyGoals {
    /// The weights of the kinds of goals.
    pub(crate) fn weights(self) -> GoalWeights {
        let none = GoalWeights { random: 0.0, geometric: 0.0, uniform: 0.0, current: 0.0 };
        match self {
            Self::Mixed => GoalWeights { random: 0.5, uniform: 0.5, ..none },
            Self::Geometric => GoalWeights { geometric: 1.0, ..none },
        }
    }
}

impl ValueConfig {
    /// What is wrong with it, if anything is.
    pub(crate) fn check(&self) -> Result<(), String> {
        let Self { discount, expectile, momentum, alpha, .. } = *self;
        let shares = [("discount", discount), ("expectile", expectile), ("momentum", momentum)];
        if let Some((name, value)) = shares.iter().find(|(_, value)| !(0.0..=1.0).contains(value)) {
            return Err(format!("`value.{name}` is {value}; it must be in [0, 1]"));
        }
        match alpha.is_finite() {
            true => Ok(()),
            false => Err(format!("`value.alpha` is {alpha}; it must be finite")),
        }
    }
}

impl Default for ValueConfig {
    /// The reference's for GCIVL.
    fn default() -> Self {
        let policy_goals = PolicyGoals::default();
        Self { discount: 0.99, expectile: 0.9, momentum: 0.995, alpha: 3.0, policy_goals }
    }
}

/// The optimizer that the reference's value learners share.
pub(crate) fn value_optim() -> OptimConfig {
    OptimConfig { lr: 3e-4, weight_decay: 0.01, schedule: Schedule::COSINE, ..OptimConfig::default() }
}

impl GcivlConfig {
    /// The reference's settings.
    pub fn paper() -> Self {
        Self { model: GoalConfig::paper(), optim: value_optim(), value: ValueConfig::default() }
    }

    /// Settings for a CPU. The target network follows fast: the value of a goal n decisions away is learned after n
    /// times its delay.
    pub fn small() -> Self {
        let value = ValueConfig { momentum: 0.95, ..ValueConfig::default() };
        let optim = OptimConfig { lr: 1e-3, schedule: Schedule::Constant, ..value_optim() };
        Self { model: GoalConfig::small_with_value(), optim, value }
    }
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &GcivlConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let GcivlConfig { model, optim, value } = config;
    let (transformer, tokens) = (model.value_transformer(), model.tokens());
    let values = || GoalPredictor::new(&transformer, &tokens, 1, device);
    ValueLearner::make(NAME, (model, optim, value), GoalWeights::default(), values, dims, device)
}
