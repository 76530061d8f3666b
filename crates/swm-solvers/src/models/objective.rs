//! Objectives and constraints on predicted states. How states are predicted is the part of [`Dynamics`].
//!
//! [`Dynamics`]: super::Dynamics

use std::ops::Range;

use serde_json::{Map, Value as Json};

use super::dynamics::Part;
use crate::error::PlanError;

/// A plan and its predicted states.
#[derive(Clone, Copy, Debug)]
pub struct Path<'a> {
    /// W: values of a state.
    pub dim: usize,
    /// `[H, W]`: the state after each block.
    pub states: &'a [f32],
    /// `[H, D]`: the plan.
    pub actions: &'a [f32],
    /// `[W]`: the goal.
    pub goal: &'a [f32],
}

/// The cost of a path; lower is better.
pub trait Objective: Send + Sync {
    /// Once, before anything else: looks up the parts of a state that it needs.
    ///
    /// # Errors
    ///
    /// The states lack a part that it needs.
    fn bind(&mut self, parts: &[Part]) -> Result<(), PlanError> {
        let _ = parts;
        Ok(())
    }

    /// The cost.
    fn cost(&self, path: &Path<'_>) -> f64;

    /// Settings that differ from their defaults, for reports.
    fn changed_settings(&self) -> Map<String, Json> {
        Map::new()
    }

    /// Whether it has derivatives: [`Objective::add_derivatives`] is implemented. Sampling solvers need none.
    fn has_derivatives(&self) -> bool {
        false
    }

    /// Adds `weight` times the derivative of the cost with respect to the states, `[H, W]`, and to the actions, `[H, D]`. Called
    /// only where there are [derivatives](Objective::has_derivatives).
    fn add_derivatives(&self, path: &Path<'_>, weight: f64, by_state: &mut [f32], by_action: &mut [f32]) {
        let _ = (path, weight, by_state, by_action);
    }
}

/// Constraints on a path: values that must be 0 or less.
pub trait Constraint: Send + Sync {
    /// As [`Objective::bind`].
    ///
    /// # Errors
    ///
    /// As of [`Objective::bind`].
    fn bind(&mut self, parts: &[Part]) -> Result<(), PlanError> {
        let _ = parts;
        Ok(())
    }

    /// How many values a path of H = `horizon` blocks of D = `dim` values has.
    fn count(&self, horizon: usize, dim: usize) -> usize;

    /// Writes them.
    fn values(&self, path: &Path<'_>, values: &mut [f64]);

    /// As [`Objective::has_derivatives`].
    fn has_derivatives(&self) -> bool {
        false
    }

    /// Adds the derivative of Σ weight × value with respect to the states, `[H, W]`, and to the actions, `[H, D]`. Called only
    /// where there are [derivatives](Constraint::has_derivatives).
    fn add_derivatives(&self, path: &Path<'_>, weights: &[f64], by_state: &mut [f32], by_action: &mut [f32]) {
        let _ = (path, weights, by_state, by_action);
    }
}

/// Which states count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Steps {
    /// The last one, as in the reference.
    #[default]
    Last,
    /// All of them.
    All,
}

/// How many squares become one cost. Solvers that weight costs by a temperature notice the difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reduction {
    /// Their sum.
    #[default]
    Sum,
    /// Their mean.
    Mean,
}

/// The squared distance to the goal.
#[derive(Clone, Debug, Default)]
pub struct GoalMse {
    parts: Vec<String>,
    steps: Steps,
    reduction: Reduction,
    ranges: Vec<Range<usize>>,
}

impl GoalMse {
    /// Of the named parts of a state; of all of it if none is named.
    pub fn new(parts: &[&str], steps: Steps, reduction: Reduction) -> Self {
        let parts = parts.iter().map(|&part| part.to_owned()).collect();
        Self { parts, steps, reduction, ranges: Vec::new() }
    }

    /// Calls `visit(position in the states, goal)` for every value that counts.
    fn for_each(&self, path: &Path<'_>, mut visit: impl FnMut(usize, f32)) {
        let horizon = path.states.len() / path.dim;
        let first = if self.steps == Steps::Last { horizon.saturating_sub(1) } else { 0 };
        for step in first..horizon {
            for range in &self.ranges {
                for index in range.clone() {
                    visit(step * path.dim + index, path.goal[index]);
                }
            }
        }
    }

    fn scale(&self, path: &Path<'_>) -> f64 {
        let states = if self.steps == Steps::Last { 1 } else { path.states.len() / path.dim };
        let values: usize = self.ranges.iter().map(ExactSizeIterator::len).sum();
        match self.reduction {
            Reduction::Sum => 1.0,
            Reduction::Mean => 1.0 / (states * values) as f64,
        }
    }
}

impl Objective for GoalMse {
    fn bind(&mut self, parts: &[Part]) -> Result<(), PlanError> {
        self.ranges.clear();
        for name in &self.parts {
            self.ranges.push(find(parts, name)?);
        }
        if self.parts.is_empty() {
            self.ranges.extend(parts.iter().map(|part| part.range.clone()));
        }
        Ok(())
    }

    fn cost(&self, path: &Path<'_>) -> f64 {
        let mut sum = 0.0;
        self.for_each(path, |index, goal| {
            let difference = f64::from(path.states[index] - goal);
            sum += difference * difference;
        });
        sum * self.scale(path)
    }

    fn has_derivatives(&self) -> bool {
        true
    }

    fn add_derivatives(&self, path: &Path<'_>, weight: f64, by_state: &mut [f32], _by_action: &mut [f32]) {
        let factor = (2.0 * weight * self.scale(path)) as f32;
        self.for_each(path, |index, goal| by_state[index] += factor * (path.states[index] - goal));
    }
}

/// The part called `name`.
fn find(parts: &[Part], name: &str) -> Result<Range<usize>, PlanError> {
    let known = || parts.iter().map(|part| part.name.as_str()).collect::<Vec<_>>().join(", ");
    let part = parts.iter().find(|part| part.name == name);
    let unknown = || PlanError::setting("parts", format!("the model has no `{name}`; it has {}", known()));
    part.map(|part| part.range.clone()).ok_or_else(unknown)
}

/// The sum of all squared actions, in the units of the plan.
#[derive(Clone, Copy, Debug, Default)]
pub struct ControlPenalty;

impl Objective for ControlPenalty {
    fn cost(&self, path: &Path<'_>) -> f64 {
        path.actions.iter().map(|&u| f64::from(u) * f64::from(u)).sum()
    }

    fn has_derivatives(&self) -> bool {
        true
    }

    fn add_derivatives(&self, path: &Path<'_>, weight: f64, _by_state: &mut [f32], by_action: &mut [f32]) {
        let factor = (2.0 * weight) as f32;
        by_action.iter_mut().zip(path.actions).for_each(|(sum, u)| *sum += factor * u);
    }
}

/// Several objectives, each with a weight.
pub struct WeightedSum(Vec<(f64, Box<dyn Objective>)>);

impl WeightedSum {
    /// At least one, with finite weights.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: no terms, or a weight that is not finite.
    pub fn new(terms: Vec<(f64, Box<dyn Objective>)>) -> Result<Self, PlanError> {
        if terms.is_empty() {
            return Err(PlanError::setting("objective", "a sum of no terms; give one or more"));
        }
        if let Some((weight, _)) = terms.iter().find(|(weight, _)| !weight.is_finite()) {
            return Err(PlanError::setting("objective", format!("a weight of {weight} is not a number")));
        }
        Ok(Self(terms))
    }
}

impl Objective for WeightedSum {
    fn bind(&mut self, parts: &[Part]) -> Result<(), PlanError> {
        self.0.iter_mut().try_for_each(|(_, term)| term.bind(parts))
    }

    fn cost(&self, path: &Path<'_>) -> f64 {
        self.0.iter().map(|(weight, term)| weight * term.cost(path)).sum()
    }

    fn has_derivatives(&self) -> bool {
        self.0.iter().all(|(_, term)| term.has_derivatives())
    }

    fn add_derivatives(&self, path: &Path<'_>, weight: f64, by_state: &mut [f32], by_action: &mut [f32]) {
        for (own, term) in &self.0 {
            term.add_derivatives(path, weight * own, by_state, by_action);
        }
    }
}

/// A ball that a part of the state must avoid: radius² - distance² at every step.
#[derive(Clone, Debug)]
pub struct KeepAway {
    part: String,
    center: Vec<f32>,
    radius: f64,
    range: Range<usize>,
}

impl KeepAway {
    /// The ball around `center`, which has the dimension of the part.
    pub fn new(part: &str, center: &[f32], radius: f64) -> Self {
        Self { part: part.to_owned(), center: center.to_vec(), radius, range: 0..0 }
    }

    fn part_of<'s>(&self, state: &'s [f32]) -> &'s [f32] {
        &state[self.range.clone()]
    }
}

impl Constraint for KeepAway {
    fn bind(&mut self, parts: &[Part]) -> Result<(), PlanError> {
        self.range = find(parts, &self.part)?;
        let (expected, found) = (self.range.len(), self.center.len());
        if expected == found { Ok(()) } else { Err(PlanError::Size { name: "center", expected, found }) }
    }

    fn count(&self, horizon: usize, _dim: usize) -> usize {
        horizon
    }

    fn values(&self, path: &Path<'_>, values: &mut [f64]) {
        for (value, state) in values.iter_mut().zip(path.states.chunks_exact(path.dim)) {
            let squares = self.part_of(state).iter().zip(&self.center).map(|(a, b)| f64::from(a - b).powi(2));
            *value = self.radius * self.radius - squares.sum::<f64>();
        }
    }

    fn has_derivatives(&self) -> bool {
        true
    }

    fn add_derivatives(
        &self,
        path: &Path<'_>,
        weights: &[f64],
        by_state: &mut [f32],
        _by_action: &mut [f32],
    ) {
        let states = path.states.chunks_exact(path.dim).zip(by_state.chunks_exact_mut(path.dim));
        for ((state, by_state), weight) in states.zip(weights) {
            let pairs = self.part_of(state).iter().zip(&self.center);
            for (sum, (a, b)) in by_state[self.range.clone()].iter_mut().zip(pairs) {
                *sum -= 2.0 * *weight as f32 * (a - b);
            }
        }
    }
}
