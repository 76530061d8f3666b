//! Goal-conditioned policies at work: the mean action.

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::Observer;
use crate::baseline::GoalPolicy;
use crate::data::{Form, PlanningBatch, Start};
use crate::error::BaselineError;
use crate::nn::GoalPredictor;
use crate::params::{device_of, host};
use crate::pass::Pass;

/// A copy of what acts.
pub(crate) struct ActingPolicy {
    observer: Observer,
    actor: GoalPredictor,
    form: Form,
    history: usize,
}

impl ActingPolicy {
    /// Of a trained network, which stays as it is.
    pub(crate) fn of(
        observer: &Observer,
        actor: &GoalPredictor,
        form: Form,
        history: usize,
    ) -> Option<Box<dyn GoalPolicy>> {
        Some(Box::new(Self { observer: observer.clone(), actor: actor.clone(), form, history }))
    }
}

impl GoalPolicy for ActingPolicy {
    fn block_dim(&self) -> usize {
        self.form.action
    }

    fn history(&self) -> usize {
        self.history
    }

    fn act(&mut self, batch: &PlanningBatch<'_>, actions: &mut [f32]) -> Result<(), BaselineError> {
        let start = Start::new(batch, &self.form, &device_of(&self.actor))?;
        let (steps, dim) = (batch.pixels.steps, self.form.action);
        if steps > self.history || actions.len() != batch.pixels.rows * dim {
            let reason = format!(
                "{steps} observations and room for {} values; this policy takes up to {} and gives {dim} per environment",
                actions.len(),
                self.history
            );
            return Err(BaselineError::data("pixels", reason));
        }
        // One by one: the bits of a decision must not depend on its neighbors.
        actions.par_chunks_exact_mut(dim).enumerate().for_each(|(row, out)| {
            let of_row =
                |state: &Option<Tensor<3>>| state.as_ref().map(|state| state.clone().narrow(0, row, 1));
            let frames = self.observer.tokens(start.pixels.clone().narrow(0, row, 1), of_row(&start.proprio));
            let goal = start.goal_pixels.clone().narrow(0, row, 1);
            let goal = self.observer.tokens(goal, of_row(&start.goal_proprio));
            let means = self.actor.forward(frames, goal, &mut Pass::evaluate());
            out.copy_from_slice(&host(means.narrow(1, steps - 1, 1)));
        });
        Ok(())
    }
}
