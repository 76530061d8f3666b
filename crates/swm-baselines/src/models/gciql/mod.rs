//! GCIQL: goal-conditioned implicit Q-learning. A critic of actions and a value learn from each other's slowly following
//! teachers; then a policy imitates actions the more, the more they raised the value.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use swm_data::loader::GoalWeights;

use crate::baseline::{GoalPolicy, Phase};
use crate::data::{Facts, Form, Inputs};
use crate::error::BaselineError;
use crate::losses::{Terms, expectile, mean_squared_error};
use crate::models::gcivl::{ValueConfig, value_optim};
use crate::models::goal::{ActingPolicy, GoalConfig, Observer, Seen, weighted_regression};
use crate::network::{Network, Parts};
use crate::nn::{Critic, GoalPredictor, Pool, parameter};
use crate::optim::OptimConfig;
use crate::pass::Pass;

/// Its name.
pub(crate) const NAME: &str = "gciql";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GciqlConfig {
    /// The network. Value and critic take the mean of a frame's tokens; the policy what is set here.
    pub model: GoalConfig,
    /// Hidden numbers of the critic's head.
    pub critic_hidden: usize,
    /// The optimiser of both phases.
    pub optim: OptimConfig,
    /// How the value is learnt, and what the policy makes of it.
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

    /// Settings for a processor.
    pub fn small() -> Self {
        Self { model: GoalConfig::small(), ..Self::paper() }
    }
}

#[derive(Module, Debug)]
struct Gciql {
    observer: Observer,
    value: GoalPredictor,
    value_teacher: GoalPredictor,
    critic: Critic,
    critic_teacher: Critic,
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
    facts: &Facts,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let GciqlConfig { model, critic_hidden, optim, value } = config;
    let observer = Observer::new(NAME, model, facts, device)?;
    let (form, tokens) = (model.form(facts), model.tokens());
    let mean = crate::nn::GoalTransformerConfig { pool: Pool::Mean, ..model.predictor.clone() };
    let values = || GoalPredictor::new(&mean, &tokens, 1, device);
    let critic = || Critic::new(&mean, &tokens, form.action, *critic_hidden, device);
    let value_phase = Phase {
        name: "value",
        optim: optim.clone(),
        goals: model.goals(GoalWeights::default()),
        trains: if model.train_encoder {
            &["value_predictor.student", "critic_predictor.student", "extra_encoders", "encoder"]
        } else {
            &["value_predictor.student", "critic_predictor.student", "extra_encoders"]
        },
        teachers: &[
            ("value_predictor.student", "value_predictor.teacher"),
            ("critic_predictor.student", "critic_predictor.teacher"),
        ],
        momentum: value.momentum,
    };
    let network = Gciql {
        observer,
        value: values(),
        value_teacher: values(),
        critic: critic(),
        critic_teacher: critic(),
        action_predictor: GoalPredictor::new(&model.predictor, &tokens, form.action, device),
        log_stds: parameter([form.action], device),
        config: *value,
        form,
        history: model.history,
    };
    Ok(Parts { network, needs: model.needs(1), form, phases: vec![value_phase, model.policy_phase(optim)] })
}

impl Network for Gciql {
    fn loss(&self, phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let Seen { frames, goal } = self.observer.see(inputs)?;
        let (now, next) = (frames.clone().narrow(1, 0, self.history), frames.narrow(1, 1, self.history));
        let actions = inputs.action.clone().narrow(1, 0, self.history);
        if phase == 0 {
            let value = self.value.forward(now.clone(), goal.clone(), pass);
            let worth =
                self.critic_teacher.forward(now.clone(), actions.clone(), goal.clone(), pass).detach();
            let value_error = expectile(value.clone(), worth, self.config.expectile);
            let critic = self.critic.forward(now, actions, goal.clone(), pass);
            let next = self.value_teacher.forward(next, goal, pass).detach();
            let goes_on = inputs.is_goal.clone().narrow(1, 0, self.history) * -1.0 + 1.0;
            let critic_error = mean_squared_error(critic, goes_on * (next * self.config.discount - 1.0));
            return Ok(Terms {
                total: value_error.clone() + critic_error.clone(),
                parts: vec![
                    ("value_error", value_error),
                    ("critic_error", critic_error),
                    ("value", value.mean()),
                ],
            });
        }
        let advantage = self.value.forward(next, goal.clone(), pass)
            - self.value.forward(now.clone(), goal.clone(), pass);
        let means = self.action_predictor.forward(now, goal, pass);
        Ok(weighted_regression(means, &self.log_stds, actions, advantage, self.config.alpha))
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        Some(Box::new(ActingPolicy {
            observer: self.observer.clone(),
            actor: self.action_predictor.clone(),
            form: self.form,
            history: self.history,
        }))
    }
}
