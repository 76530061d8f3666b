//! Losses that a joint-embedding model can have in addition to its own: inverse dynamics, straightening, predictions on end, and
//! drawings of what was seen. A term of weight 0 is not computed.

use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::data::Inputs;
use swm_nn::losses::{Terms, mean_squared_error, straightening};
use swm_nn::{Drawing, InverseDynamics};

/// Weights of additional terms. A term of weight 0 is not computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct AuxiliaryWeights {
    /// Inverse dynamics.
    pub inverse: f64,
    /// Straightness of the paths of states.
    pub straightening: f64,
    /// Predictions on end, from the first state of a clip.
    pub rollout: f64,
    /// The share of the variance of images that drawings from their places do not explain; of keypoints only.
    pub drawing: f64,
}

/// What they are worth, and over how many steps.
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
    /// Drawings: the share of the variance of images that they do not explain.
    pub(crate) drawing: f64,
}

impl Auxiliary {
    /// Of these weights.
    pub(crate) fn new(weights: &AuxiliaryWeights, rollout_steps: usize) -> Self {
        let &AuxiliaryWeights { inverse, straightening, rollout, drawing } = weights;
        Self { inverse, straightening, rollout, rollout_steps, drawing }
    }

    /// What is wrong with it, if anything is, for an encoder of images of this side that finds so many places.
    pub(crate) fn check(&self, places: Option<usize>, image: usize) -> Result<(), String> {
        Drawing::check(self.drawing, places.is_some(), image)?;
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

    /// The inverse-dynamics MLP for latents of `dim` values and blocks of `actions`, if it has a weight.
    pub(crate) fn inverse(
        &self,
        dim: usize,
        hidden: usize,
        actions: usize,
        device: &Device,
    ) -> Option<InverseDynamics> {
        (self.inverse != 0.0).then(|| InverseDynamics::new(dim, hidden, actions, device))
    }

    /// What draws images of this side from so many places, if it has a weight.
    pub(crate) fn drawing(&self, places: Option<usize>, image: usize, device: &Device) -> Option<Drawing> {
        places.filter(|_| self.drawing != 0.0).map(|places| Drawing::new(places, image, device))
    }

    /// Adds the share of the images' variance that drawings from their places `[B, T, 2 K]` do not explain, if it has a weight.
    pub(crate) fn add_drawing(
        &self,
        terms: &mut Terms,
        drawing: Option<&Drawing>,
        inputs: &Inputs,
        places: Option<&Tensor<3>>,
    ) {
        if let (Some(drawing), Some(places)) = (drawing, places) {
            terms.add("drawing", self.drawing, drawing.unexplained_in_clips(&inputs.pixels, places));
        }
    }

    /// Adds the terms that have a weight. `states` are those of the batch, `[B, T, W]`; `roll_out` predicts `[B, R, W]` on end
    /// from states `[B, 1, W]` under actions `[B, R, D]`.
    pub(crate) fn add_to(
        &self,
        terms: &mut Terms,
        inverse: Option<&InverseDynamics>,
        states: &Tensor<3>,
        inputs: &Inputs,
        roll_out: impl FnOnce(Tensor<3>, Tensor<3>) -> Tensor<3>,
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
            let predicted = roll_out(states.clone().narrow(1, 0, 1), actions);
            let rollout = mean_squared_error(predicted, states.clone().narrow(1, 1, steps));
            terms.add("rollout", self.rollout, rollout);
        }
    }
}
