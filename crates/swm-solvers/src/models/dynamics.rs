//! Models that roll out whole batches of plans: what a learned world model implements.

use std::ops::Range;

use serde_json::{Map, Value as Json};

use super::control_cost::{Tape, steps_of};
use crate::context::PlanningContext;
use crate::control::{ControlModel, Stage};
use crate::error::PlanError;
use crate::problem::Candidates;
use crate::steps::StateSteps;

/// A model that predicts states (usually embeddings) of W values, one after every block of a plan.
///
/// A prediction depends on its own episode and plan only, never on others in the batch.
pub trait Dynamics: Send + Sync {
    /// Once per plan: encodes observations and goals. Neither changes while a plan is made, so neither is encoded again.
    ///
    /// # Errors
    ///
    /// The context lacks a column that the model needs, or the model fails.
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError>;

    /// The named parts of a state, in ascending order and without gaps; W is where the last one ends.
    fn parts(&self) -> &[Part];

    /// `[W]`: the goal of `episode`, as a state.
    fn goal(&self, episode: usize) -> &[f32];

    /// Fills `states`, `[B, S, H, W]`: what is predicted after each block of `candidates`, `[B, S, H, D]`.
    ///
    /// # Errors
    ///
    /// The model fails.
    fn roll_out(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), PlanError>;

    /// Whether [`Dynamics::pull_back`] works.
    fn has_gradients(&self) -> bool {
        false
    }

    /// Adds to `gradient`, `[B, S, H, D]`, the vector-Jacobian product of `by_state`, `[B, S, H, W]`: the derivative of
    /// Σ by_state × state with respect to the plans. `candidates` and `states` are those of the last rollout.
    ///
    /// # Errors
    ///
    /// [`PlanError::NoGradient`] unless it is implemented, or the model fails.
    fn pull_back(
        &mut self,
        candidates: &Candidates<'_>,
        states: &[f32],
        by_state: &[f32],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        let _ = (candidates, states, by_state, gradient);
        Err(PlanError::NoGradient { solver: "the objective" })
    }

    /// As [`Cost::action_dim`](crate::Cost::action_dim).
    fn action_dim(&self) -> Option<usize> {
        None
    }

    /// Single steps from any state, if it has them: GRASP needs them.
    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        None
    }

    /// What descriptions of a planner call it, as settings: `model`.
    fn changed_settings(&self) -> Map<String, Json> {
        Map::new()
    }
}

/// A named part of a state: `pixels_emb`, `proprio_emb`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// Its range in the state.
    pub range: Range<usize>,
}

/// W: values of a state with these parts.
pub(super) fn state_dim(parts: &[Part]) -> usize {
    parts.last().map_or(0, |part| part.range.end)
}

/// A [`ControlModel`] as [`Dynamics`]: its states without its cost, for objectives of another kind. One candidate after
/// another: meant for tests and small problems.
pub struct Stepwise<M> {
    pub(super) model: M,
    /// `[n][W]`.
    goals: Vec<Vec<f32>>,
    parts: [Part; 1],
    pub(super) tape: Tape,
}

impl<M: ControlModel> Stepwise<M> {
    /// The states of `model`, in one part named `state`; episode `b` has the goal `goals[b % n]`.
    ///
    /// # Errors
    ///
    /// [`PlanError::Size`]: no goals, or one of another dimension than a state.
    pub fn new(model: M, goals: Vec<Vec<f32>>) -> Result<Self, PlanError> {
        let dim = model.state_dim();
        if goals.is_empty() {
            return Err(PlanError::Size { name: "goals", expected: 1, found: 0 });
        }
        if let Some(goal) = goals.iter().find(|goal| goal.len() != dim) {
            return Err(PlanError::Size { name: "goal", expected: dim, found: goal.len() });
        }
        Ok(Self {
            model,
            goals,
            parts: [Part { name: "state".to_owned(), range: 0..dim }],
            tape: Tape::default(),
        })
    }
}

impl<M: ControlModel> Dynamics for Stepwise<M> {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.model.prepare(context)
    }

    fn parts(&self) -> &[Part] {
        &self.parts
    }

    fn goal(&self, episode: usize) -> &[f32] {
        &self.goals[episode % self.goals.len()]
    }

    fn roll_out(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), PlanError> {
        let Self { model, tape, .. } = self;
        let steps = steps_of(model, candidates)?;
        let (dim, block) = (model.state_dim(), candidates.dim / model.action_dim());
        let paths = states.chunks_exact_mut(candidates.horizon * dim);
        for (index, (plan, path)) in candidates.plans().zip(paths).enumerate() {
            let episode = index / candidates.samples;
            tape.forward(model, episode, steps, plan);
            for (count, state) in (1..).zip(path.chunks_exact_mut(dim)) {
                let predicted = tape.stage(model, episode, count * block).state;
                state.iter_mut().zip(predicted).for_each(|(out, &value)| *out = value as f32);
            }
        }
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        true
    }

    fn action_dim(&self) -> Option<usize> {
        Some(self.model.action_dim())
    }

    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        Some(self)
    }

    fn pull_back(
        &mut self,
        candidates: &Candidates<'_>,
        _states: &[f32],
        by_state: &[f32],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        let Self { model, tape, .. } = self;
        let steps = steps_of(model, candidates)?;
        let (dim, block) = (model.state_dim(), candidates.dim / model.action_dim());
        let paths = by_state.chunks_exact(candidates.horizon * dim);
        let gradients = gradient.chunks_exact_mut(candidates.horizon * candidates.dim);
        for (index, ((plan, by_state), gradient)) in candidates.plans().zip(paths).zip(gradients).enumerate()
        {
            let linear = Linear { model, by_state, block };
            let episode = index / candidates.samples;
            tape.forward(&linear, episode, steps, plan);
            tape.add_backward(&linear, episode, gradient);
        }
        Ok(())
    }
}

/// A model with another cost: Σ by_state × state over the states after each block. The gradient of that is the
/// vector-Jacobian product of its states.
struct Linear<'a, M> {
    model: &'a M,
    /// `[H, W]`.
    by_state: &'a [f32],
    /// k.
    block: usize,
}

impl<M: ControlModel> ControlModel for Linear<'_, M> {
    fn state_dim(&self) -> usize {
        self.model.state_dim()
    }

    fn action_dim(&self) -> usize {
        self.model.action_dim()
    }

    fn start(&self, episode: usize, state: &mut [f64]) {
        self.model.start(episode, state);
    }

    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        self.model.step(at, next);
    }

    fn cost(&self, _at: &Stage<'_>) -> f64 {
        0.0
    }

    fn step_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        self.model.step_derivatives(at, by_state, by_action)
    }

    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        by_action.fill(0.0);
        by_state.fill(0.0);
        if at.step > 0 && at.step.is_multiple_of(self.block) {
            let start = (at.step / self.block - 1) * by_state.len();
            let values = &self.by_state[start..][..by_state.len()];
            by_state.iter_mut().zip(values).for_each(|(out, &value)| *out = value.into());
        }
        true
    }
}
