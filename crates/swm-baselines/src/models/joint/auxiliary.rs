//! Losses that a joint-embedding model can have in addition to its own: inverse dynamics, straightening, and predictions
//! on end. All have weight 0 unless they are asked for.

use burn::tensor::Tensor;

use super::Joint;
use crate::data::Inputs;
use crate::losses::{Terms, mean_squared_error, straightening};
use crate::nn::InverseDynamics;
use crate::pass::Pass;

/// What they are worth. A term of weight 0 is not computed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Auxiliary {
    /// Inverse dynamics: squared error of the actions between two states, told from both.
    pub(crate) inverse: f64,
    /// Straightness of the paths of states.
    pub(crate) straightening: f64,
    /// Squared error of states that are predicted on end from the first one.
    pub(crate) rollout: f64,
    /// How many.
    pub(crate) rollout_steps: usize,
}

impl Auxiliary {
    /// What is wrong with it, if anything is.
    pub(crate) fn check(&self) -> Result<(), String> {
        match (self.rollout, self.rollout_steps) {
            (weight, 0) if weight != 0.0 => {
                Err(format!("`weights.rollout` is {weight} and `rollout_steps` 0; it must be at least 1"))
            }
            _ => Ok(()),
        }
    }

    /// Predictions on end that a clip must hold.
    pub(crate) fn steps(&self) -> usize {
        if self.rollout == 0.0 { 0 } else { self.rollout_steps }
    }

    /// Adds the terms that have a weight. `states` are those of the batch, `[B, T, W]`.
    pub(crate) fn add_to(
        &self,
        terms: &mut Terms,
        model: &Joint,
        inverse: Option<&InverseDynamics>,
        states: &Tensor<3>,
        inputs: &Inputs,
        pass: &mut Pass,
    ) {
        let transitions = states.dims()[1] - 1;
        if let (true, Some(inverse)) = (self.inverse != 0.0, inverse) {
            let actions = inputs.action.clone().narrow(1, 0, transitions);
            terms.add("inverse", self.inverse, mean_squared_error(inverse.forward(states.clone()), actions));
        }
        if self.straightening != 0.0 {
            terms.add("straightening", self.straightening, straightening(states.clone()));
        }
        let steps = self.steps();
        if steps > 0 {
            let actions = inputs.action.clone().narrow(1, 0, steps);
            let predicted = model.roll_out(states.clone().narrow(1, 0, 1), actions, pass);
            let rollout = mean_squared_error(predicted, states.clone().narrow(1, 1, steps));
            terms.add("rollout", self.rollout, rollout);
        }
    }
}
