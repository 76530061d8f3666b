//! Evaluations on manifests: a policy and the reference policies on the same pairs, whole or in parts, and the receipt.

use pyo3::prelude::*;
use swm::core::error::BoxError;
use swm::core::{Manifest, Recorder, Rollout};
use swm::tasks::request::{Evaluate, Evaluated, Foreign, Request as _};

use crate::errors::{OrRaise as _, in_words};
use crate::manifest::{from_json, to_json};
use crate::policy::drive;
use crate::report::Reporter;
use crate::runs::Given;
use crate::world::registry;

/// Evaluates a policy on a manifest: `request` is a JSON object of the settings of `Evaluate`. A policy in Python comes as `foreign`.
/// `begin` is called with what each progress bar is called and its length. Gives the receipt as JSON, `None` for a part, and notes.
#[pyfunction]
#[pyo3(signature = (request, foreign=None, begin=None, tick=None))]
fn evaluate_manifest(
    py: Python<'_>,
    request: &str,
    foreign: Option<Given<'_>>,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Option<String>, Vec<String>)> {
    let wrong = |error| in_words(error, Evaluate::NAME);
    let request = Evaluate::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, Evaluate::NAME, begin, tick);
    let progress = reporter.progress.clone();
    let mut foreign = match &foreign {
        None => None,
        Some((world, begin, act, settings, files)) => {
            let progress = progress.clone();
            let run = move |manifest: &Manifest,
                            rollout: Rollout,
                            recorder: &mut dyn Recorder|
                  -> Result<(), BoxError> {
                {
                    let mut core = world.get().shared.lock()?;
                    let world = core.world()?;
                    world.set_success(&manifest.success).or_raise()?;
                    world.set_max_episode_steps(Some(manifest.budget));
                }
                begin.call0()?;
                drive(py, &world.get().shared, rollout, recorder, Some(act), || progress.tell(tick))?;
                Ok(progress.tell(tick)?)
            };
            let settings = from_json("the settings of the policy", settings)?;
            Some(Foreign { settings, files: files.clone(), run: Box::new(run) })
        }
    };
    let evaluated = request.run_by(registry(), foreign.as_mut(), &mut reporter).map_err(wrong)?;
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
