//! Planning with DINO-WM: the mean squared distance of predicted tokens from the goal's, of the last ones unless told
//! otherwise, plus that of proprioception where it is used.

use burn::tensor::Tensor;
use swm_solvers::Aggregate;

use super::DinoWm;
use crate::data::{Form, Start};
use crate::dynamics::{LatentDynamics, aggregate};
use swm_nn::Pass;
use swm_nn::StateEmbedder;

/// One planning problem, encoded.
pub(crate) struct Problem {
    /// `[1, N, P, W]`: observed, without actions.
    frames: Tensor<4>,
    /// `[1, N - 1, D]`.
    action: Option<Tensor<3>>,
    /// `[1, 1, P, W]`: without actions.
    goal: Tensor<4>,
}

impl LatentDynamics for DinoWm {
    /// A candidate is hundreds of tokens.
    const GROUP: usize = 4;

    /// The attention scores of a candidate take up to 38 MB: 16 heads × (3 frames × 256 tokens)².
    const GROUP_ON_DEVICE: usize = 64;

    type Problem = Problem;

    fn form(&self) -> &Form {
        &self.form
    }

    fn history(&self) -> usize {
        self.history
    }

    fn problem(&self, start: &Start, row: usize) -> Problem {
        let state = |state: &Option<Tensor<3>>| state.as_ref().map(|state| state.clone().narrow(0, row, 1));
        let pixels = start.pixels.clone().narrow(0, row, 1);
        Problem {
            frames: self.observe(pixels, state(&start.proprio)),
            action: state(&start.action),
            goal: self.observe(start.goal_image(row), state(&start.goal_proprio)),
        }
    }

    fn latent_dim(&self) -> usize {
        self.observed.iter().product()
    }

    fn latent(&self, pixels: Tensor<5>, proprio: Option<Tensor<3>>) -> Tensor<2> {
        let count = pixels.dims()[0];
        self.observe(pixels, proprio).reshape([count, self.latent_dim()])
    }

    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        let ([count, dim], [patches, tokens]) = (latents.dims(), self.observed);
        let frames =
            self.with_actions(latents.reshape([count, 1, patches, tokens]), actions.unsqueeze_dim(1));
        self.predict(frames, &mut Pass::evaluate()).reshape([count, dim])
    }

    fn states(&self, problem: &Problem, plans: Tensor<3>) -> Tensor<3> {
        let ([count, horizon, _], seen) = (plans.dims(), problem.frames.dims()[1]);
        let frames = self.frames(problem, plans).narrow(1, seen, horizon);
        frames.reshape([count, horizon, self.latent_dim()])
    }

    fn costs(&self, problem: &Problem, plans: Tensor<3>, how: Aggregate) -> Tensor<1> {
        let (horizon, [_, seen, _, tokens]) = (plans.dims()[1], problem.frames.dims());
        let frames = self.frames(problem, plans);
        let of_proprio = self.proprio.as_ref().map_or(0, StateEmbedder::dim);
        let of_pixels = tokens - of_proprio;
        let mean = |part: Tensor<4>| part.flatten::<2>(1, 3).mean_dim(1).squeeze_dim::<1>(1);
        aggregate(how, horizon, |step| {
            let error = (frames.clone().narrow(1, seen + step, 1) - problem.goal.clone()).square();
            let pixels = mean(error.clone().narrow(3, 0, of_pixels));
            if of_proprio == 0 {
                return pixels;
            }
            // All tokens of an observed frame say the same of proprioception; the reference asks the first.
            pixels + mean(error.narrow(3, of_pixels, of_proprio).narrow(2, 0, 1))
        })
    }
}

impl DinoWm {
    /// `[C, N + H, P, W]`: the observed frames, and those that candidates `[C, H, D]` lead to, without actions.
    fn frames(&self, problem: &Problem, plans: Tensor<3>) -> Tensor<4> {
        let [count, horizon, dim] = plans.dims();
        let pass = &mut Pass::evaluate();
        let [_, seen, patches, tokens] = problem.frames.dims();
        let past = problem.action.as_ref().map(|past| past.clone().expand([count, seen - 1, dim]));
        let actions = Tensor::cat(past.into_iter().chain([plans]).collect(), 1);
        let mut frames = problem.frames.clone().expand([count, seen, patches, tokens]);
        for step in 0..horizon {
            let end = seen + step;
            let start = end.saturating_sub(self.history);
            let window = frames.clone().narrow(1, start, end - start);
            let window = self.with_actions(window, actions.clone().narrow(1, start, end - start));
            let next = self.predict(window, pass).narrow(1, end - start - 1, 1);
            frames = Tensor::cat(vec![frames, next], 1);
        }
        frames
    }
}
