//! Sweeps: a policy on a manifest under changed factors of variation, whole or in parts.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::evaluation::read_sweep;
use swm::tasks::request::{Request as _, Sweep, Swept};

use crate::errors::{OrRaise as _, in_words};
use crate::manifest::{from_json, to_json};
use crate::report::Reporter;
use crate::runs::{Given, foreign};
use crate::world::registry;

/// A sweep's file, or that of a folder, as JSON.
#[pyfunction]
fn sweep_json(path: PathBuf) -> PyResult<String> {
    to_json(&read_sweep(&path).or_raise()?)
}

/// Evaluates a policy under changes of factors: `request` is a JSON object of the settings of `Sweep`. The others are those of
/// `evaluate_manifest`. Gives the sweep as JSON, `None` for a part, and notes.
#[pyfunction]
#[pyo3(signature = (request, policy=None, begin=None, tick=None))]
fn sweep_manifest(
    py: Python<'_>,
    request: &str,
    policy: Option<Given<'_>>,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Option<String>, Vec<String>)> {
    let wrong = |error| in_words(error, Sweep::NAME);
    let request = Sweep::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, Sweep::NAME, begin, tick);
    let progress = reporter.progress.clone();
    // The runs themselves show which episodes are done; evaluations are counted.
    let mut policy = policy.as_ref().map(|given| foreign(py, given, &progress, tick)).transpose()?;
    let sweep = match request.run_by(registry(), policy.as_mut(), &mut reporter).map_err(wrong)? {
        Swept::Sweep(sweep) => Some(to_json(&sweep)?),
        _ => None,
    };
    Ok((sweep, reporter.notes))
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(sweep_json, m)?)?;
    m.add_function(wrap_pyfunction!(sweep_manifest, m)?)
}
