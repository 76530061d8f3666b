//! GCBC: goal-conditioned behavioral cloning. Loss: squared error of the actions taken, at each frame of the history.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use swm_data::loader::GoalWeights;

use crate::baseline::{GoalPolicy, Phase};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::goal::{ActingPolicy, GoalConfig, Observer, Seen};
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::{Terms, mean_squared_error};
use swm_nn::optim::OptimConfig;
use swm_nn::{GoalPredictor, parameter};

/// Its name.
pub(crate) const NAME: &str = "gcbc";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct GcbcConfig {
    /// The network.
    pub model: GoalConfig,
    /// Which later steps of an episode are its goals.
    pub goals: LaterGoals,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// Which later steps of an episode are goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LaterGoals {
    /// All equally often.
    Uniform,
    /// Each `model.goal_gamma` times as often as the one before it; the last takes all that would come after it.
    Geometric,
}

impl GcbcConfig {
    /// The reference's settings.
    pub fn paper() -> Self {
        Self {
            model: GoalConfig::paper(),
            goals: LaterGoals::Uniform,
            optim: OptimConfig { lr: 1e-4, weight_decay: 0.01, clip: None, ..OptimConfig::default() },
        }
    }

    /// Settings for a CPU.
    pub fn small() -> Self {
        Self {
            model: GoalConfig::small(),
            goals: LaterGoals::Geometric,
            optim: OptimConfig { lr: 1e-3, clip: Some(1.0), ..Self::paper().optim },
        }
    }
}

#[derive(Module, Debug)]
struct Gcbc {
    observer: Observer,
    action_predictor: GoalPredictor,
    /// Not used: the reference's policies all have it, and its files of weights too.
    log_stds: Param<Tensor<1>>,
    #[module(skip)]
    form: Form,
    #[module(skip)]
    history: usize,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &GcbcConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let GcbcConfig { model, goals, optim } = config;
    let none = GoalWeights { random: 0.0, geometric: 0.0, uniform: 0.0, current: 0.0 };
    let weights = match goals {
        LaterGoals::Uniform => GoalWeights { uniform: 1.0, ..none },
        LaterGoals::Geometric => GoalWeights { geometric: 1.0, ..none },
    };
    let observer = Observer::new(NAME, model, dims, device)?;
    let form = model.form(dims);
    let phase = Phase {
        name: "policy",
        optim: optim.clone(),
        goals: model.goals(weights),
        trains: if model.train_encoder { &[""] } else { &["action_predictor", "extra_encoders"] },
        targets: &[],
        momentum: 0.0,
    };
    let action_predictor = GoalPredictor::new(&model.predictor, &model.tokens(), form.action, device);
    Ok(Parts {
        network: Gcbc {
            observer,
            action_predictor,
            log_stds: parameter([form.action], device),
            form,
            history: model.history,
        },
        input_spec: model.input_spec(0),
        form,
        phases: vec![phase],
    })
}

impl Network for Gcbc {
    fn loss(&self, _phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let Seen { frames, goal } = self.observer.see(inputs)?;
        let means = self.action_predictor.forward(frames.narrow(1, 0, self.history), goal, pass);
        let actions = inputs.action.clone().narrow(1, 0, self.history);
        Ok(Terms { total: mean_squared_error(means, actions), parts: Vec::new() })
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        ActingPolicy::of(&self.observer, &self.action_predictor, self.form, self.history)
    }
}
