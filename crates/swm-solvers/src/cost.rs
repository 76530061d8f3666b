//! What a planner minimizes. Knows slices of numbers, not what computes them.

use serde_json::{Map, Value as Json};

use crate::error::PlanError;
use crate::models::ControlModel;
use crate::mpc::Moment;

/// How good candidate plans are; lower is better.
///
/// Costs are `f64`: simulators and analytic problems add up in it, and models that compute in `f32` lose nothing.
/// The cost of a candidate may depend on its episode and its own numbers only, never on its neighbors, on
/// earlier calls or on threads; that is what keeps plans independent of how many are made together.
pub trait Cost: Send {
    /// Once per plan: learns the moment that all candidates start from. Encode observations and goals here.
    /// [`crate::MpcPolicy`] calls it; a solver that is called directly works on whatever was prepared last.
    ///
    /// # Errors
    ///
    /// The moment lacks a column that the cost needs, or its model fails.
    fn prepare(&mut self, moment: &Moment<'_>) -> Result<(), PlanError>;

    /// Fills `costs`, `[B, S]`, with the costs of `candidates`, `[B, S, H, D]`. Row `b` belongs to row `b` of
    /// the prepared moment. A cost that is not finite marks a candidate as unusable: solvers count it as
    /// infinite and say how many there were.
    ///
    /// # Errors
    ///
    /// The model fails. A candidate that is merely bad is none.
    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError>;

    /// This cost with gradients, if it has them: what [`crate::SOLVERS`] of the gradient kind need.
    fn differentiable(&mut self) -> Option<&mut dyn DifferentiableCost> {
        None
    }

    /// This cost with constraints, if it has any.
    fn constrained(&mut self) -> Option<&mut dyn ConstrainedCost> {
        None
    }

    /// The problem behind this cost step by step, if it is one that can be known so: what iLQR needs.
    fn control(&self) -> Option<&dyn ControlModel> {
        None
    }

    /// The step fields whose past [`Moment::history`] shall hold; read once, when the policy is made.
    fn history_fields(&self) -> Vec<String> {
        Vec::new()
    }

    /// Settings that differ from their defaults, for reports.
    fn changed_settings(&self) -> Map<String, Json> {
        Map::new()
    }
}

/// A cost that knows how it changes with the actions.
pub trait DifferentiableCost: Cost {
    /// Fills `costs`, `[B, S]`, and `gradient`, `[B, S, H, D]`: the derivative of each candidate's cost with respect
    /// to its own numbers. Candidates do not interact. Costs are those of [`Cost::evaluate`].
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
    /// C, for plans of H = `horizon` blocks of D = `width` numbers.
    fn constraints(&self, horizon: usize, width: usize) -> usize;

    /// Fills `costs`, `[B, S]`, and `values`, `[B, S, C]`, in one roll-out.
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
    /// cost + Σ w g, where `weigh` chooses the weights w once the values g of a candidate are known. One roll-out
    /// forward and one back, whatever C is.
    ///
    /// # Errors
    ///
    /// [`PlanError::NoGradient`], and those of [`Cost::evaluate`].
    fn evaluate_constrained_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        weigh: &Weigh<'_>,
        costs: &mut [f64],
        values: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError>;
}

/// Writes the weights `[C]` of the constraints of candidate `index` of `0..B × S` from their values `[C]`:
/// `weigh(index, values, weights)`.
pub type Weigh<'a> = dyn Fn(usize, &[f64], &mut [f64]) + Sync + 'a;

/// A batch of candidate plans: `[B, S, H, D]`, row-major.
#[derive(Clone, Copy, Debug)]
pub struct Candidates<'a> {
    /// The numbers.
    pub actions: &'a [f32],
    /// B: episodes.
    pub rows: usize,
    /// S: candidates of each episode.
    pub samples: usize,
    /// H: blocks of each candidate.
    pub horizon: usize,
    /// D: numbers of each block.
    pub width: usize,
}

impl<'a> Candidates<'a> {
    /// `[B, S, H, D]`.
    pub fn shape(&self) -> [usize; 4] {
        [self.rows, self.samples, self.horizon, self.width]
    }

    /// All plans, `[H, D]` each, in the order of the costs.
    pub fn plans(&self) -> std::slice::ChunksExact<'a, f32> {
        self.actions.chunks_exact(self.horizon * self.width)
    }

    /// Plan `index` of `0..B × S`: `[H, D]`.
    pub fn plan(&self, index: usize) -> &'a [f32] {
        let size = self.horizon * self.width;
        &self.actions[index * size..][..size]
    }
}
