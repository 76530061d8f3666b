//! Goal-conditioned policies at work: the mean action.

use burn::tensor::Tensor;

use super::Observer;
use crate::baseline::GoalPolicy;
use crate::data::{Form, PlanningBatch, Start};
use crate::dynamics::for_each_group;
use crate::error::BaselineError;
use swm_nn::GoalPredictor;
use swm_nn::Pass;
use swm_nn::params::{device_of, host};
use swm_nn::placement::Placement;

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

    fn act_within(
        &mut self,
        batch: &PlanningBatch<'_>,
        _left: &[usize],
        actions: &mut [f32],
    ) -> Result<(), BaselineError> {
        let device = device_of(&self.actor);
        let start = Start::new(batch, &self.form, &device)?;
        let (steps, dim) = (batch.pixels.steps, self.form.action);
        if steps > self.history || actions.len() != batch.pixels.rows * dim {
            let reason = format!(
                "{steps} observations and room for {} values; this policy takes up to {} and gives {dim} per environment",
                actions.len(),
                self.history
            );
            return Err(BaselineError::data("pixels", reason));
        }
        // One by one on a CPU: the bits of a decision must not depend on its neighbors.
        let most = match Placement::of(&device) {
            Placement::Host => 1,
            Placement::Device => batch.pixels.rows.max(1),
        };
        let groups = actions.chunks_mut(most * dim).enumerate().collect();
        for_each_group(&device, groups, |(index, out): (usize, &mut [f32])| {
            let (first, rows) = (index * most, out.len() / dim);
            let of_rows =
                |state: &Option<Tensor<3>>| state.as_ref().map(|state| state.clone().narrow(0, first, rows));
            let frames = start.pixels.clone().narrow(0, first, rows);
            let frames = self.observer.tokens(frames, of_rows(&start.proprio));
            let goal = start.goal_pixels.clone().narrow(0, first, rows);
            let goal = self.observer.tokens(goal, of_rows(&start.goal_proprio));
            let means = self.actor.forward(frames, goal, &mut Pass::evaluate());
            out.copy_from_slice(&host(means.narrow(1, steps - 1, 1)));
        });
        Ok(())
    }
}
