//! A solver for tests of costs: it evaluates given plans and records the results.

use std::sync::{Arc, Mutex, PoisonError};

use serde_json::{Map, Value as Json};
use swm_core::Space;

use crate::cost::{Cost, Outputs};
use crate::error::PlanError;
use crate::problem::{Plan, Problem};
use crate::solver::Solver;
use crate::trace::Trace;
use crate::workspace::Workspace;

/// Evaluates the same plans for every episode, with and without gradients.
pub struct Probe {
    plans: Vec<f32>,
    samples: usize,
    result: Arc<Mutex<ProbeResult>>,
}

/// The costs of the plans of a [`Probe`].
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ProbeResult {
    /// `[S]`: without gradients.
    pub costs: Vec<f64>,
    /// `[S]`: with them; they must equal `costs`.
    pub costs_with_gradient: Vec<f64>,
    /// `[S, H, D]`.
    pub gradient: Vec<f32>,
}

impl Probe {
    /// For plans `[S, H, D]`, and the results of the last evaluation.
    pub fn new(plans: Vec<f32>, samples: usize) -> (Self, Arc<Mutex<ProbeResult>>) {
        let result = Arc::default();
        (Self { plans, samples, result: Arc::clone(&result) }, result)
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
        let mut result = ProbeResult {
            costs: vec![f64::NAN; self.samples],
            costs_with_gradient: vec![f64::NAN; self.samples],
            gradient: vec![f32::NAN; self.plans.len()],
        };
        cost.evaluate(&candidates, &mut Outputs::new(&mut result.costs))?;
        if cost.has_gradients() {
            let gradient = Some(&mut result.gradient[..]);
            cost.evaluate(
                &candidates,
                &mut Outputs { gradient, ..Outputs::new(&mut result.costs_with_gradient) },
            )?;
        }
        *self.result.lock().unwrap_or_else(PoisonError::into_inner) = result;
        plan.begin(problem, 0.0);
        Ok(())
    }
}
