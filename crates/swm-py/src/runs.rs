//! Who acts on a manifest: a policy of the core, or one in Python.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use serde_json::{Map, Value as Json};
use swm::core::error::BoxError;
use swm::core::{EnvEntry, Manifest, PolicyArgs, Recorder, Rollout};
use swm::evaluation::{Candidate, ForeignPolicy, file_hash};

use crate::errors::{OrRaise as _, SwmError};
use crate::evaluate::Progress;
use crate::manifest::{boxed, from_json};
use crate::policy::drive;
use crate::world::{PyWorld, registry};

/// A policy in Python: a World for the manifest, what is called before episodes begin, what gives actions, the policy's settings (a
/// JSON object), and the files that it depends on.
pub(crate) type Given<'py> =
    (Bound<'py, PyWorld>, Bound<'py, PyAny>, Bound<'py, PyAny>, String, Vec<PathBuf>);

/// Who is evaluated on what.
pub(crate) struct Asked<'py> {
    pub(crate) manifest: Manifest,
    pub(crate) entry: &'static EnvEntry,
    pub(crate) candidate: Candidate,
    /// The policy with its settings.
    pub(crate) description: String,
    /// SHA-256 of the files that it depends on.
    pub(crate) files: BTreeMap<String, String>,
    /// Actions of one plan.
    pub(crate) steps: u64,
    given: Option<Given<'py>>,
}

impl<'py> Asked<'py> {
    /// `policy`: a policy of the core, or what the `given` one is called. `steps`: where the settings do not say them.
    pub(crate) fn new(
        manifest: &str,
        policy: &str,
        given: Option<Given<'py>>,
        seed: u64,
        steps: Option<u64>,
    ) -> PyResult<Self> {
        let manifest: Manifest = from_json("the manifest", manifest)?;
        manifest.check().or_raise()?;
        let entry = registry().env(&manifest.env).or_raise()?;
        let (candidate, description, files) = match &given {
            None => {
                let candidate = Candidate::new(PolicyArgs::parse(policy).or_raise()?).seeded(seed);
                let candidate = candidate.on(registry(), entry, &manifest);
                let made = candidate.make(registry(), entry, &manifest).map_err(boxed)?;
                let files = candidate.files(registry(), entry).map_err(boxed)?;
                (candidate, made.describe(), files)
            }
            Some((.., settings, files)) => {
                let settings: Map<String, Json> = from_json("the settings of the policy", settings)?;
                // A receipt tells by the name whether this program can make the policy.
                let name = match registry().policy_entry(entry, policy) {
                    Ok(_) => format!("{policy} (Python)"),
                    Err(_) => policy.to_owned(),
                };
                let args = PolicyArgs::new(name, settings);
                let hashed = |path: &PathBuf| -> Result<(String, String), BoxError> {
                    Ok((path.display().to_string(), file_hash(path)?))
                };
                let files = files.iter().map(hashed).collect::<Result<_, _>>().map_err(boxed)?;
                (Candidate::new(args.clone()).seeded(seed), args.to_string(), files)
            }
        };
        let steps = steps.unwrap_or_else(|| candidate.plan_steps(registry(), entry, &manifest));
        Ok(Self { manifest, entry, candidate, description, files, steps, given })
    }

    /// Whether an earlier run can be told to be of the same policy. A name and settings say nothing of code and weights.
    pub(crate) fn is_identified(&self) -> bool {
        self.given.is_none() || !self.files.is_empty()
    }

    /// Refuses to go on with what an earlier run left in `dir`, where it may be of another policy.
    pub(crate) fn check_identified(&self, dir: &Path, holds: &str) -> PyResult<()> {
        if self.is_identified() {
            return Ok(());
        }
        Err(SwmError::new_err(format!(
            "{} holds {holds} of `{}`, a policy in Python, and its name does not tell whether its code or weights are the same; \
             give another folder, name the files that it depends on in weights=[…], or again=True to replace it",
            dir.display(),
            self.candidate.policy.name
        )))
    }

    /// The policy in Python, if it is one; its episodes are counted in `progress`, which `tick` shows.
    pub(crate) fn foreign<'a>(
        &'a self,
        py: Python<'a>,
        progress: &'a Progress,
        tick: Option<&'a Bound<'py, PyAny>>,
    ) -> PyResult<Option<ForeignPolicy<'a>>> {
        let Some((world, begin, act, ..)) = &self.given else { return Ok(None) };
        {
            let mut core = world.get().shared.lock()?;
            let world = core.world()?;
            world.set_success(&self.manifest.success).or_raise()?;
            world.set_max_episode_steps(Some(self.manifest.budget));
        }
        let run = move |rollout: Rollout, recorder: &mut dyn Recorder| -> Result<(), BoxError> {
            begin.call0()?;
            Ok(drive(py, &world.get().shared, rollout, recorder, Some(act), || progress.tell(tick))?)
        };
        Ok(Some(ForeignPolicy {
            description: self.description.clone(),
            files: self.files.clone(),
            plan_steps: self.steps,
            run: Box::new(run),
        }))
    }
}
