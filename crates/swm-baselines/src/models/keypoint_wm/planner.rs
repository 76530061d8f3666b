//! Planning with keypoints: the squared distance of predicted places from the goal's, of the last ones unless told otherwise.

use burn::tensor::Tensor;
use swm_solvers::Aggregate;

use super::KeypointWm;
use crate::data::{Form, Start};
use crate::dynamics::{LatentDynamics, aggregate};

/// One planning problem, encoded.
pub(crate) struct Problem {
    /// `[1, Z]`.
    latent: Tensor<2>,
    /// `[1, D]`: the action before it.
    before: Tensor<2>,
    /// `[1, Z]`.
    goal: Tensor<2>,
}

impl LatentDynamics for KeypointWm {
    const GROUP: usize = 50;

    type Problem = Problem;

    fn form(&self) -> &Form {
        &self.form
    }

    /// The second is there for the action between them.
    fn history(&self) -> usize {
        2
    }

    fn problem(&self, start: &Start, row: usize) -> Problem {
        let encode = |image| self.encode(image).squeeze_dim(1);
        let before = match &start.action {
            Some(actions) => {
                let last = actions.dims()[1] - 1;
                actions.clone().narrow(0, row, 1).narrow(1, last, 1).squeeze_dim(1)
            }
            None => Tensor::zeros([1, self.form.action], &start.pixels.device()),
        };
        Problem { latent: encode(start.image(row)), before, goal: encode(start.goal_image(row)) }
    }

    fn latent_dim(&self) -> usize {
        self.dim
    }

    fn latent(&self, pixels: Tensor<5>, _proprio: Option<Tensor<3>>) -> Tensor<2> {
        self.encode(pixels).squeeze_dim(1)
    }

    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        self.predictor.forward(latents, actions.zeros_like(), actions)
    }

    fn states(&self, problem: &Problem, plans: Tensor<3>) -> Tensor<3> {
        Tensor::stack(self.predicted(problem, &plans), 1)
    }

    fn costs(&self, problem: &Problem, plans: Tensor<3>, how: Aggregate) -> Tensor<1> {
        let horizon = plans.dims()[1];
        let predicted = self.predicted(problem, &plans);
        aggregate(how, horizon, |step| {
            (predicted[step].clone() - problem.goal.clone()).square().sum_dim(1).squeeze_dim(1)
        })
    }
}

impl KeypointWm {
    /// H latents `[C, Z]` that candidates `[C, H, D]` lead to.
    fn predicted(&self, problem: &Problem, plans: &Tensor<3>) -> Vec<Tensor<2>> {
        let [count, _, dim] = plans.dims();
        let latent = problem.latent.clone().expand([count, self.dim]);
        self.roll_out(latent, problem.before.clone().expand([count, dim]), plans)
    }
}
