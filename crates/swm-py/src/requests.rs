//! Requests that are all in their settings.

use pyo3::prelude::*;
use swm::tasks::request::{
    Bench, Convert, Diff, Inspect, MakeBoard, MakeBundle, Measure, Merge, Plan, Preview, Render, Replay,
    Request as _, Split, Stats, Train, Verify,
};

use crate::checkpoints::reproduce;
use crate::errors::{OrRaise as _, SwmError, in_words};
use crate::manifest::{from_json, to_json};
use crate::report::{Made, Reporter, run};
use crate::world::registry;
use crate::writer::check_threads;

/// Runs the request of this name: a JSON object of its settings. `begin` is called with the name, the length and the unit of each progress
/// bar. Gives what was made as JSON, and notes.
#[pyfunction]
#[pyo3(signature = (name, request, begin=None, tick=None))]
fn run_request(
    py: Python<'_>,
    name: &str,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    if [Convert::NAME, Merge::NAME, Split::NAME].contains(&name) {
        // They write datasets, and not every format can do so in a fork.
        let given: serde_json::Value = from_json("the request", request)?;
        check_threads(given["format"].as_str())?;
    }
    match name {
        Train::NAME => run::<Train>(py, request, begin, tick),
        Bench::NAME => run::<Bench>(py, request, begin, tick),
        Measure::NAME => run::<Measure>(py, request, begin, tick),
        Plan::NAME => plan(py, request, begin, tick),
        Render::NAME => run::<Render>(py, request, begin, tick),
        Preview::NAME => run::<Preview>(py, request, begin, tick),
        Replay::NAME => run::<Replay>(py, request, begin, tick),
        Inspect::NAME => run::<Inspect>(py, request, begin, tick),
        Stats::NAME => run::<Stats>(py, request, begin, tick),
        Diff::NAME => run::<Diff>(py, request, begin, tick),
        Convert::NAME => run::<Convert>(py, request, begin, tick),
        Merge::NAME => run::<Merge>(py, request, begin, tick),
        Split::NAME => run::<Split>(py, request, begin, tick),
        Verify::NAME => run::<Verify>(py, request, begin, tick),
        MakeBundle::NAME => run::<MakeBundle>(py, request, begin, tick),
        MakeBoard::NAME => run::<MakeBoard>(py, request, begin, tick),
        "reproduce" => reproduce(py, request, begin, tick),
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
