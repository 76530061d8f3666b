//! Systems that are known step by step: state, action, next state, cost. Not learned models, which roll out whole
//! batches of plans ([`super::Dynamics`]).

use crate::error::PlanError;
use crate::mpc::Moment;

/// A moment of a roll-out of T actions.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// The episode: row `b` of the problem.
    pub row: usize,
    /// t of `0..=T`.
    pub step: usize,
    /// `[W]`: the state.
    pub state: &'a [f64],
    /// `[A]`: the action taken from it; empty at the end, where t = T.
    pub action: &'a [f64],
}

impl Stage<'_> {
    /// Whether the roll-out ends here: no action is taken any more.
    pub fn is_last(&self) -> bool {
        self.action.is_empty()
    }
}

/// A system with states of W numbers, actions of A numbers, and a cost that is a sum over its stages.
///
/// Derivatives are optional, one by one: a method that returns `false` has written nothing, and
/// [`super::ControlCost`] and iLQR take finite differences instead.
pub trait ControlModel: Send + Sync {
    /// W.
    fn state_width(&self) -> usize;

    /// A.
    fn action_width(&self) -> usize;

    /// Once per plan: learns where every row starts. Problems that stand for themselves need nothing.
    ///
    /// # Errors
    ///
    /// The moment lacks a column that the model needs, or the model fails.
    fn prepare(&mut self, moment: &Moment<'_>) -> Result<(), PlanError> {
        let _ = moment;
        Ok(())
    }

    /// Writes the state, `[W]`, in which episode `row` starts.
    fn start(&self, row: usize, state: &mut [f64]);

    /// Writes the state, `[W]`, after the action of `at`.
    fn step(&self, at: &Stage<'_>, next: &mut [f64]);

    /// The cost of a stage: of its state, and of its action if there is one.
    fn cost(&self, at: &Stage<'_>) -> f64;

    /// The derivatives of [`ControlModel::step`] with respect to the state, `[W, W]`, and to the action, `[W, A]`.
    fn step_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        let _ = (at, by_state, by_action);
        false
    }

    /// The derivatives of [`ControlModel::cost`] with respect to the state, `[W]`, and to the action, `[A]` (nothing at
    /// the end).
    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        let _ = (at, by_state, by_action);
        false
    }

    /// The second derivatives of [`ControlModel::cost`] with respect to state and action together:
    /// `[W + A, W + A]`, at the end `[W, W]`.
    fn cost_hessian(&self, at: &Stage<'_>, hessian: &mut [f64]) -> bool {
        let _ = (at, hessian);
        false
    }

    /// How many constraints every step has; a roll-out of T actions has T times as many.
    fn constraints(&self) -> usize {
        0
    }

    /// Writes the constraints of a step: functions of its action and of the state `next` that it led to, 0 or less
    /// where they are met.
    fn constrain(&self, row: usize, action: &[f64], next: &[f64], values: &mut [f64]) {
        let _ = (row, action, next, values);
    }

    /// Adds the derivatives of Σ weight × constraint to `by_next`, `[W]`, and `by_action`, `[A]`. Must be there if
    /// there are constraints.
    fn add_constraint_derivatives(
        &self,
        row: usize,
        action: &[f64],
        next: &[f64],
        weights: &[f64],
        by_next: &mut [f64],
        by_action: &mut [f64],
    ) {
        let _ = (row, action, next, weights, by_next, by_action);
    }
}
