//! A control model as a cost: rollouts in parallel, gradients by the adjoint recursion, constraints in the same
//! rollout.

use super::differences::Differentiator;
use super::outputs::{Outputs, for_each, scratch_for};
use crate::context::PlanningContext;
use crate::control::{ControlModel, Stage};
use crate::cost::{ConstrainedCost, Cost, DifferentiableCost, WeightFn};
use crate::error::PlanError;
use crate::problem::Candidates;

/// The cost of plans for a [`ControlModel`]: the sum of its stages. A plan `[H, D]` is T = H × D / A actions of A
/// values: blocks of several actions where the problem asks for them
/// ([`Problem::action_block`](crate::Problem::action_block)). Action spaces of another size than A are refused.
///
/// It has gradients (by finite differences where the model gives no derivatives) and the model's constraints, so that every solver
/// takes it. The crate's first program plans with one.
pub struct ControlCost<M> {
    /// The model; between plans, write the measured state into it.
    pub model: M,
    tapes: Vec<Tape>,
}

impl<M: ControlModel> ControlCost<M> {
    /// The cost of `model`.
    pub fn new(model: M) -> Self {
        Self { model, tapes: Vec::new() }
    }

    /// Rolls all candidates out, several at a time.
    fn run(
        &mut self,
        candidates: &Candidates<'_>,
        weights_of: Option<&WeightFn<'_>>,
        outputs: Outputs<'_>,
    ) -> Result<(), PlanError> {
        let Self { model, tapes } = self;
        let steps = steps_of(model, candidates)?;
        let tapes = scratch_for(tapes, outputs.costs.len());
        for_each(tapes, 0, outputs, &|tape: &mut Tape, index, outputs| {
            let episode = index / candidates.samples;
            for cost in outputs.costs {
                *cost = tape.forward(model, episode, steps, candidates.plan(index));
            }
            tape.weights.clear();
            if !outputs.values.is_empty() {
                tape.constrain(model, episode, outputs.values);
                if let Some(weights_of) = weights_of {
                    tape.weights.resize(outputs.values.len(), 0.0);
                    weights_of(index, outputs.values, &mut tape.weights);
                }
            }
            if !outputs.gradient.is_empty() {
                outputs.gradient.fill(0.0);
                tape.add_backward(model, episode, outputs.gradient);
            }
        });
        Ok(())
    }
}

/// T, the actions of a plan; an error if a plan does not consist of actions of `model`.
pub(crate) fn steps_of(
    model: &(impl ControlModel + ?Sized),
    candidates: &Candidates<'_>,
) -> Result<usize, PlanError> {
    let (dim, action) = (candidates.dim, model.action_dim());
    if action == 0 || !dim.is_multiple_of(action) || dim == 0 {
        return Err(PlanError::BlockSize { block: dim, action });
    }
    Ok(candidates.horizon * (dim / action))
}

impl<M: ControlModel> Cost for ControlCost<M> {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.model.prepare(context)
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        self.run(candidates, None, Outputs { costs, ..Outputs::default() })
    }

    fn differentiable(&mut self) -> Option<&mut dyn DifferentiableCost> {
        Some(self)
    }

    fn constrained(&mut self) -> Option<&mut dyn ConstrainedCost> {
        if self.model.constraints() > 0 { Some(self) } else { None }
    }

    fn control(&self) -> Option<&dyn ControlModel> {
        Some(&self.model)
    }
}

impl<M: ControlModel> DifferentiableCost for ControlCost<M> {
    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        self.run(candidates, None, Outputs { costs, gradient, ..Outputs::default() })
    }
}

impl<M: ControlModel> ConstrainedCost for ControlCost<M> {
    fn constraints(&mut self, horizon: usize, dim: usize) -> usize {
        horizon * (dim / self.model.action_dim().max(1)) * self.model.constraints()
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
        self.run(candidates, Some(weights_of), Outputs { costs, values, gradient, ..Outputs::default() })
    }
}

/// The rollout of one candidate, and scratch for its derivatives.
#[derive(Debug, Default)]
pub(super) struct Tape {
    /// `[T + 1, W]`.
    states: Vec<f64>,
    /// `[T, A]`.
    actions: Vec<f64>,
    /// `[C]`: weights of the constraints; empty if they have no part in the gradient.
    weights: Vec<f64>,
    /// `[W, W]` and `[W, A]`.
    step_by_state: Vec<f64>,
    step_by_action: Vec<f64>,
    /// `[W]` each: derivative of all later costs with respect to the state, after and before a step.
    adjoint: Vec<f64>,
    earlier: Vec<f64>,
    /// `[A]`.
    by_action: Vec<f64>,
    /// For derivatives that the model does not give.
    differences: Vec<f64>,
    /// `[2, constraints of a step]`, for those of constraints.
    values: Vec<f64>,
}

impl Tape {
    /// The cost of executing `plan`, `[T, A]`, in `episode`.
    pub(super) fn forward(
        &mut self,
        model: &dyn ControlModel,
        episode: usize,
        steps: usize,
        plan: &[f32],
    ) -> f64 {
        let (w, a) = (model.state_dim(), model.action_dim());
        self.states.resize((steps + 1) * w, 0.0);
        self.actions.clear();
        self.actions.extend(plan.iter().map(|&value| f64::from(value)));
        model.start(episode, &mut self.states[..w]);
        let mut sum = 0.0;
        for (step, action) in self.actions.chunks_exact(a).enumerate() {
            let (past, future) = self.states.split_at_mut((step + 1) * w);
            let at = Stage { episode, step, state: &past[step * w..], action };
            sum += model.cost(&at);
            model.step(&at, &mut future[..w]);
        }
        sum + model.cost(&self.stage(model, episode, steps))
    }

    /// Stage `step` of `0..=T` of the last rollout.
    pub(super) fn stage(&self, model: &dyn ControlModel, episode: usize, step: usize) -> Stage<'_> {
        let (w, a) = (model.state_dim(), model.action_dim());
        let action = self.actions.get(step * a..(step + 1) * a).unwrap_or(&[]);
        Stage { episode, step, state: &self.states[step * w..][..w], action }
    }

    /// The constraints of the last rollout: `[C]`.
    fn constrain(&self, model: &dyn ControlModel, episode: usize, values: &mut [f64]) {
        let (w, a) = (model.state_dim(), model.action_dim());
        let moves = self.actions.chunks_exact(a).zip(self.states.chunks_exact(w).skip(1));
        for ((action, next), values) in moves.zip(values.chunks_exact_mut(model.constraints())) {
            model.constrain(episode, action, next, values);
        }
    }

    /// Adds the gradient of the last rollout to `gradient`, `[T, A]`.
    pub(super) fn add_backward(&mut self, model: &dyn ControlModel, episode: usize, gradient: &mut [f32]) {
        let (w, a, c) = (model.state_dim(), model.action_dim(), model.constraints());
        self.step_by_state.resize(w * w, 0.0);
        self.step_by_action.resize(w * a, 0.0);
        self.adjoint.resize(w, 0.0);
        self.earlier.resize(w, 0.0);
        self.by_action.resize(a, 0.0);
        let Self { states, actions, weights, step_by_state, step_by_action, .. } = self;
        let Self { adjoint, earlier, by_action, differences, values, .. } = self;
        values.resize(2 * c, 0.0);
        differences.resize(Differentiator::scratch_size(w + a), 0.0);
        let mut differentiator = Differentiator::new(differences);
        let steps = actions.len() / a;
        let end = Stage { episode, step: steps, state: &states[steps * w..], action: &[] };
        differentiator.cost(model, &end, adjoint, &mut []);
        for step in (0..steps).rev() {
            let (state, next) = states[step * w..][..2 * w].split_at(w);
            let at = Stage { episode, step, state, action: &actions[step * a..][..a] };
            differentiator.cost(model, &at, earlier, by_action);
            if !weights.is_empty() {
                let weights = &weights[step * c..][..c];
                let leads_to = Stage { state: next, ..at };
                differentiator.add_constraints(
                    model,
                    &leads_to,
                    weights,
                    values,
                    (&mut adjoint[..], &mut by_action[..]),
                );
            }
            differentiator.step(model, &at, step_by_state, step_by_action);
            for (adjoint, (by_state, with_action)) in
                adjoint.iter().zip(step_by_state.chunks_exact(w).zip(step_by_action.chunks_exact(a)))
            {
                earlier.iter_mut().zip(by_state).for_each(|(sum, value)| *sum += adjoint * value);
                by_action.iter_mut().zip(with_action).for_each(|(sum, value)| *sum += adjoint * value);
            }
            gradient[step * a..][..a]
                .iter_mut()
                .zip(&*by_action)
                .for_each(|(out, &value)| *out += value as f32);
            std::mem::swap(adjoint, earlier);
        }
    }
}
