//! What a planner minimizes.

use serde_json::{Map, Value as Json};

use crate::context::PlanningContext;
use crate::control::ControlModel;
use crate::error::PlanError;
use crate::problem::Candidates;
use crate::steps::StateSteps;

/// How good candidate plans are; lower is better.
///
/// Costs are `f64`: simulators and analytic problems sum in it, and models that compute in `f32` lose nothing.
/// The cost of a candidate depends on its episode and its own actions only, never on other candidates, on
/// earlier calls or on threads: this keeps plans independent of how many are made together.
pub trait Cost: Send {
    /// Once per plan: reads where all candidates start. Encode observations and goals here; by default it reads nothing.
    /// [`crate::MpcPolicy`] and [`crate::Mpc`] call it; a solver that is called directly works on what was prepared last.
    ///
    /// # Errors
    ///
    /// The context lacks a column that the cost needs, or its model fails.
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let _ = context;
        Ok(())
    }

    /// Fills `costs`, `[B, S]`, with the costs of `candidates`, `[B, S, H, D]`. Episode `b` is environment `b` of
    /// the prepared context. A cost that is not finite marks a candidate as unusable: solvers treat it as
    /// infinite and report how many there were.
    ///
    /// # Errors
    ///
    /// The model fails. A bad candidate is no error.
    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError>;

    /// Fills `initial`, `[B, H, D]`, with plans of H = `horizon` blocks from what was prepared, at which the search may begin in the
    /// place of the rest of the last plan. `false`: it has none, and `initial` stays as it is.
    ///
    /// # Errors
    ///
    /// The model fails.
    fn propose(&mut self, _horizon: usize, _initial: &mut [f32]) -> Result<bool, PlanError> {
        Ok(false)
    }

    /// This cost with gradients, if it has them: gradient solvers need it.
    fn differentiable(&mut self) -> Option<&mut dyn DifferentiableCost> {
        None
    }

    /// This cost with constraints, if it has any.
    fn constrained(&mut self) -> Option<&mut dyn ConstrainedCost> {
        None
    }

    /// The step-by-step model behind this cost, if there is one: iLQR needs it.
    fn control(&self) -> Option<&dyn ControlModel> {
        None
    }

    /// A: how many values of a plan are one action of the model behind this cost, where that is fixed: that of
    /// [`Cost::control`], unless it is implemented. Solvers refuse action spaces of another size.
    fn action_dim(&self) -> Option<usize> {
        self.control().map(ControlModel::action_dim)
    }

    /// Single steps of the model behind this cost, if it has them: GRASP needs them.
    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        None
    }

    /// The step fields that [`PlanningContext::history`] holds; read before the first plan.
    fn history_fields(&self) -> Vec<String> {
        Vec::new()
    }

    /// Settings that differ from their defaults, for reports.
    fn changed_settings(&self) -> Map<String, Json> {
        Map::new()
    }
}

/// A cost with a gradient with respect to the actions.
pub trait DifferentiableCost: Cost {
    /// Fills `costs`, `[B, S]`, and `gradient`, `[B, S, H, D]`: the derivative of each candidate's cost with respect
    /// to its own actions. Costs are those of [`Cost::evaluate`].
    ///
    /// # Errors
    ///
    /// As of [`Cost::evaluate`].
    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError>;
}

/// A cost with C inequality constraints g: a plan is feasible when every g is 0 or less. An equality is two of them.
pub trait ConstrainedCost: Cost {
    /// C, for plans of H = `horizon` blocks of D = `dim` values.
    fn constraints(&mut self, horizon: usize, dim: usize) -> usize;

    /// Fills `costs`, `[B, S]`, and `values`, `[B, S, C]`, in one rollout.
    ///
    /// # Errors
    ///
    /// As of [`Cost::evaluate`].
    fn evaluate_constrained(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        values: &mut [f64],
    ) -> Result<(), PlanError>;

    /// As [`ConstrainedCost::evaluate_constrained`], and fills `gradient`, `[B, S, H, D]`, with the derivative of
    /// cost + Σ w g, where `weights_of` computes the weights w from the values g of a candidate. One rollout
    /// forward and one backward, whatever C is.
    ///
    /// # Errors
    ///
    /// [`PlanError::NoGradient`], and those of [`Cost::evaluate`].
    fn evaluate_constrained_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        weights_of: &WeightFn<'_>,
        costs: &mut [f64],
        values: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError>;
}

/// Writes the weights `[C]` of the constraints of candidate `index` of `0..B × S` from their values `[C]`:
/// `weights_of(index, values, weights)`.
pub type WeightFn<'a> = dyn Fn(usize, &[f64], &mut [f64]) + Sync + 'a;
