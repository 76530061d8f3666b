//! Costs that are Python objects.
//!
//! A solver's loop runs in Rust, detached from Python, on the thread that called it. Every evaluation attaches on that
//! thread, where torch's modes (`inference_mode`, autocast) and OpenMP team are the caller's. Python gets its candidates
//! in a new array each time, so it may keep them.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{Element, PyArray1, PyArray4, PyArrayDyn, PyArrayMethods as _};
use pyo3::intern;
use pyo3::prelude::*;
use swm::solvers::{Candidates, Cost, Iteration, Outputs, Plan, PlanError, Problem, Trace};

use crate::arrays::c_slice;
use crate::errors::PlanFault;

/// The exception of a callback, until the cost can return it: a trace has no way to fail.
#[derive(Clone, Default)]
pub(crate) struct Failure(Arc<Mutex<Option<PyErr>>>);

impl Failure {
    pub(crate) fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn set(&self, error: PyErr) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
    }
}

/// The cost behind `planning/solver/_bridge.py`, whose methods it calls.
pub(crate) struct PythonCost {
    pub(crate) bridge: Py<PyAny>,
    /// Whether Python computes gradients.
    pub(crate) has_gradient: bool,
    /// C: how many constraints Python computes.
    pub(crate) constraints: usize,
    /// How many evaluations without gradient Python is still asked for. Solvers end with an evaluation of the plan itself,
    /// which costs a pass of the model and which callers of Python do not see: it is left out, and is NaN.
    pub(crate) evaluations: usize,
    pub(crate) failure: Failure,
}

impl PythonCost {
    /// Calls a method of the bridge, with candidates first; Ctrl-C is looked at afterwards.
    fn call<T>(
        &self,
        candidates: &Candidates<'_>,
        call: impl FnOnce(Python<'_>, &Bound<'_, PyAny>, Bound<'_, PyArray4<f32>>) -> PyResult<T>,
    ) -> Result<T, PlanError> {
        if let Some(error) = self.failure.take() {
            return Err(PlanError::Cost(Box::new(error)));
        }
        Python::attach(|py| {
            let array = PyArray1::from_slice(py, candidates.actions).reshape(candidates.shape())?;
            let value = call(py, self.bridge.bind(py), array)?;
            py.check_signals()?;
            Ok(value)
        })
        .map_err(|error: PyErr| PlanError::Cost(Box::new(error)))
    }
}

impl Cost for PythonCost {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, constraints, weights } = outputs;
        if gradient.is_none() && constraints.is_none() {
            if self.evaluations == 0 {
                costs.fill(f64::NAN);
                return Ok(());
            }
            self.evaluations -= 1;
        }
        let count = self.constraints;
        self.call(candidates, |py, bridge, array| {
            let Some(values) = constraints else {
                let Some(gradient) = gradient else {
                    return read(&bridge.call_method1(intern!(py, "evaluate"), (array,))?, "costs", costs);
                };
                let [first, second] = pair(&bridge.call_method1(intern!(py, "differentiate"), (array,))?)?;
                read(&first, "costs", costs)?;
                return read(&second, "the gradient", gradient);
            };
            let arguments = (array, gradient.is_some());
            let [first, second] = pair(&bridge.call_method1(intern!(py, "constrain"), arguments)?)?;
            read(&first, "costs", costs)?;
            read(&second, "constraints", values)?;
            let Some(gradient) = gradient else { return Ok(()) };
            let mut all = vec![0.0; values.len()];
            if let Some(weights_of) = weights {
                let each = values.chunks_exact(count).zip(all.chunks_exact_mut(count)).enumerate();
                each.for_each(|(index, (values, weights))| weights_of(index, values, weights));
            }
            let weights = PyArray1::from_vec(py, all);
            read(&bridge.call_method1(intern!(py, "pull_back"), (weights,))?, "the gradient", gradient)
        })
    }

    fn has_gradients(&self) -> bool {
        self.has_gradient
    }

    fn constraints(&self, _horizon: usize, _dim: usize) -> usize {
        self.constraints
    }
}

/// Both values of a pair.
fn pair<'py>(value: &Bound<'py, PyAny>) -> PyResult<[Bound<'py, PyAny>; 2]> {
    let (first, second) = value.extract()?;
    Ok([first, second])
}

/// Copies the values of a C-contiguous array of the bridge.
fn read<T: Element + Copy>(array: &Bound<'_, PyAny>, what: &str, out: &mut [T]) -> PyResult<()> {
    let array = array.cast::<PyArrayDyn<T>>()?.try_readonly()?;
    let wrong = || PlanFault::new_err(format!("{what}: the values are not in the order of C"));
    let values = c_slice(&array).ok_or_else(wrong)?;
    if values.len() != out.len() {
        let (found, expected) = (values.len(), out.len());
        return Err(PlanFault::new_err(format!(
            "the cost returned {found} values as {what}, not {expected}"
        )));
    }
    out.copy_from_slice(values);
    Ok(())
}

/// Shows iterations to the bridge, for callbacks, and keeps the last mean of the search distribution.
pub(crate) struct PythonTrace {
    /// The bridge, if there are callbacks.
    pub(crate) bridge: Option<Py<PyAny>>,
    pub(crate) failure: Failure,
    /// `[B, H, D]`; empty for solvers without one.
    pub(crate) mean: Vec<f32>,
}

impl Trace for PythonTrace {
    fn begin(&mut self, _solver: &'static str, problem: &Problem<'_>) {
        self.mean.clear();
        self.mean.extend_from_slice(problem.initial);
    }

    fn iteration(&mut self, iteration: &Iteration<'_>) {
        self.mean.clear();
        self.mean.extend_from_slice(iteration.mean);
        let Some(bridge) = &self.bridge else { return };
        let shown = Python::attach(|py| {
            let candidates = &iteration.candidates;
            let [episodes, samples, horizon, dim] = candidates.shape();
            let array = |values: &[f32], shape: &[usize]| {
                if values.is_empty() {
                    return Ok(None);
                }
                PyArray1::from_slice(py, values).reshape(shape.to_vec()).map(Some)
            };
            let all = (
                iteration.number,
                array(candidates.actions, &candidates.shape())?,
                PyArray1::from_slice(py, iteration.costs).reshape([episodes, samples])?,
                array(iteration.mean, &[episodes, horizon, dim])?,
                array(iteration.std, &[episodes, horizon, dim])?,
                array(iteration.gradient, &candidates.shape())?,
            );
            bridge.bind(py).call_method1(intern!(py, "iteration"), all)?;
            Ok(())
        });
        if let Err(error) = shown {
            self.failure.set(error);
        }
    }

    fn end(&mut self, _problem: &Problem<'_>, _plan: &Plan) {}
}
