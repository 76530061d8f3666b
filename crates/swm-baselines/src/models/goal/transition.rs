//! Transitions of value learning: the TD target, and advantage-weighted regression of a policy.

use burn::module::Param;
use burn::tensor::Tensor;

use super::{Observer, Seen};
use crate::data::Inputs;
use crate::error::BaselineError;
use swm_nn::Pass;
use swm_nn::losses::Terms;
use swm_nn::{GoalPredictor, ValueNetwork};

/// Bounds of the logarithms of a policy's stds.
const LOG_STDS: [f32; 2] = [-5.0, 2.0];
/// The largest weight of an action.
const MOST: f32 = 100.0;

/// What was seen before and after the actions of a batch.
pub(crate) struct Transition {
    /// `[B, T, P, W]`.
    pub(crate) now: Tensor<4>,
    /// `[B, T, P, W]`.
    pub(crate) next: Tensor<4>,
    /// `[B, 1, P, W]`.
    pub(crate) goal: Tensor<4>,
    /// `[B, T, F × A]`.
    pub(crate) actions: Tensor<3>,
    /// `[B, T, 1]`: 0 where an observation is the goal, 1 elsewhere.
    goes_on: Tensor<3>,
}

impl Transition {
    /// Of the first `history` steps of clips that have one more.
    pub(crate) fn see(observer: &Observer, inputs: &Inputs, history: usize) -> Result<Self, BaselineError> {
        let Seen { frames, goal } = observer.see(inputs)?;
        Ok(Self {
            now: frames.clone().narrow(1, 0, history),
            next: frames.narrow(1, 1, history),
            goal,
            actions: inputs.action.clone().narrow(1, 0, history),
            goes_on: inputs.is_goal.clone().narrow(1, 0, history) * -1.0 + 1.0,
        })
    }

    /// The TD target: a reward of −1 plus the discounted value of the next observation by `target_network`; 0 at the goal.
    pub(crate) fn target(
        &self,
        target_network: &impl ValueNetwork,
        discount: f64,
        pass: &mut Pass,
    ) -> Tensor<3> {
        let next = target_network.value(self.next.clone(), self.goal.clone(), pass).detach();
        self.goes_on.clone() * (next * discount - 1.0)
    }

    /// Advantage-weighted regression: the negative log-likelihood of the actions, each weighted by
    /// exp(alpha × advantage), at most 100.
    pub(crate) fn weighted_regression(
        self,
        value: &impl ValueNetwork,
        actor: &GoalPredictor,
        log_stds: &Param<Tensor<1>>,
        alpha: f64,
        pass: &mut Pass,
    ) -> Terms {
        let Self { now, next, goal, actions, .. } = self;
        let advantage = value.value(next, goal.clone(), pass) - value.value(now.clone(), goal.clone(), pass);
        let worth = (advantage.detach() * alpha).exp().clamp_max(MOST);
        let log_stds: Tensor<3> = log_stds.val().clamp(LOG_STDS[0], LOG_STDS[1]).unsqueeze();
        let variance = (log_stds.clone() * 2.0).exp();
        let error = (actions - actor.forward(now, goal, pass)).square();
        let unlikely = log_stds + error.clone() / variance * 0.5;
        Terms {
            total: (unlikely * worth.clone()).mean(),
            parts: vec![("action_error", error.mean()), ("worth", worth.mean())],
        }
    }
}
