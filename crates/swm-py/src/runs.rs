//! A policy in Python that acts on a manifest.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::core::error::BoxError;
use swm::core::{Manifest, Recorder, Rollout};
use swm::tasks::request::Foreign;

use crate::errors::OrRaise as _;
use crate::evaluate::Progress;
use crate::manifest::from_json;
use crate::policy::drive;
use crate::world::PyWorld;

/// A policy in Python: a World for the manifest, what is called before episodes begin, what gives actions, the policy's settings (a
/// JSON object), and the files that it depends on.
pub(crate) type Given<'py> =
    (Bound<'py, PyWorld>, Bound<'py, PyAny>, Bound<'py, PyAny>, String, Vec<PathBuf>);

/// The policy as requests take it; its steps are counted in `progress`, which `tick` shows.
pub(crate) fn foreign<'a>(
    py: Python<'a>,
    (world, begin, act, settings, files): &'a Given<'_>,
    progress: &Progress,
    tick: Option<&'a Bound<'_, PyAny>>,
) -> PyResult<Foreign<'a>> {
    let progress = progress.clone();
    let run =
        move |manifest: &Manifest, rollout: Rollout, recorder: &mut dyn Recorder| -> Result<(), BoxError> {
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
    Ok(Foreign { settings, files: files.clone(), run: Box::new(run) })
}
