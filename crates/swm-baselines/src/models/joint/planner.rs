//! Planning with LeWM and PLDM: the squared distance of the last predicted state from the goal's.
//!
//! Candidates go through the network in groups of a fixed size, each from one scene and filled up where it is not full.
//! So the bits of a cost depend on nothing beside the candidate: not on other scenes, not on threads.

use burn::tensor::{Device, Tensor};
use rayon::prelude::*;
use swm_solvers::Candidates;

use super::Joint;
use crate::baseline::PlanModel;
use crate::data::{Scenes, Start};
use crate::error::BaselineError;
use crate::nn::SeenStates;
use crate::pass::Pass;
use crate::plan::{Groups, run_all};

/// Candidates of a group. A multiple of the rows that kernels for products of matrices take at a time.
const GROUP: usize = 32;

/// A copy of the model, and what was prepared.
pub(crate) struct JointPlanner {
    model: Joint,
    device: Device,
    scenes: Vec<Scene>,
}

/// What all candidates of a scene share.
struct Scene {
    /// `[1, N, W]`.
    states: Tensor<3>,
    /// `[1, N - 1, D]`.
    action: Option<Tensor<3>>,
    /// `[1, W]`.
    goal: Tensor<2>,
}

impl JointPlanner {
    /// Of a copy of the model.
    pub(crate) fn new(model: Joint) -> Self {
        Self { model, device: Device::flex(), scenes: Vec::new() }
    }
}

impl Joint {
    /// `[C]`: costs of candidates `[C, H, D]` of one scene.
    fn costs(&self, scene: &Scene, plans: Tensor<3>) -> Tensor<1> {
        let [count, horizon, _] = plans.dims();
        let pass = &mut Pass::evaluate();
        let [_, observed, width] = scene.states.dims();
        let actions = match &scene.action {
            Some(past) => {
                let [_, steps, width] = past.dims();
                Tensor::cat(vec![past.clone().expand([count, steps, width]), plans], 1)
            }
            None => plans,
        };
        let conditions = self.predictor.conditions(self.action_encoder.forward(actions));
        let during = |start, steps| {
            conditions.iter().map(|all| all.clone().narrow(1, start, steps)).collect::<Vec<_>>()
        };
        let mut states = vec![scene.states.clone().expand([count, observed, width])];
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
        let last: Tensor<2> = states.pop().expect("a plan has a step").squeeze_dim(1);
        (last - scene.goal.clone()).square().sum_dim(1).squeeze_dim(1)
    }
}

impl PlanModel for JointPlanner {
    fn block_width(&self) -> usize {
        self.model.form.action
    }

    fn history(&self) -> usize {
        self.model.config.history
    }

    fn prepare(&mut self, scenes: &Scenes<'_>) -> Result<(), BaselineError> {
        let Start { pixels, action, goal_pixels, .. } = Start::new(scenes, &self.model.form, &self.device)?;
        let row = |index: usize| {
            let pass = &mut Pass::evaluate();
            let states = self.model.encode(pixels.clone().narrow(0, index, 1), pass);
            let goal = self.model.encode(goal_pixels.clone().narrow(0, index, 1), pass);
            let action = action.as_ref().map(|action| action.clone().narrow(0, index, 1));
            Scene { states, action, goal: goal.squeeze_dim(1) }
        };
        // One by one: the bits of a scene's states must not depend on its neighbours.
        self.scenes = (0..scenes.pixels.rows).into_par_iter().map(row).collect();
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), BaselineError> {
        let groups = Groups::new(candidates, self.scenes.len(), self.block_width(), GROUP)?;
        let cost = |row: usize, plans| self.model.costs(&self.scenes[row], plans);
        run_all(groups.of_costs(costs), &self.device, cost);
        Ok(())
    }

    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), BaselineError> {
        let groups = Groups::new(candidates, self.scenes.len(), self.block_width(), GROUP)?;
        let cost = |row: usize, plans| self.model.costs(&self.scenes[row], plans);
        run_all(groups.of_gradients(costs, gradient), &self.device, cost);
        Ok(())
    }
}
