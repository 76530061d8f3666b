//! A receipt: one JSON that says what was evaluated, what came out, and everything it takes to repeat it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::Manifest;
use swm_core::evaluate::{EpisodeResult, Summary};

use super::probe::Fingerprints;
use super::reference::Reference;
use super::run::Candidate;

/// The version of [`Receipt`] that is written. Version 1 is read: its `fingerprints.tables` is a hash over help texts, too, and
/// is not compared.
pub const RECEIPT_VERSION: u32 = 2;

/// The result of a policy on a manifest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Receipt {
    /// Its version, [`RECEIPT_VERSION`] or an older one.
    pub receipt: u32,
    /// [`Manifest::hash`] of the manifest.
    pub manifest_hash: String,
    /// What was evaluated.
    pub candidate: Candidate,
    /// The policy with its settings.
    pub policy: String,
    /// SHA-256 of every file that the policy's arguments name: its models.
    #[serde(default)]
    pub files: BTreeMap<String, String>,
    /// Arguments of policies that are paths from the receipt's own folder, as those of [`Receipt::files`] then are: of a result that was
    /// handed on with its model. Empty once it is read: the paths are those from here.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paths: Vec<String>,
    /// What the result depends on.
    pub fingerprints: Fingerprints,
    /// What made it.
    pub code: Code,
    /// The results over all pairs.
    pub summary: Summary,
    /// The same, phase by phase, where the manifest is a stream.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub phases: Vec<Summary>,
    /// The reference policies on the same pairs.
    #[serde(default, alias = "beside")]
    pub references: Vec<Reference>,
    /// Actions of one plan: where `plan_cost` of each episode is taken.
    pub plan_steps: u64,
    /// Every pair's episode, in order.
    pub episodes: Vec<EpisodeResult>,
    /// The manifest itself.
    pub manifest: Manifest,
    /// Seconds that the policy took, without the reference policies. The only entry that differs between repetitions.
    pub wall_time_s: f64,
}

/// The code that made a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Code {
    /// Version of the package.
    pub version: String,
    /// The commit, where the build was told: the variable `SWM_COMMIT`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// Machine and operating system.
    pub target: String,
}

impl Code {
    /// This program.
    pub fn this() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: option_env!("SWM_COMMIT").map(str::to_owned),
            target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
        }
    }
}

impl Receipt {
    /// A receipt without results yet. `files` are those of [`Candidate::files`].
    pub fn new(
        manifest: Manifest,
        candidate: Candidate,
        policy: String,
        files: BTreeMap<String, String>,
        fingerprints: Fingerprints,
        plan_steps: u64,
    ) -> Self {
        Self {
            receipt: RECEIPT_VERSION,
            manifest_hash: manifest.hash(),
            candidate,
            policy,
            files,
            paths: Vec::new(),
            fingerprints,
            code: Code::this(),
            summary: Summary::of(&[]),
            phases: Vec::new(),
            references: Vec::new(),
            plan_steps,
            episodes: Vec::new(),
            manifest,
            wall_time_s: 0.0,
        }
    }

    /// With every pair's episode, in order, what is derived from them, and the reference policies.
    #[must_use]
    pub fn with_results(
        self,
        episodes: Vec<EpisodeResult>,
        references: Vec<Reference>,
        wall_time_s: f64,
    ) -> Self {
        let (summary, phases) = (Summary::of(&episodes), Self::by_phase(&self.manifest, &episodes));
        Self { summary, phases, references, episodes, wall_time_s, ..self }
    }

    /// Successes, pair by pair.
    pub fn successes(&self) -> Vec<bool> {
        self.episodes.iter().map(|episode| episode.success).collect()
    }

    /// Success by phase of the manifest's stream; empty if it is none.
    pub(super) fn by_phase(manifest: &Manifest, episodes: &[EpisodeResult]) -> Vec<Summary> {
        if manifest.phases() < 2 {
            return Vec::new();
        }
        let of = |phase: usize| {
            let pairs = manifest.pairs.iter().zip(episodes);
            Summary::of(pairs.filter(|(pair, _)| pair.phase == Some(phase)).map(|(_, episode)| episode))
        };
        (0..manifest.phases()).map(of).collect()
    }
}
