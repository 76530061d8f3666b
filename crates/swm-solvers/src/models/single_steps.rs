//! Single steps of a control model: each block from a state of its own.

use super::control_cost::steps_of;
use super::dynamics::{Dynamics as _, Stepwise};
use crate::control::{ControlModel, Stage};
use crate::error::PlanError;
use crate::steps::{StateSteps, StepBatch};

impl<M: ControlModel> StateSteps for Stepwise<M> {
    fn state_dim(&mut self) -> usize {
        self.model.state_dim()
    }

    fn ends(&mut self, starts: &mut [f32], goals: &mut [f32]) -> Result<(), PlanError> {
        let dim = self.model.state_dim();
        let mut state = vec![0.0; dim];
        for (episode, (start, goal)) in
            starts.chunks_exact_mut(dim).zip(goals.chunks_exact_mut(dim)).enumerate()
        {
            self.model.start(episode, &mut state);
            start.iter_mut().zip(&state).for_each(|(out, &value)| *out = value as f32);
            goal.copy_from_slice(self.goal(episode));
        }
        Ok(())
    }

    fn step_toward(
        &mut self,
        steps: &StepBatch<'_>,
        next: &mut [f32],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        let Self { model, tape, .. } = self;
        let StepBatch { candidates, states, targets } = steps;
        steps_of(model, candidates)?;
        let (dim, per_plan) = (model.state_dim(), candidates.samples * candidates.horizon);
        let taken = candidates.dim / model.action_dim();
        gradient.fill(0.0);
        let ends = states.chunks_exact(dim).zip(targets.chunks_exact(dim)).zip(next.chunks_exact_mut(dim));
        let blocks =
            candidates.actions.chunks_exact(candidates.dim).zip(gradient.chunks_exact_mut(candidates.dim));
        for (index, (((state, target), next), (block, gradient))) in ends.zip(blocks).enumerate() {
            let (episode, first) = (index / per_plan, index % candidates.horizon * taken);
            let toward = Toward { model, state, target, first };
            tape.forward(&toward, episode, taken, block);
            let reached = tape.stage(&toward, episode, taken).state;
            next.iter_mut().zip(reached).for_each(|(out, &value)| *out = value as f32);
            tape.add_backward(&toward, episode, gradient);
        }
        Ok(())
    }
}

/// A model from another start, for one block, whose cost is the square of the distance of its last state from a target.
struct Toward<'a, M> {
    model: &'a M,
    /// `[W]` each.
    state: &'a [f32],
    target: &'a [f32],
    /// The step of the plan that the block begins with.
    first: usize,
}

impl<M> Toward<'_, M> {
    /// A stage as the model counts it.
    fn of_plan<'s>(&self, at: &Stage<'s>) -> Stage<'s> {
        Stage { step: self.first + at.step, ..*at }
    }

    /// How far the state is off, value by value.
    fn off<'s>(&'s self, at: &'s Stage<'_>) -> impl Iterator<Item = f64> + 's {
        at.state.iter().zip(self.target).map(|(value, &target)| value - f64::from(target))
    }
}

impl<M: ControlModel> ControlModel for Toward<'_, M> {
    fn state_dim(&self) -> usize {
        self.model.state_dim()
    }

    fn action_dim(&self) -> usize {
        self.model.action_dim()
    }

    fn start(&self, _episode: usize, state: &mut [f64]) {
        state.iter_mut().zip(self.state).for_each(|(out, &value)| *out = value.into());
    }

    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        self.model.step(&self.of_plan(at), next);
    }

    fn cost(&self, at: &Stage<'_>) -> f64 {
        if at.is_last() { self.off(at).map(|off| off * off).sum() } else { 0.0 }
    }

    fn step_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        self.model.step_derivatives(&self.of_plan(at), by_state, by_action)
    }

    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        by_action.fill(0.0);
        by_state.fill(0.0);
        if at.is_last() {
            by_state.iter_mut().zip(self.off(at)).for_each(|(out, off)| *out = 2.0 * off);
        }
        true
    }
}
