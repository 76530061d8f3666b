//! Dynamics, objective and constraints together: one rollout of the candidates, then its cost.

use serde_json::{Map, Value as Json};

use super::dynamics::{Dynamics, state_dim};
use super::objective::{Constraint, Objective, Path};
use super::outputs::{for_each, scratch_for};
use crate::context::PlanningContext;
use crate::cost::{Cost, Outputs};
use crate::error::PlanError;
use crate::problem::Candidates;
use crate::steps::StateSteps;

/// The cost of plans by the prediction of a model.
///
/// Observation and goal are encoded once per plan. Costs, constraints and the seed of the gradient come from one
/// rollout of all candidates, whose states, `[B, S, H, W]`, are kept in memory meanwhile.
pub struct ShootingCost<D> {
    dynamics: D,
    objective: Box<dyn Objective>,
    constraints: Vec<Box<dyn Constraint>>,
    /// `[B, S, H, W]`: predicted states, and derivatives with respect to them.
    states: Vec<f32>,
    by_state: Vec<f32>,
    /// Weights of the constraints, per thread.
    weights: Vec<Vec<f64>>,
}

impl<D: Dynamics> ShootingCost<D> {
    /// Plans that `dynamics` predicts, judged by `objective` under `constraints`.
    ///
    /// # Errors
    ///
    /// The objective or a constraint names a part that the states of `dynamics` do not have.
    pub fn new(
        dynamics: D,
        mut objective: Box<dyn Objective>,
        mut constraints: Vec<Box<dyn Constraint>>,
    ) -> Result<Self, PlanError> {
        objective.bind(dynamics.parts())?;
        constraints.iter_mut().try_for_each(|constraint| constraint.bind(dynamics.parts()))?;
        let (states, by_state, weights) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { dynamics, objective, constraints, states, by_state, weights })
    }

    /// The model.
    pub fn dynamics(&self) -> &D {
        &self.dynamics
    }
}

/// Objective and constraints of a path.
struct Terms<'a> {
    objective: &'a dyn Objective,
    constraints: &'a [Box<dyn Constraint>],
    candidates: &'a Candidates<'a>,
}

impl Terms<'_> {
    /// Writes the requested outputs of candidate `index`; `scratch` is for weights.
    fn write(
        &self,
        index: usize,
        path: &Path<'_>,
        scratch: &mut Vec<f64>,
        (outputs, by_state): (Outputs<'_>, &mut [f32]),
    ) {
        let Outputs { costs, mut gradient, constraints: values, weights } = outputs;
        costs.fill(self.objective.cost(path));
        if let Some(gradient) = gradient.as_deref_mut() {
            self.objective.add_derivatives(path, 1.0, by_state, gradient);
        }
        let Some(values) = values else { return };
        let mut rest = &mut *values;
        for constraint in self.constraints {
            let (own, others) = rest.split_at_mut(self.count(constraint.as_ref()));
            constraint.values(path, own);
            rest = others;
        }
        let (Some(gradient), Some(weights_of)) = (gradient, weights) else { return };
        scratch.resize(values.len(), 0.0);
        weights_of(index, values, scratch);
        let mut rest = scratch.as_slice();
        for constraint in self.constraints {
            let (own, others) = rest.split_at(self.count(constraint.as_ref()));
            constraint.add_derivatives(path, own, by_state, gradient);
            rest = others;
        }
    }

    fn count(&self, constraint: &dyn Constraint) -> usize {
        constraint.count(self.candidates.horizon, self.candidates.dim)
    }
}

impl<D: Dynamics> Cost for ShootingCost<D> {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.dynamics.prepare(context)
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        if outputs.gradient.is_some() && !self.has_gradients() {
            return Err(PlanError::NoGradient { solver: "the solver" });
        }
        let Self { dynamics, objective, constraints, states, by_state, weights } = self;
        let (dim, count) = (state_dim(dynamics.parts()), outputs.costs.len());
        states.resize(count * candidates.horizon * dim, 0.0);
        dynamics.roll_out(candidates, states)?;
        by_state.clear();
        if let Some(gradient) = &mut outputs.gradient {
            by_state.resize(states.len(), 0.0);
            gradient.fill(0.0);
        }
        {
            let (dynamics, size) = (&*dynamics, candidates.horizon * dim);
            let (scratch, share) = (scratch_for(weights, count), (outputs.reborrow(), &mut by_state[..]));
            for_each(scratch, 0, share, &|weights: &mut Vec<f64>, index, share| {
                let path = Path {
                    dim,
                    states: &states[index * size..][..size],
                    actions: candidates.plan(index),
                    goal: dynamics.goal(index / candidates.samples),
                };
                let terms = Terms { objective: objective.as_ref(), constraints, candidates };
                terms.write(index, &path, weights, share);
            });
        }
        match &mut outputs.gradient {
            Some(gradient) => dynamics.pull_back(candidates, states, by_state, gradient),
            None => Ok(()),
        }
    }

    /// Whether the model and all that judges its states have derivatives.
    fn has_gradients(&self) -> bool {
        self.dynamics.has_gradients()
            && self.objective.has_derivatives()
            && self.constraints.iter().all(|constraint| constraint.has_derivatives())
    }

    fn constraints(&self, horizon: usize, dim: usize) -> usize {
        self.constraints.iter().map(|constraint| constraint.count(horizon, dim)).sum()
    }

    fn action_dim(&self) -> Option<usize> {
        self.dynamics.action_dim()
    }

    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        self.dynamics.steps()
    }

    fn changed_settings(&self) -> Map<String, Json> {
        let mut settings = self.dynamics.changed_settings();
        settings.extend(self.objective.changed_settings());
        settings
    }
}
