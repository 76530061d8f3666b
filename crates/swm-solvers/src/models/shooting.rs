//! Dynamics, objective and constraints together: one rollout of the candidates, then its cost.

use serde_json::{Map, Value as Json};

use super::dynamics::{Dynamics, state_dim};
use super::objective::{Constraint, Objective, Path};
use super::outputs::{Outputs, for_each, scratch_for};
use crate::context::PlanningContext;
use crate::cost::{ConstrainedCost, Cost, DifferentiableCost, WeightFn};
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

    /// Whether the model and all that judges its states have derivatives.
    fn has_gradients(&self) -> bool {
        self.dynamics.has_gradients()
            && self.objective.has_derivatives()
            && self.constraints.iter().all(|constraint| constraint.has_derivatives())
    }

    /// The model.
    pub fn dynamics(&self) -> &D {
        &self.dynamics
    }

    fn run(
        &mut self,
        candidates: &Candidates<'_>,
        weights_of: Option<&WeightFn<'_>>,
        outputs: Outputs<'_>,
    ) -> Result<(), PlanError> {
        let Self { dynamics, objective, constraints, states, by_state, weights } = self;
        let Outputs { costs, values, gradient, .. } = outputs;
        let (dim, count) = (state_dim(dynamics.parts()), costs.len());
        states.resize(count * candidates.horizon * dim, 0.0);
        dynamics.roll_out(candidates, states)?;
        by_state.clear();
        if !gradient.is_empty() {
            by_state.resize(states.len(), 0.0);
            gradient.fill(0.0);
        }
        {
            let (dynamics, size) = (&*dynamics, candidates.horizon * dim);
            let outputs = Outputs { costs, values, gradient: &mut *gradient, by_state };
            for_each(scratch_for(weights, count), 0, outputs, &|weights: &mut Vec<f64>, index, outputs| {
                let path = Path {
                    dim,
                    states: &states[index * size..][..size],
                    actions: candidates.plan(index),
                    goal: dynamics.goal(index / candidates.samples),
                };
                let terms = Terms { objective: objective.as_ref(), constraints, candidates };
                terms.write(index, &path, weights_of, weights, outputs);
            });
        }
        if !gradient.is_empty() {
            dynamics.pull_back(candidates, states, by_state, gradient)?;
        }
        Ok(())
    }
}

/// Objective and constraints of a path.
struct Terms<'a> {
    objective: &'a dyn Objective,
    constraints: &'a [Box<dyn Constraint>],
    candidates: &'a Candidates<'a>,
}

impl Terms<'_> {
    /// Writes the requested outputs of candidate `index`.
    fn write(
        &self,
        index: usize,
        path: &Path<'_>,
        weights_of: Option<&WeightFn<'_>>,
        weights: &mut Vec<f64>,
        outputs: Outputs<'_>,
    ) {
        let Outputs { costs, values, gradient, by_state } = outputs;
        costs.fill(self.objective.cost(path));
        if !values.is_empty() {
            let mut rest = &mut *values;
            for constraint in self.constraints {
                let (own, others) = rest.split_at_mut(self.count(constraint.as_ref()));
                constraint.values(path, own);
                rest = others;
            }
        }
        if gradient.is_empty() {
            return;
        }
        self.objective.add_derivatives(path, 1.0, by_state, gradient);
        if let (Some(weights_of), false) = (weights_of, values.is_empty()) {
            weights.resize(values.len(), 0.0);
            weights_of(index, values, weights);
            let mut rest = weights.as_slice();
            for constraint in self.constraints {
                let (own, others) = rest.split_at(self.count(constraint.as_ref()));
                constraint.add_derivatives(path, own, by_state, gradient);
                rest = others;
            }
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

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        self.run(candidates, None, Outputs { costs, ..Outputs::default() })
    }

    fn action_dim(&self) -> Option<usize> {
        self.dynamics.action_dim()
    }

    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        self.dynamics.steps()
    }

    fn differentiable(&mut self) -> Option<&mut dyn DifferentiableCost> {
        if self.has_gradients() { Some(self) } else { None }
    }

    fn constrained(&mut self) -> Option<&mut dyn ConstrainedCost> {
        if self.constraints.is_empty() { None } else { Some(self) }
    }

    fn changed_settings(&self) -> Map<String, Json> {
        let mut settings = self.dynamics.changed_settings();
        settings.extend(self.objective.changed_settings());
        settings
    }
}

impl<D: Dynamics> DifferentiableCost for ShootingCost<D> {
    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        self.run(candidates, None, Outputs { costs, gradient, ..Outputs::default() })
    }
}

impl<D: Dynamics> ConstrainedCost for ShootingCost<D> {
    fn constraints(&mut self, horizon: usize, dim: usize) -> usize {
        self.constraints.iter().map(|constraint| constraint.count(horizon, dim)).sum()
    }

    fn evaluate_constrained(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        values: &mut [f64],
    ) -> Result<(), PlanError> {
        self.run(candidates, None, Outputs { costs, values, ..Outputs::default() })
    }

    fn evaluate_constrained_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        weights_of: &WeightFn<'_>,
        costs: &mut [f64],
        values: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        if !self.has_gradients() {
            return Err(PlanError::NoGradient { solver: "the solver" });
        }
        self.run(candidates, Some(weights_of), Outputs { costs, values, gradient, ..Outputs::default() })
    }
}
