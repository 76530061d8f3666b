//! Planning with feature maps: the mean squared difference of predicted tokens from the goal's, of the last ones unless told
//! otherwise.

use burn::tensor::Tensor;
use swm_solvers::Aggregate;

use super::ConvJepa;
use crate::data::{Form, Start};
use crate::dynamics::{LatentDynamics, aggregate};
use swm_nn::Pass;

/// One planning problem, encoded.
pub(crate) struct Problem {
    /// `[1, 1, Z]`.
    map: Tensor<3>,
    /// `[1, 1, Z]`.
    goal: Tensor<3>,
}

impl LatentDynamics for ConvJepa {
    /// A candidate is tens of cells.
    const GROUP: usize = 20;

    type Problem = Problem;

    fn form(&self) -> &Form {
        &self.form
    }

    /// A map tells no velocity, and the predictor takes one.
    fn history(&self) -> usize {
        1
    }

    fn problem(&self, start: &Start, row: usize) -> Problem {
        let encode = |image| self.encode(image, &mut Pass::evaluate());
        Problem { map: encode(start.image(row)), goal: encode(start.goal_image(row)) }
    }

    fn latent_dim(&self) -> usize {
        self.dim()
    }

    fn latent(&self, pixels: Tensor<5>, _proprio: Option<Tensor<3>>) -> Tensor<2> {
        self.encode(pixels, &mut Pass::evaluate()).squeeze_dim(1)
    }

    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        let actions = self.action_encoder.forward(actions.unsqueeze_dim(1));
        self.predict(latents, &actions.squeeze_dim(1))
    }

    fn states(&self, problem: &Problem, plans: Tensor<3>) -> Tensor<3> {
        self.roll_out(problem.map.clone().expand([plans.dims()[0], 1, self.dim()]), plans)
    }

    fn costs(&self, problem: &Problem, plans: Tensor<3>, how: Aggregate) -> Tensor<1> {
        let horizon = plans.dims()[1];
        let maps = self.states(problem, plans);
        aggregate(how, horizon, |step| {
            (maps.clone().narrow(1, step, 1) - problem.goal.clone()).square().mean_dim(2).flatten(0, 2)
        })
    }
}
