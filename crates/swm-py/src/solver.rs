//! Solvers over costs that are Python objects.

use std::process;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::{Map, Value as Json};
use swm::core::{Dtype, EpisodeSeed, Space};
use swm::solvers::{ActionMap, AsExecuted, Plan, PlanKey, Problem, SolverEntry, Workspace};

use crate::cost::{Failure, PythonCost, PythonTrace};
use crate::errors::{OrRaise as _, PlanFault};
use crate::fork::Process;

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Solver>()?;
    m.add_function(wrap_pyfunction!(solvers, m)?)
}

/// Name, doc and default of a setting.
type SettingText = (&'static str, &'static str, &'static str);

/// Names of all solvers, what each does in a line, and its settings: `[(name, summary, [(setting, doc, default)])]`.
#[pyfunction]
fn solvers() -> Vec<(&'static str, &'static str, Vec<SettingText>)> {
    let settings = |entry: &SolverEntry| {
        entry.settings.iter().map(|setting| (setting.name, setting.doc, setting.default)).collect()
    };
    swm::registry().all::<SolverEntry>().map(|entry| (entry.name, entry.summary, settings(entry))).collect()
}

/// The process whose threads plan. A fork of it has none, and would wait for them forever.
static PLANNER: AtomicU32 = AtomicU32::new(0);

/// A solver of the core, with its settings. The classes of `stable_worldmodel_rs.planning` are what to use.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
struct Solver {
    solver: Box<dyn swm::solvers::Solver>,
    /// Buffers of solves that are over. A solve takes one out, so that threads, and a cost that plans by itself, can
    /// share a solver.
    spare: Mutex<Vec<(Workspace, Plan)>>,
    process: Process,
}

/// What is planned: as [`Problem`], owned.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Task<'py> {
    /// `[A]` each: bounds of real actions, in units of plans; empty for integers.
    low: Vec<f64>,
    high: Vec<f64>,
    /// Whether the cost is given candidates within them.
    clips: bool,
    /// How many categories each integer has; empty for real actions.
    categories: Vec<i64>,
    horizon: usize,
    action_block: usize,
    /// `[B]` each: seeds of the episodes, and how many plans each had before.
    seeds: Vec<i64>,
    plans: Vec<u64>,
    /// `[B × H × D]`.
    initial: PyReadonlyArray1<'py, f32>,
    /// `[B]`, or empty.
    memory: Vec<Vec<f64>>,
}

#[pymethods]
impl Solver {
    /// The solver `name` with `settings`, a JSON object.
    #[new]
    fn new(name: &str, settings: &str) -> PyResult<Self> {
        let given: Map<String, Json> =
            serde_json::from_str(settings).map_err(|error| PlanFault::new_err(error.to_string()))?;
        let solver = swm::registry().find::<SolverEntry>(name).or_raise()?.make(given).or_raise()?;
        Ok(Self { solver, spare: Mutex::new(Vec::new()), process: Process::current() })
    }

    /// The settings that differ from their defaults, a JSON object.
    fn changed_settings(&self) -> String {
        Json::Object(self.solver.changed_settings()).to_string()
    }

    /// Plans for all episodes of `task` with the cost behind `bridge`. Arrays of the result are flat.
    #[pyo3(signature = (task, bridge, *, has_gradient, constraints, evaluations, traced))]
    #[expect(clippy::too_many_arguments, reason = "named by their only caller")]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        task: Task<'py>,
        bridge: Py<PyAny>,
        has_gradient: bool,
        constraints: usize,
        evaluations: usize,
        traced: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        self.process.check("the solver")?;
        let planner = PLANNER.compare_exchange(0, process::id(), Ordering::Relaxed, Ordering::Relaxed);
        if planner.is_err_and(|planner| planner != process::id()) {
            return Err(PlanFault::new_err(
                "planning needs threads, and a forked process has none; start it with the method `spawn` or `forkserver`",
            ));
        }
        let space = if task.categories.is_empty() {
            let shape = vec![task.low.len()];
            Space::Box { dtype: Dtype::F32, shape, low: task.low, high: task.high }
        } else {
            let start = vec![0; task.categories.len()];
            Space::MultiDiscrete { n: task.categories, start }
        };
        let keys = task.seeds.iter().zip(&task.plans).enumerate();
        let keys: Vec<PlanKey> = keys
            .map(|(episode, (&seed, &plan))| PlanKey {
                episode: episode as u64,
                seed: EpisodeSeed::new(seed.cast_unsigned()),
                plan,
            })
            .collect();
        let initial = task.initial.as_slice()?.to_vec();
        let (horizon, action_block, memory) = (task.horizon, task.action_block, task.memory);

        let failure = Failure::default();
        let mut trace = PythonTrace {
            bridge: traced.then(|| bridge.clone_ref(py)),
            failure: failure.clone(),
            mean: Vec::new(),
        };
        let cost = PythonCost { bridge, has_gradient, constraints, evaluations, failure: failure.clone() };
        let mut cost = AsExecuted::with_map(Box::new(cost), Arc::new(ActionMap::new(&space, task.clips)));
        let lock = || self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut workspace, mut plan) = lock().pop().unwrap_or_default();
        let solved = py.detach(|| {
            let problem = Problem {
                keys: &keys,
                horizon,
                action_block,
                action: &space,
                initial: &initial,
                memory: &memory,
            };
            self.solver.solve(&problem, &mut cost, &mut workspace, &mut trace, &mut plan)
        });
        solved.or_raise()?;
        if let Some(error) = failure.take() {
            return Err(error);
        }
        let result = PyDict::new(py);
        result.set_item("actions", PyArray1::from_slice(py, &plan.actions))?;
        result.set_item("mean", PyArray1::from_slice(py, &trace.mean))?;
        result.set_item("std", PyArray1::from_slice(py, &plan.std))?;
        result.set_item("cost", PyArray1::from_slice(py, &plan.cost_of_returned))?;
        result.set_item("elite_mean", PyArray1::from_slice(py, &plan.elite_mean_last))?;
        result.set_item("violation", PyArray1::from_slice(py, &plan.violation))?;
        let memory: Vec<_> = plan.memory.iter().map(|values| PyArray1::from_slice(py, values)).collect();
        result.set_item("memory", PyList::new(py, memory)?)?;
        lock().push((workspace, plan));
        Ok(result)
    }
}
