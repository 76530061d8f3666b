//! Systems that are known step by step: state, action, next state, cost. Learned models, which roll out whole batches of
//! plans, are [`crate::models::Dynamics`].

use crate::context::PlanningContext;
use crate::error::PlanError;

/// One stage of a rollout of T actions.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// The episode: `b` of `0..B`.
    pub episode: usize,
    /// t of `0..=T`.
    pub step: usize,
    /// `[W]`: the state.
    pub state: &'a [f64],
    /// `[A]`: the action taken from it; empty at the end, where t = T.
    pub action: &'a [f64],
}

impl Stage<'_> {
    /// Whether the rollout ends here: no action is taken.
    pub fn is_last(&self) -> bool {
        self.action.is_empty()
    }
}

/// A system with states of W values, actions of A values, and a cost that is a sum over its stages. In a
/// [`ControlCost`](crate::models::ControlCost), every solver plans with it.
///
/// Required are `state_dim`, `action_dim`, `start`, `step` and `cost`. Actions have the units of the plan: those of the action space,
/// unless plans are scaled. A rollout calls `step` for T actions and `cost` for T + 1 stages; the last one has no action:
///
/// ```
/// # use swm_solvers::models::Stage;
/// fn cost(at: &Stage<'_>) -> f64 {
///     let effort: f64 = at.action.iter().map(|value| value * value).sum(); // 0 at the end, where `at.action[0]` would panic
///     (at.state[0] - 1.0).powi(2) + 0.01 * effort
/// }
/// # assert_eq!(cost(&Stage { episode: 0, step: 5, state: &[0.0], action: &[] }), 1.0);
/// ```
///
/// Derivatives are optional, each of them: where a method returns `false`, [`crate::models::ControlCost`] and iLQR use
/// finite differences instead.
pub trait ControlModel: Send + Sync {
    /// W.
    fn state_dim(&self) -> usize;

    /// A.
    fn action_dim(&self) -> usize;

    /// Once per plan: reads where every episode starts. By default it does nothing.
    ///
    /// # Errors
    ///
    /// The context lacks a column that the model needs, or the model fails.
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let _ = context;
        Ok(())
    }

    /// Writes the state, `[W]`, in which `episode` starts: the present state, which the model holds or has read in
    /// [`prepare`](ControlModel::prepare). [`crate::Mpc`] plans one episode, number 0.
    fn start(&self, episode: usize, state: &mut [f64]);

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

    /// How many constraints every step has; a rollout of T actions has T times as many.
    fn constraints(&self) -> usize {
        0
    }

    /// Writes the constraints of a step: functions of its action and of the state `next` that it leads to, 0 or less
    /// where they are met.
    fn constrain(&self, episode: usize, action: &[f64], next: &[f64], values: &mut [f64]) {
        let _ = (episode, action, next, values);
    }

    /// Adds the derivatives of Σ weight × constraint to `by_next`, `[W]`, and `by_action`, `[A]`. A model that returns `false`
    /// adds nothing.
    fn add_constraint_derivatives(
        &self,
        episode: usize,
        action: &[f64],
        next: &[f64],
        weights: &[f64],
        by_next: &mut [f64],
        by_action: &mut [f64],
    ) -> bool {
        let _ = (episode, action, next, weights, by_next, by_action);
        false
    }
}
