//! Requests that are all in their settings: trainings, measures of world models, traces of planners, images of episodes,
//! replays and comparisons of datasets.

use pyo3::prelude::*;
use swm::tasks::request::{Diff, Measure, Plan, Preview, Render, Replay, Request as _, Train};

use crate::errors::{OrRaise as _, SwmError, in_words};
use crate::manifest::{from_json, to_json};
use crate::report::{Made, Reporter, run};
use crate::world::registry;

/// Runs the request of this name: a JSON object of its settings. `begin` is called with the name and the length of each progress bar.
/// Gives what was made as JSON, and notes.
#[pyfunction]
#[pyo3(signature = (name, request, begin=None, tick=None))]
fn run_request(
    py: Python<'_>,
    name: &str,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    match name {
        Train::NAME => run::<Train>(py, request, begin, tick),
        Measure::NAME => run::<Measure>(py, request, begin, tick),
        Plan::NAME => plan(py, request, begin, tick),
        Render::NAME => run::<Render>(py, request, begin, tick),
        Preview::NAME => run::<Preview>(py, request, begin, tick),
        Replay::NAME => run::<Replay>(py, request, begin, tick),
        Diff::NAME => run::<Diff>(py, request, begin, tick),
        _ => Err(SwmError::new_err(format!("`{name}` is no request of this function"))),
    }
}

/// Plans; what was made is the summary, and the files that were written.
fn plan(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    let wrong = |error| in_words(error, Plan::NAME);
    let request = Plan::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, Plan::NAME, begin, tick);
    let planned = request.run(registry(), &mut reporter).map_err(wrong)?;
    let files = planned.written.or_raise()?;
    Ok((to_json(&(planned.summary, files))?, reporter.notes))
}

/// Adds this file's function to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(run_request, m)?)
}
