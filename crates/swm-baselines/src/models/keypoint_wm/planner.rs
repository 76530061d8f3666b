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
    /// `[1, Z]`: the change before it, where the model sees that.
    changed: Option<Tensor<2>>,
    /// `[1, Z]`.
    goal: Tensor<2>,
}

impl LatentDynamics for KeypointWm {
    const GROUP: usize = 50;

    type Problem = Problem;

    fn form(&self) -> &Form {
        &self.form
    }

    /// The other is there for the action between them, and for the change.
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
        let latent: Tensor<2> = encode(start.image(row));
        let past = start.earlier_image(row).filter(|_| self.velocity).map(encode);
        let changed = self.changed(past.as_ref().unwrap_or(&latent), &latent);
        Problem { latent, before, changed, goal: encode(start.goal_image(row)) }
    }

    fn latent_dim(&self) -> usize {
        self.dim
    }

    fn latent(&self, pixels: Tensor<5>, _proprio: Option<Tensor<3>>) -> Tensor<2> {
        self.encode(pixels).squeeze_dim(1)
    }

    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        let changed = self.velocity.then(|| latents.zeros_like());
        self.predictor.forward(latents, actions.zeros_like(), actions, changed)
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
        let each = |values: &Tensor<2>, width: usize| values.clone().expand([count, width]);
        let changed = problem.changed.as_ref().map(|changed| each(changed, self.dim));
        self.roll_out(each(&problem.latent, self.dim), each(&problem.before, dim), changed, plans)
    }
}
