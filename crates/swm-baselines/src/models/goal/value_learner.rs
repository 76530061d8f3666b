//! GCIVL and HILP, which differ in their value network: first a value, by expectile regression on a target network's value
//! of the next observation; then a policy, by advantage-weighted regression.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use swm_data::loader::GoalWeights;

use super::{ActingPolicy, GoalConfig, Observer, Transition};
use crate::baseline::{GoalPolicy, Phase};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::gcivl::ValueConfig;
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::{Terms, expectile};
use swm_nn::optim::OptimConfig;
use swm_nn::{GoalPredictor, ValueNetwork, parameter};

/// A value `V` and a policy.
#[derive(Module, Debug)]
pub(crate) struct ValueLearner<V: Module> {
    observer: Observer,
    value: V,
    value_target: V,
    action_predictor: GoalPredictor,
    log_stds: Param<Tensor<1>>,
    #[module(skip)]
    config: ValueConfig,
    #[module(skip)]
    form: Form,
    #[module(skip)]
    history: usize,
}

impl<V: ValueNetwork> ValueLearner<V> {
    /// Network and training of these settings. The value learns from clips with the goals `goals`; `values` makes a value
    /// network, once the settings are known to be sound.
    pub(crate) fn make(
        baseline: &'static str,
        (model, optim, value): (&GoalConfig, &OptimConfig, &ValueConfig),
        goals: GoalWeights,
        values: impl Fn() -> V,
        dims: &DataDims,
        device: &Device,
    ) -> Result<Parts<Self>, BaselineError> {
        value.check().map_err(|reason| BaselineError::Settings { baseline, reason })?;
        let observer = Observer::new(baseline, model, dims, device)?;
        let (form, tokens) = (model.form(dims), model.tokens());
        let value_phase = Phase {
            name: "value",
            optim: optim.clone(),
            goals: model.goals(goals),
            trains: if model.train_encoder {
                &["value_predictor.student", "extra_encoders", "encoder"]
            } else {
                &["value_predictor.student", "extra_encoders"]
            },
            targets: &[("value_predictor.student", "value_predictor.teacher")],
            momentum: value.momentum,
        };
        let network = Self {
            observer,
            value: values(),
            value_target: values(),
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
}

impl<V: ValueNetwork> Network for ValueLearner<V> {
    const DISPENSABLE: &'static [&'static str] = &["value_predictor"];

    fn loss(&self, phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let seen = Transition::see(&self.observer, inputs, self.history)?;
        let ValueConfig { discount, expectile: share, alpha, .. } = self.config;
        if phase > 0 {
            let (actor, log_stds) = (&self.action_predictor, &self.log_stds);
            return Ok(seen.weighted_regression(&self.value, actor, log_stds, alpha, pass));
        }
        let value = self.value.value(seen.now.clone(), seen.goal.clone(), pass);
        let loss = expectile(value.clone(), seen.target(&self.value_target, discount, pass), share);
        Ok(Terms { total: loss.clone(), parts: vec![("value_error", loss), ("value", value.mean())] })
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        ActingPolicy::of(&self.observer, &self.action_predictor, self.form, self.history)
    }
}
