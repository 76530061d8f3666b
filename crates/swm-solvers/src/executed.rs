//! The cost of plans as they are executed: clipped to the bounds of the actions before the cost sees them, by the map that
//! [`crate::MpcPolicy`] executes them with. Solvers search without bounds unless they are told to clip.

use std::sync::Arc;

use serde_json::{Map, Value as Json};

use crate::context::{ActionMap, PlanningContext};
use crate::control::ControlModel;
use crate::cost::{Cost, Outputs};
use crate::error::PlanError;
use crate::problem::Candidates;
use crate::steps::{StateSteps, StepBatch};

/// A cost whose candidates are clipped first. Where the policy does not clip, it is the cost itself.
pub struct AsExecuted {
    cost: Box<dyn Cost>,
    /// Of the last context.
    map: Option<Arc<ActionMap>>,
    /// `[B, S, H, D]`.
    clipped: Vec<f32>,
}

impl AsExecuted {
    /// The cost of what the policy executes; the map comes with each planning context.
    pub(crate) fn new(cost: Box<dyn Cost>) -> Self {
        Self { cost, map: None, clipped: Vec::new() }
    }

    /// The cost of what `map` executes, for solvers that are called without a policy.
    pub fn with_map(cost: Box<dyn Cost>, map: Arc<ActionMap>) -> Self {
        Self { cost, map: Some(map), clipped: Vec::new() }
    }

    /// The cost, and the candidates as they are executed.
    fn split<'a>(&'a mut self, candidates: &Candidates<'a>) -> (&'a mut dyn Cost, Candidates<'a>) {
        let Self { cost, map, clipped } = self;
        let Some(map) = map.as_deref().filter(|map| map.clips()) else { return (cost.as_mut(), *candidates) };
        clipped.resize(candidates.actions.len(), 0.0);
        let dim = map.dim();
        for (planned, out) in candidates.actions.chunks_exact(dim).zip(clipped.chunks_exact_mut(dim)) {
            map.executed(planned, out);
        }
        (cost.as_mut(), Candidates { actions: clipped, ..*candidates })
    }
}

/// Nothing that lies behind a bound changes the cost.
fn zero_behind_bounds(planned: &Candidates<'_>, executed: &Candidates<'_>, gradient: &mut [f32]) {
    for ((planned, executed), slope) in planned.actions.iter().zip(executed.actions).zip(gradient) {
        if planned != executed {
            *slope = 0.0;
        }
    }
}

impl Cost for AsExecuted {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.map = Some(Arc::clone(context.actions()));
        self.cost.prepare(context)
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let (cost, executed) = self.split(candidates);
        cost.evaluate(&executed, outputs)?;
        if let Some(gradient) = &mut outputs.gradient {
            zero_behind_bounds(candidates, &executed, gradient);
        }
        Ok(())
    }

    fn propose(&mut self, horizon: usize, initial: &mut [f32]) -> Result<bool, PlanError> {
        self.cost.propose(horizon, initial)
    }

    fn has_gradients(&self) -> bool {
        self.cost.has_gradients()
    }

    fn constraints(&self, horizon: usize, dim: usize) -> usize {
        self.cost.constraints(horizon, dim)
    }

    fn control(&self) -> Option<&dyn ControlModel> {
        self.cost.control()
    }

    fn action_dim(&self) -> Option<usize> {
        self.cost.action_dim()
    }

    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        self.cost.steps().is_some().then_some(self as &mut dyn StateSteps)
    }

    fn history_fields(&self) -> Vec<String> {
        self.cost.history_fields()
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.cost.changed_settings()
    }
}

/// Of single steps of a cost that has none; solvers look first.
fn no_steps() -> PlanError {
    PlanError::NoSteps { solver: "the solver" }
}

impl StateSteps for AsExecuted {
    fn state_dim(&mut self) -> usize {
        self.cost.steps().map_or(0, StateSteps::state_dim)
    }

    fn ends(&mut self, starts: &mut [f32], goals: &mut [f32]) -> Result<(), PlanError> {
        self.cost.steps().ok_or_else(no_steps)?.ends(starts, goals)
    }

    fn step_toward(
        &mut self,
        steps: &StepBatch<'_>,
        next: &mut [f32],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        let (cost, executed) = self.split(&steps.candidates);
        let executed_steps = StepBatch { candidates: executed, ..*steps };
        cost.steps().ok_or_else(no_steps)?.step_toward(&executed_steps, next, gradient)?;
        zero_behind_bounds(&steps.candidates, &executed, gradient);
        Ok(())
    }
}
