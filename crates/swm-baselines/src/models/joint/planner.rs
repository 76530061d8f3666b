//! Planning with LeWM and PLDM: the squared distance of predicted states from the goal's, of the last one unless told
//! otherwise.

use burn::tensor::Tensor;
use swm_solvers::Aggregate;

use super::Joint;
use crate::data::{Form, Start};
use crate::dynamics::{LatentDynamics, aggregate};
use crate::plan::Planner;
use swm_nn::Pass;
use swm_nn::SeenStates;

/// A copy of the model at work.
pub(crate) type JointPlanner = Planner<Joint>;

/// One planning problem, encoded.
pub(crate) struct Problem {
    /// `[1, N, W]`.
    states: Tensor<3>,
    /// `[1, N - 1, D]`.
    action: Option<Tensor<3>>,
    /// `[1, W]`.
    goal: Tensor<2>,
}

impl LatentDynamics for Joint {
    const GROUP: usize = 100;

    type Problem = Problem;

    fn form(&self) -> &Form {
        &self.form
    }

    fn history(&self) -> usize {
        self.config.history
    }

    fn problem(&self, start: &Start, row: usize) -> Problem {
        let pass = &mut Pass::evaluate();
        let states = self.encode(start.pixels.clone().narrow(0, row, 1), pass);
        let goal = self.encode(start.goal_image(row), pass);
        let action = start.action.as_ref().map(|action| action.clone().narrow(0, row, 1));
        Problem { states, action, goal: goal.squeeze_dim(1) }
    }

    fn latent_dim(&self) -> usize {
        self.config.latent_dim
    }

    fn latent(&self, pixels: Tensor<5>, _proprio: Option<Tensor<3>>) -> Tensor<2> {
        self.encode(pixels, &mut Pass::evaluate()).squeeze_dim(1)
    }

    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        let actions = self.action_encoder.forward(actions.unsqueeze_dim(1));
        self.predict(latents.unsqueeze_dim(1), actions, &mut Pass::evaluate()).squeeze_dim(1)
    }

    fn states(&self, problem: &Problem, plans: Tensor<3>) -> Tensor<3> {
        Tensor::cat(self.predicted(problem, plans), 1)
    }

    fn costs(&self, problem: &Problem, plans: Tensor<3>, how: Aggregate) -> Tensor<1> {
        let horizon = plans.dims()[1];
        let states = self.predicted(problem, plans);
        aggregate(how, horizon, |step| {
            let state: Tensor<2> = states[step].clone().squeeze_dim(1);
            (state - problem.goal.clone()).square().sum_dim(1).squeeze_dim(1)
        })
    }
}

impl Joint {
    /// H latents `[C, 1, W]` that candidates `[C, H, D]` lead to.
    fn predicted(&self, problem: &Problem, plans: Tensor<3>) -> Vec<Tensor<3>> {
        let [count, horizon, _] = plans.dims();
        let pass = &mut Pass::evaluate();
        let [_, observed, dim] = problem.states.dims();
        let actions = match &problem.action {
            Some(past) => {
                let [_, steps, dim] = past.dims();
                Tensor::cat(vec![past.clone().expand([count, steps, dim]), plans], 1)
            }
            None => plans,
        };
        let conditions = self.predictor.conditions(self.action_encoder.forward(actions));
        let during = |start, steps| {
            conditions.iter().map(|all| all.clone().narrow(1, start, steps)).collect::<Vec<_>>()
        };
        let mut states = vec![problem.states.clone().expand([count, observed, dim])];
        let mut seen = SeenStates::default();
        for step in 0..horizon {
            let end = observed + step;
            let next = if step > 0 && end <= self.config.history {
                // The window grows: only its newest state is new.
                let newest = states[states.len() - 1].clone();
                self.predictor.extend(newest, &during(end - 1, 1), &mut seen, pass)
            } else {
                // It begins, or slides: positions change, and all that follows from them.
                let start = end.saturating_sub(self.config.history);
                let window = Tensor::cat(states.clone(), 1).narrow(1, start, end - start);
                seen = SeenStates::default();
                self.predictor.extend(window, &during(start, end - start), &mut seen, pass)
            };
            states.push(self.pred_proj.forward_frames(next, pass));
        }
        states.split_off(1)
    }
}
