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

    /// Fills `outputs` for `candidates`, `[B, S, H, D]`: the costs, and in the same pass the gradient and the constraints where
    /// they are requested. Episode `b` is environment `b` of the prepared context. A cost that is not finite marks a
    /// candidate as unusable: solvers treat it as infinite and report how many there were. Whatever else is requested, the costs
    /// have the same bits.
    ///
    /// # Errors
    ///
    /// The model fails. A bad candidate is no error.
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError>;

    /// Fills `initial`, `[B, H, D]`, with plans of H = `horizon` blocks from what was prepared, at which the search may begin in the
    /// place of the rest of the last plan. `false`: it has none, and `initial` stays as it is.
    ///
    /// # Errors
    ///
    /// The model fails.
    fn propose(&mut self, _horizon: usize, _initial: &mut [f32]) -> Result<bool, PlanError> {
        Ok(false)
    }

    /// Whether [`Cost::evaluate`] fills [`Outputs::gradient`]. Gradient solvers need it and request it of no other cost.
    fn has_gradients(&self) -> bool {
        false
    }

    /// C: how many inequality constraints g plans of H = `horizon` blocks of D = `dim` values have. A plan is feasible when
    /// every g is 0 or less; an equality is two of them. [`Outputs::constraints`] is requested only where there are some.
    fn constraints(&self, horizon: usize, dim: usize) -> usize {
        let _ = (horizon, dim);
        0
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

/// The results of an evaluation: the costs and, where they are requested, gradient and constraints.
/// `Outputs::new(&mut costs)` requests the costs alone, `Outputs { gradient: Some(&mut gradient), ..Outputs::new(&mut costs) }` the gradient, too.
pub struct Outputs<'a> {
    /// `[B, S]`.
    pub costs: &'a mut [f64],
    /// `[B, S, H, D]`: the derivative of each candidate's cost + Σ w g with respect to its own actions. It is overwritten.
    pub gradient: Option<&'a mut [f32]>,
    /// `[B, S, C]`: the values g of the [constraints](Cost::constraints).
    pub constraints: Option<&'a mut [f64]>,
    /// The weights w in the gradient, computed from the values g of each candidate; `None`: the gradient is that of the cost alone. It has no
    /// effect unless both gradient and constraints are requested. One rollout forward and one backward suffice, whatever C is.
    pub weights: Option<&'a WeightFn<'a>>,
}

impl<'a> Outputs<'a> {
    /// The costs alone.
    pub fn new(costs: &'a mut [f64]) -> Self {
        Self { costs, gradient: None, constraints: None, weights: None }
    }

    /// The same outputs for a shorter time.
    pub(crate) fn reborrow(&mut self) -> Outputs<'_> {
        Outputs {
            costs: self.costs,
            gradient: self.gradient.as_deref_mut(),
            constraints: self.constraints.as_deref_mut(),
            weights: self.weights,
        }
    }
}

/// Writes the weights `[C]` of the constraints of candidate `index` of `0..B × S` from their values `[C]`:
/// `weights(index, values, out)`.
pub type WeightFn<'a> = dyn Fn(usize, &[f64], &mut [f64]) + Sync + 'a;

/// Refuses a cost without gradients, in the name of `solver`.
pub(crate) fn check_gradients(cost: &dyn Cost, solver: &'static str) -> Result<(), PlanError> {
    if cost.has_gradients() { Ok(()) } else { Err(PlanError::NoGradient { solver }) }
}
