//! Planning with DINO-WM: the mean squared distance of the last predicted tokens from the goal's, plus that of
//! proprioception where it is used.
//!
//! Candidates go through the network in groups, as in `joint/planner.rs` and for its reasons.

use burn::tensor::{Device, Tensor};
use rayon::prelude::*;
use swm_solvers::Candidates;

use super::DinoWm;
use crate::baseline::PlanModel;
use crate::data::{Scenes, Start};
use crate::error::BaselineError;
use crate::nn::StateEmbedder;
use crate::pass::Pass;
use crate::plan::{Groups, run_all};

/// Candidates of a group: a candidate is hundreds of tokens.
const GROUP: usize = 4;

/// A copy of the model, and what was prepared.
pub(super) struct DinoPlanner {
    model: DinoWm,
    device: Device,
    scenes: Vec<Scene>,
}

/// What all candidates of a scene share.
struct Scene {
    /// `[1, N, P, W]`: observed, without actions.
    frames: Tensor<4>,
    /// `[1, N - 1, D]`.
    action: Option<Tensor<3>>,
    /// `[1, 1, P, W]`: without actions.
    goal: Tensor<4>,
}

impl DinoPlanner {
    /// Of a copy of the model.
    pub(super) fn new(model: DinoWm) -> Self {
        Self { model, device: Device::flex(), scenes: Vec::new() }
    }
}

impl DinoWm {
    /// `[C]`: costs of candidates `[C, H, D]` of one scene.
    fn costs(&self, scene: &Scene, plans: Tensor<3>) -> Tensor<1> {
        let [count, horizon, width] = plans.dims();
        let pass = &mut Pass::evaluate();
        let [_, seen, patches, tokens] = scene.frames.dims();
        let past = scene.action.as_ref().map(|past| past.clone().expand([count, seen - 1, width]));
        let actions = Tensor::cat(past.into_iter().chain([plans]).collect(), 1);
        let mut frames = scene.frames.clone().expand([count, seen, patches, tokens]);
        for step in 0..horizon {
            let end = seen + step;
            let start = end.saturating_sub(self.history);
            let window = frames.clone().narrow(1, start, end - start);
            let window = self.with_actions(window, actions.clone().narrow(1, start, end - start));
            let next = self.predict(window, pass).narrow(1, end - start - 1, 1);
            frames = Tensor::cat(vec![frames, next], 1);
        }
        let last = frames.narrow(1, seen + horizon - 1, 1);
        let error = (last - scene.goal.clone()).square();
        let of_proprio = self.proprio.as_ref().map_or(0, StateEmbedder::width);
        let of_pixels = tokens - of_proprio;
        let mean = |part: Tensor<4>| part.flatten::<2>(1, 3).mean_dim(1).squeeze_dim::<1>(1);
        let pixels = mean(error.clone().narrow(3, 0, of_pixels));
        if of_proprio == 0 {
            return pixels;
        }
        // All tokens of an observed frame say the same of proprioception; the reference asks the first.
        pixels + mean(error.narrow(3, of_pixels, of_proprio).narrow(2, 0, 1))
    }
}

impl PlanModel for DinoPlanner {
    fn block_width(&self) -> usize {
        self.model.form.action
    }

    fn history(&self) -> usize {
        self.model.history
    }

    fn prepare(&mut self, scenes: &Scenes<'_>) -> Result<(), BaselineError> {
        let start = Start::new(scenes, &self.model.form, &self.device)?;
        let row = |index: usize| {
            let state =
                |state: &Option<Tensor<3>>| state.as_ref().map(|state| state.clone().narrow(0, index, 1));
            let pixels = start.pixels.clone().narrow(0, index, 1);
            let goal = start.goal_pixels.clone().narrow(0, index, 1);
            Scene {
                frames: self.model.observe(pixels, state(&start.proprio)),
                action: state(&start.action),
                goal: self.model.observe(goal, state(&start.goal_proprio)),
            }
        };
        // One by one: the bits of a scene's tokens must not depend on its neighbours.
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
