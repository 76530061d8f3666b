//! Evaluations on manifests: a policy and the reference policies on the same pairs, whole or in parts, and the receipt.

use pyo3::prelude::*;
use swm::tasks::request::{Evaluate, Evaluated, Request as _};

use crate::errors::in_words;
use crate::manifest::{from_json, to_json};
use crate::report::Reporter;
use crate::runs::{Given, foreign};
use crate::world::registry;

/// Evaluates a policy on a manifest: `request` is a JSON object of the settings of `Evaluate`. A policy in Python comes as `policy`.
/// `begin` and `tick` are as of `run_request`. Gives the receipt as JSON, `None` for a part, and notes.
#[pyfunction]
#[pyo3(signature = (request, policy=None, begin=None, tick=None))]
fn evaluate_manifest(
    py: Python<'_>,
    request: &str,
    policy: Option<Given<'_>>,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Option<String>, Vec<String>)> {
    let wrong = |error| in_words(error, Evaluate::NAME);
    let request = Evaluate::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, Evaluate::NAME, begin, tick);
    let progress = reporter.progress.clone();
    let mut policy = policy.as_ref().map(|given| foreign(py, given, &progress, tick)).transpose()?;
    let evaluated = request.run_by(registry(), policy.as_mut(), &mut reporter).map_err(wrong)?;
    let receipt = match evaluated {
        Evaluated::Receipt(receipt, _) => Some(to_json(&receipt)?),
        _ => None,
    };
    Ok((receipt, reporter.notes))
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(evaluate_manifest, m)?)
}
