//! A solver for tests of costs: it asks for what it is given, writes down what it hears, and plans nothing.

use std::sync::{Arc, Mutex, PoisonError};

use serde_json::{Map, Value as Json};
use swm_core::Space;

use crate::cost::Cost;
use crate::error::PlanError;
use crate::solver::{Plan, Problem, Solver};
use crate::trace::Trace;
use crate::workspace::Workspace;

/// Evaluates the same plans for every episode, with and without gradients.
pub struct Probe {
    plans: Vec<f32>,
    samples: usize,
    heard: Arc<Mutex<Heard>>,
}

/// What a cost said of the plans of a [`Probe`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heard {
    /// `[S]`: without gradients.
    pub costs: Vec<f64>,
    /// `[S]`: with them; both are the same numbers, or the cost contradicts itself.
    pub costs_with_gradient: Vec<f64>,
    /// `[S, H, D]`.
    pub gradient: Vec<f32>,
}

impl Probe {
    /// For plans `[S, H, D]`, and where the answers to the last question will stand.
    pub fn new(plans: Vec<f32>, samples: usize) -> (Self, Arc<Mutex<Heard>>) {
        let heard = Arc::default();
        (Self { plans, samples, heard: Arc::clone(&heard) }, heard)
    }
}

impl Solver for Probe {
    fn name(&self) -> &'static str {
        "probe"
    }

    fn changed_settings(&self) -> Map<String, Json> {
        Map::new()
    }

    fn check(&self, _space: &Space) -> Result<(), PlanError> {
        Ok(())
    }

    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        _workspace: &mut Workspace,
        _trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let candidates = problem.candidates(&self.plans, self.samples);
        let mut heard = Heard {
            costs: vec![f64::NAN; self.samples],
            costs_with_gradient: vec![f64::NAN; self.samples],
            gradient: vec![f32::NAN; self.plans.len()],
        };
        cost.evaluate(&candidates, &mut heard.costs)?;
        if let Some(slopes) = cost.differentiable() {
            slopes.evaluate_with_gradient(
                &candidates,
                &mut heard.costs_with_gradient,
                &mut heard.gradient,
            )?;
        }
        *self.heard.lock().unwrap_or_else(PoisonError::into_inner) = heard;
        plan.begin(problem, 0.0);
        Ok(())
    }
}
