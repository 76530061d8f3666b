//! Who is evaluated on a manifest: a policy of the registry, or one that was made outside of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json};
use swm_core::error::BoxError;
use swm_core::{EnvEntry, Manifest, PolicyArgs, Recorder, Registry, Rollout};

use super::policy::{policy_args, policy_files};
use super::{Assignment, Fix, ManifestSource, Message, Report, TaskError, report::apart, wrong};
use crate::evaluation::{
    Candidate, ForeignPolicy, Receipt, RunOptions, Verification, env_of, file_hash, verify_by,
};

/// A policy that no registry has, such as an object of Python. Results call it what the request names as its policy.
pub struct Foreign<'a> {
    /// Its settings, by name.
    pub settings: Map<String, Json>,
    /// The files that it depends on.
    pub files: Vec<PathBuf>,
    /// Runs episodes in environments of a manifest, under its budget and its test of success.
    pub run: Box<RunOn<'a>>,
}

/// See [`Foreign::run`].
pub type RunOn<'a> = dyn FnMut(&Manifest, Rollout, &mut dyn Recorder) -> Result<(), BoxError> + 'a;

/// A policy on a manifest.
pub(super) struct Entrant {
    pub(super) manifest: Manifest,
    pub(super) entry: &'static EnvEntry,
    pub(super) candidate: Candidate,
    /// The policy with its settings.
    pub(super) description: String,
    /// SHA-256 of the files that it depends on.
    pub(super) files: BTreeMap<String, String>,
    /// Actions of one plan.
    pub(super) steps: u64,
    /// Whether an earlier run can be recognized as one of the same policy. A name and settings say nothing of code and weights.
    pub(super) is_identified: bool,
}

impl Entrant {
    /// `policy`: `NAME:ARGS`, or what the foreign one is called. `steps`: where the settings do not say them.
    pub(super) fn new(
        registry: &Registry,
        manifest: Manifest,
        policy: &str,
        seed: u64,
        steps: Option<u64>,
        foreign: Option<&Foreign<'_>>,
        report: &mut dyn Report,
    ) -> Result<Self, TaskError> {
        let entry = env_of(registry, &manifest).map_err(wrong)?;
        let (candidate, description, files) = match foreign {
            None => {
                let candidate = Candidate::new(policy_args(registry, policy)?).seeded(seed);
                let candidate = candidate.on(registry, entry, &manifest);
                let made = candidate.make(registry, entry, &manifest)?;
                let files = apart(report, || candidate.files(registry, entry))??;
                (candidate, made.describe(), files)
            }
            Some(Foreign { settings, files, .. }) => {
                // A receipt tells by the name whether this program can make the policy.
                let name = match registry.policy_entry(entry, policy) {
                    Ok(_) => format!("{policy} (Python)"),
                    Err(_) => policy.to_owned(),
                };
                let args = PolicyArgs::new(name, settings.clone());
                let hashed = |path: &PathBuf| -> Result<(String, String), TaskError> {
                    Ok((path.display().to_string(), file_hash(path)?))
                };
                let files =
                    apart(report, || files.iter().map(hashed).collect::<Result<BTreeMap<_, _>, _>>())??;
                (Candidate::new(args.clone()).seeded(seed), args.to_string(), files)
            }
        };
        let steps = steps.unwrap_or_else(|| candidate.plan_steps(registry, entry, &manifest));
        let is_identified = foreign.is_none() || !files.is_empty();
        Ok(Self { manifest, entry, candidate, description, files, steps, is_identified })
    }

    /// Refuses to go on with what an earlier run left in `dir`, where it may be of another policy.
    pub(super) fn check_identified(&self, dir: &Path, holds: &str) -> Result<(), TaskError> {
        if self.is_identified {
            return Ok(());
        }
        let text = format!(
            "{} holds {holds} of `{}`, a policy in Python, and its name does not show whether its code or weights are the same",
            dir.display(),
            self.candidate.policy.name
        );
        let files = Fix::Set { setting: Assignment::name("weights"), to: "(the files that it depends on)" };
        let replace = Fix::set_to("again", true, "to replace it");
        Err(Message::new(text).fix(Fix::Any(vec![Fix::Change("out"), files, replace])).into())
    }

    /// The foreign policy as runs take it.
    pub(super) fn foreign<'a>(&'a self, foreign: &'a mut Foreign<'_>) -> ForeignPolicy<'a> {
        ForeignPolicy {
            description: self.description.clone(),
            files: self.files.clone(),
            plan_steps: self.steps,
            run: Box::new(|rollout, recorder| (foreign.run)(&self.manifest, rollout, recorder)),
        }
    }

    /// The entry of the environment is there, and the policy can be made: for jobs.
    pub(super) fn check_made(&self, registry: &Registry, other: &Candidate) -> Result<(), TaskError> {
        other.make(registry, self.entry, &self.manifest).map(drop)
    }
}

/// The files that an evaluation on a manifest reads: the manifest, and those of policies.
pub(super) fn inputs<'a>(
    registry: &Registry,
    entry: &EnvEntry,
    source: Option<&ManifestSource>,
    policies: impl IntoIterator<Item = &'a String>,
) -> Result<Vec<PathBuf>, TaskError> {
    let mut inputs: Vec<PathBuf> = match source {
        Some(ManifestSource::File(path)) => vec![path.clone()],
        _ => Vec::new(),
    };
    for policy in policies {
        inputs.extend(policy_files(registry, entry, policy)?);
    }
    Ok(inputs)
}

/// As [`crate::evaluation::verify`], of a receipt of a policy that the registry does not have: what it is called and the policy;
/// `steps`: actions of one plan.
///
/// # Errors
///
/// As of [`crate::evaluation::verify_by`]; one of the policy's files cannot be read.
pub fn verify_foreign(
    registry: &Registry,
    receipt: &Receipt,
    (name, foreign): (&str, &mut Foreign<'_>),
    steps: Option<u64>,
    options: &RunOptions,
    oracle: bool,
    each: impl FnMut() + Send,
) -> Result<Verification, TaskError> {
    let (manifest, seed) = (receipt.manifest.clone(), receipt.candidate.seed);
    let entrant = Entrant::new(registry, manifest, name, seed, steps, Some(&*foreign), &mut ())?;
    let policy = (&entrant.candidate, entrant.foreign(foreign));
    verify_by(registry, receipt, Some(policy), options, oracle, each)
}
