//! A control model as a cost: roll-outs in parallel, gradients by the adjoint recursion, constraints in the same
//! roll-out.

use super::control::{ControlModel, Stage};
use super::differences::Differentiator;
use super::outputs::{Outputs, for_each, scratch_for};
use crate::cost::{Candidates, ConstrainedCost, Cost, DifferentiableCost, Weigh};
use crate::error::PlanError;
use crate::mpc::Moment;

/// The cost of plans for a [`ControlModel`]: the sum of its stages. A plan `[H, D]` is T = H × D / A actions of A
/// numbers.
pub struct ControlCost<M> {
    /// The model.
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
        weigh: Option<&Weigh<'_>>,
        outputs: Outputs<'_>,
    ) -> Result<(), PlanError> {
        let Self { model, tapes } = self;
        let steps = check_width(model, candidates)?;
        let tapes = scratch_for(tapes, outputs.costs.len());
        for_each(tapes, 0, outputs, &|tape: &mut Tape, index, outputs| {
            let row = index / candidates.samples;
            for cost in outputs.costs {
                *cost = tape.forward(model, row, steps, candidates.plan(index));
            }
            tape.weights.clear();
            if !outputs.values.is_empty() {
                tape.constrain(model, row, outputs.values);
                if let Some(weigh) = weigh {
                    tape.weights.resize(outputs.values.len(), 0.0);
                    weigh(index, outputs.values, &mut tape.weights);
                }
            }
            if !outputs.gradient.is_empty() {
                outputs.gradient.fill(0.0);
                tape.add_backward(model, row, outputs.gradient);
            }
        });
        Ok(())
    }
}

/// T, the actions of a plan; an error if a plan is not made of actions that `model` knows.
pub(crate) fn check_width(
    model: &(impl ControlModel + ?Sized),
    candidates: &Candidates<'_>,
) -> Result<usize, PlanError> {
    let (width, action) = (candidates.width, model.action_width());
    if action == 0 || !width.is_multiple_of(action) || width == 0 {
        return Err(PlanError::Size { name: "numbers per block", expected: action, found: width });
    }
    Ok(candidates.horizon * (width / action))
}

impl<M: ControlModel> Cost for ControlCost<M> {
    fn prepare(&mut self, moment: &Moment<'_>) -> Result<(), PlanError> {
        self.model.prepare(moment)
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
    fn constraints(&self, horizon: usize, width: usize) -> usize {
        horizon * (width / self.model.action_width().max(1)) * self.model.constraints()
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
        weigh: &Weigh<'_>,
        costs: &mut [f64],
        values: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        self.run(candidates, Some(weigh), Outputs { costs, values, gradient, ..Outputs::default() })
    }
}

/// The roll-out of one candidate, and room for its derivatives.
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
}

impl Tape {
    /// The cost of carrying `plan`, `[T, A]`, out in episode `row`.
    pub(super) fn forward(
        &mut self,
        model: &dyn ControlModel,
        row: usize,
        steps: usize,
        plan: &[f32],
    ) -> f64 {
        let (w, a) = (model.state_width(), model.action_width());
        self.states.resize((steps + 1) * w, 0.0);
        self.actions.clear();
        self.actions.extend(plan.iter().map(|&value| f64::from(value)));
        model.start(row, &mut self.states[..w]);
        let mut sum = 0.0;
        for (step, action) in self.actions.chunks_exact(a).enumerate() {
            let (past, future) = self.states.split_at_mut((step + 1) * w);
            let at = Stage { row, step, state: &past[step * w..], action };
            sum += model.cost(&at);
            model.step(&at, &mut future[..w]);
        }
        sum + model.cost(&self.stage(model, row, steps))
    }

    /// Stage `step` of `0..=T` of the last roll-out.
    pub(super) fn stage(&self, model: &dyn ControlModel, row: usize, step: usize) -> Stage<'_> {
        let (w, a) = (model.state_width(), model.action_width());
        let action = self.actions.get(step * a..(step + 1) * a).unwrap_or(&[]);
        Stage { row, step, state: &self.states[step * w..][..w], action }
    }

    /// The constraints of the last roll-out: `[C]`.
    fn constrain(&self, model: &dyn ControlModel, row: usize, values: &mut [f64]) {
        let (w, a) = (model.state_width(), model.action_width());
        let moves = self.actions.chunks_exact(a).zip(self.states.chunks_exact(w).skip(1));
        for ((action, next), values) in moves.zip(values.chunks_exact_mut(model.constraints())) {
            model.constrain(row, action, next, values);
        }
    }

    /// Adds the gradient of the last roll-out to `gradient`, `[T, A]`.
    pub(super) fn add_backward(&mut self, model: &dyn ControlModel, row: usize, gradient: &mut [f32]) {
        let (w, a, c) = (model.state_width(), model.action_width(), model.constraints());
        self.step_by_state.resize(w * w, 0.0);
        self.step_by_action.resize(w * a, 0.0);
        self.adjoint.resize(w, 0.0);
        self.earlier.resize(w, 0.0);
        self.by_action.resize(a, 0.0);
        let Self { states, actions, weights, step_by_state, step_by_action, .. } = self;
        let Self { adjoint, earlier, by_action, differences, .. } = self;
        differences.resize(Differentiator::scratch_size(w + a), 0.0);
        let mut differentiator = Differentiator::new(differences);
        let steps = actions.len() / a;
        let end = Stage { row, step: steps, state: &states[steps * w..], action: &[] };
        differentiator.cost(model, &end, adjoint, &mut []);
        for step in (0..steps).rev() {
            let (state, next) = states[step * w..][..2 * w].split_at(w);
            let at = Stage { row, step, state, action: &actions[step * a..][..a] };
            differentiator.cost(model, &at, earlier, by_action);
            if !weights.is_empty() {
                let weights = &weights[step * c..][..c];
                model.add_constraint_derivatives(row, at.action, next, weights, adjoint, by_action);
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
