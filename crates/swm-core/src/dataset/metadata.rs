//! How recorded episodes were made: the metadata that stands in every dataset and in results of evaluations.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::env::{FactorSpec, ImageSize};
use crate::run::RunInfo;

/// How the episodes of a dataset were made, so that they can be repeated and checked. It holds nothing that does not
/// change the content: no time, host, thread count or number of environments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// The version of this record.
    pub version: u32,
    /// The environment's id.
    pub env: String,
    /// The environment's settings that differ from the defaults.
    #[serde(default)]
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// The run's seed.
    pub seed: u64,
    /// The policy's description.
    pub policy: String,
    /// The factors that were asked to be sampled; `None`: the environment's default list.
    #[serde(default)]
    pub variation: Option<Vec<String>>,
    /// The factors that were set.
    #[serde(default)]
    pub variation_values: BTreeMap<String, serde_json::Value>,
    /// The episodes were started at recorded rows (an evaluation from a dataset), with options of their own each.
    #[serde(default)]
    pub from_recorded_rows: bool,
    /// Image size.
    #[serde(default)]
    pub image: Option<ImageSize>,
    /// The renderer's description, where there is a choice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renderer: Option<String>,
    /// Time limit of an episode.
    #[serde(default)]
    pub max_episode_steps: Option<u64>,
    /// Environment steps per row.
    #[serde(default = "one")]
    pub frame_skip: u32,
    /// Rows per second of the environment's time, where it has one; formats with time stamps take it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows_per_second: Option<f64>,
    /// Rows from one checkpoint to the next in the column `checkpoint`; `None`: it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checkpoints: Option<u32>,
    /// How the episodes were read from files of another program: the format, the names of columns there, the options. Copies keep it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<serde_json::Value>,
    /// Which part of a divided recording it is; `None`: it is not divided.
    #[serde(default, rename = "swm_part", skip_serializing_if = "Option::is_none")]
    pub part: Option<RecordingPart>,
    /// Versions of the packages that made it.
    #[serde(default)]
    pub packages: BTreeMap<String, String>,
    /// SHA-256 of the libraries and files that the environment was made from, by name; none where it is made of the program
    /// alone.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub made_from: BTreeMap<String, String>,
}

/// A part of a recording that is divided among several processes. It says which episodes the file will hold once it is
/// complete, so that an incomplete part is not taken for a whole one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingPart {
    /// Number of the part, counted from 1.
    pub shard: u64,
    /// Number of parts.
    pub of: u64,
    /// Its first episode in the whole recording.
    pub first: u64,
    /// The episode after its last one.
    pub end: u64,
    /// Episodes of the whole recording.
    pub total: u64,
}

fn one() -> u32 {
    1
}

/// The version of [`Metadata`] that is written.
pub const METADATA_VERSION: u32 = 1;

/// What an environment or a policy is called of which nothing is known.
const UNKNOWN: &str = "unknown";

impl Metadata {
    /// Of episodes of which nothing is known, such as those of other programs: nothing is claimed but that they were started at
    /// recorded rows.
    pub fn unknown() -> Self {
        Self {
            version: METADATA_VERSION,
            env: UNKNOWN.to_owned(),
            policy: UNKNOWN.to_owned(),
            from_recorded_rows: true,
            frame_skip: 1,
            ..Self::default()
        }
    }

    /// The environment's id, unless it is [unknown](Metadata::unknown).
    pub fn known_env(&self) -> Option<&str> {
        Some(self.env.as_str()).filter(|&env| env != UNKNOWN && !env.is_empty())
    }

    /// This record, if it names the environment. Of episodes of other programs, and of their copies, nothing else that it says is
    /// known either.
    ///
    /// ```
    /// use swm_core::Metadata;
    ///
    /// let recorded = Metadata { env: "swm/PushT-v1".to_owned(), ..Metadata::default() };
    /// assert_eq!(recorded.of_known_env(), Some(&recorded));
    /// assert_eq!(Metadata::unknown().of_known_env(), None);
    /// ```
    pub fn of_known_env(&self) -> Option<&Self> {
        self.known_env().map(|_| self)
    }

    /// Whether the run sampled or set a factor, as far as its record says.
    pub fn varies(&self, factor: &FactorSpec) -> bool {
        self.from_recorded_rows
            || factor.is_sampled(self.variation.as_deref())
            || self.variation_values.contains_key(&factor.name)
    }

    /// The metadata of a run.
    pub fn of(run: &RunInfo<'_>) -> Self {
        let shared = run.rollout.shared_options();
        let values = shared.iter().flat_map(|options| &options.variation_values);
        Self {
            version: METADATA_VERSION,
            env: run.spec.id.clone(),
            settings: run.options.env.settings.clone(),
            seed: run.rollout.seed,
            policy: run.policy.to_owned(),
            variation: shared.and_then(|options| options.variation.clone()),
            variation_values: values.map(|(name, value)| (name.clone(), value.to_json())).collect(),
            from_recorded_rows: shared.is_none(),
            image: run.options.env.image,
            renderer: run.renderer.map(str::to_owned),
            max_episode_steps: run.options.max_episode_steps,
            frame_skip: run.options.frame_skip,
            rows_per_second: Some((run.spec.time_step_s * f64::from(run.options.frame_skip)).recip()),
            checkpoints: run.options.checkpoints,
            source: None,
            part: None,
            packages: BTreeMap::from([("swm-core".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]),
            made_from: run.spec.asset_hashes.clone(),
        }
    }
}
