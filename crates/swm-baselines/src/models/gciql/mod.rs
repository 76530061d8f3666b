//! GCIQL: goal-conditioned implicit Q-learning. A critic and a value learn from each other's target
//! networks; then a policy, by advantage-weighted regression.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use swm_data::loader::GoalWeights;

use crate::baseline::{GoalPolicy, Phase};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::gcivl::{ValueConfig, value_optim};
use crate::models::goal::{ActingPolicy, GoalConfig, Observer, Transition};
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::{Terms, expectile, mean_squared_error};
use swm_nn::optim::{OptimConfig, Schedule};
use swm_nn::{Critic, GoalPredictor, parameter};

/// Its name.
pub(crate) const NAME: &str = "gciql";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct GciqlConfig {
    /// The network. Value and critic take the mean of a frame's tokens; the policy what is set here.
    pub model: GoalConfig,
    /// Hidden dim of the critic's head.
    pub critic_hidden: usize,
    /// The optimizer of both phases.
    pub optim: OptimConfig,
    /// Settings of the value, and of the policy extracted from it.
    pub value: ValueConfig,
}

impl GciqlConfig {
    /// The reference's settings.
    pub fn paper() -> Self {
        Self {
            model: GoalConfig { batch: 32, ..GoalConfig::paper() },
            critic_hidden: 256,
            optim: value_optim(),
            value: ValueConfig { alpha: 10.0, ..ValueConfig::default() },
        }
    }

    /// Settings for a CPU, as GCIVL's.
    pub fn small() -> Self {
        let paper = Self::paper();
        let value = ValueConfig { momentum: 0.95, ..paper.value };
        let optim = OptimConfig { lr: 1e-3, schedule: Schedule::Constant, ..value_optim() };
        Self { model: GoalConfig::small_with_value(), optim, value, ..paper }
    }
}

#[derive(Module, Debug)]
struct Gciql {
    observer: Observer,
    value: GoalPredictor,
    value_target: GoalPredictor,
    critic: Critic,
    critic_target: Critic,
    action_predictor: GoalPredictor,
    log_stds: Param<Tensor<1>>,
    #[module(skip)]
    config: ValueConfig,
    #[module(skip)]
    form: Form,
    #[module(skip)]
    history: usize,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &GciqlConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let GciqlConfig { model, critic_hidden, optim, value } = config;
    value.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let observer = Observer::new(NAME, model, dims, device)?;
    let (form, tokens) = (model.form(dims), model.tokens());
    let value_transformer = model.value_transformer();
    let values = || GoalPredictor::new(&value_transformer, &tokens, 1, device);
    let critic = || Critic::new(&value_transformer, &tokens, form.action, *critic_hidden, device);
    let value_phase = Phase {
        name: "value",
        optim: optim.clone(),
        goals: model.goals(GoalWeights::default()),
        trains: if model.train_encoder {
            &["value_predictor.student", "critic_predictor.student", "extra_encoders", "encoder"]
        } else {
            &["value_predictor.student", "critic_predictor.student", "extra_encoders"]
        },
        targets: &[
            ("value_predictor.student", "value_predictor.teacher"),
            ("critic_predictor.student", "critic_predictor.teacher"),
        ],
        momentum: value.momentum,
    };
    let network = Gciql {
        observer,
        value: values(),
        value_target: values(),
        critic: critic(),
        critic_target: critic(),
        action_predictor: GoalPredictor::new(&model.predictor, &tokens, form.action, device),
        log_stds: parameter([form.action], device),
        config: *value,
        form,
        history: model.history,
    };
    Ok(Parts {
        network,
        input_spec: model.input_spec(1),
        form,
        phases: vec![value_phase, model.policy_phase(optim, value.policy_goals)],
    })
}

impl Network for Gciql {
    const DISPENSABLE: &'static [&'static str] = &["value_predictor", "critic_predictor"];

    fn loss(&self, phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let seen = Transition::see(&self.observer, inputs, self.history)?;
        let ValueConfig { discount, expectile: share, alpha, .. } = self.config;
        if phase > 0 {
            let (actor, log_stds) = (&self.action_predictor, &self.log_stds);
            return Ok(seen.weighted_regression(&self.value, actor, log_stds, alpha, pass));
        }
        let Transition { now, goal, actions, .. } = &seen;
        let value = self.value.forward(now.clone(), goal.clone(), pass);
        let critic = |critic: &Critic, pass: &mut Pass| {
            critic.forward(now.clone(), actions.clone(), goal.clone(), pass)
        };
        let value_error = expectile(value.clone(), critic(&self.critic_target, pass).detach(), share);
        let target = seen.target(&self.value_target, discount, pass);
        let critic_error = mean_squared_error(critic(&self.critic, pass), target);
        Ok(Terms {
            total: value_error.clone() + critic_error.clone(),
            parts: vec![
                ("value_error", value_error),
                ("critic_error", critic_error),
                ("value", value.mean()),
            ],
        })
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        ActingPolicy::of(&self.observer, &self.action_predictor, self.form, self.history)
    }
}
