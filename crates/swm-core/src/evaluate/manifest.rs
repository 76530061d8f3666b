//! A manifest: everything that two evaluations must share to be compared, as one file with a content hash. It holds the
//! values of starts, goals and factors themselves: no dataset is needed to repeat it.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use crate::batch::Value;
use crate::env::{ImageSize, ResetOptions};
use crate::error::{BatchError, WorldError};
use crate::run::Rollout;
use crate::seed::EpisodeSeed;
use crate::success::SuccessRule;

use super::hash::{sha256, sorted};

/// The version of [`Manifest`] that is written and read.
pub const MANIFEST_VERSION: u32 = 1;

/// How pairs of start and goal were chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Tier {
    /// As published: rows sampled uniformly from all episodes, pairs solved at the start included, the environment's test.
    #[default]
    Historic,
    /// One pair per held-out episode, none solved at the start, all with some motion, starting at rest.
    Moderate,
    /// As moderate, with more motion and a tighter test of what the task is about.
    Strict,
}

impl Tier {
    /// The tier in a word.
    pub fn name(self) -> &'static str {
        match self {
            Tier::Historic => "historic",
            Tier::Moderate => "moderate",
            Tier::Strict => "strict",
        }
    }
}

/// A task: environment, pairs of start and goal, budget, success test.
/// ```
/// use swm_core::evaluate::{ManifestOptions, Tier, make_manifest};
/// use swm_core::{EnvConfig, Manifest, testing::TOY};
///
/// let options = ManifestOptions { tier: Tier::Moderate, pairs: 10, budget: 30, ..Default::default() };
/// let manifest = make_manifest(&TOY, &EnvConfig::default(), &options, None)?;
/// assert_eq!(manifest.pairs.len(), 10);
///
/// // A file in between changes nothing: the hash is the name of the task.
/// let read: Manifest = serde_json::from_str(&serde_json::to_string(&manifest)?)?;
/// assert_eq!(read.hash(), manifest.hash());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Manifest {
    /// [`MANIFEST_VERSION`].
    pub version: u32,
    /// Environment id.
    pub env: String,
    /// The environment's settings that differ from the defaults.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub settings: Map<String, Json>,
    /// How pairs were chosen.
    pub tier: Tier,
    /// Actions allowed.
    pub budget: u64,
    /// Environment steps per action.
    pub frame_skip: u32,
    /// Size of the images that policies see.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<ImageSize>,
    /// The seed that pairs were sampled with.
    pub seed: u64,
    /// What changes the images that policies see, each as a name with settings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub distractors: Vec<String>,
    /// When an episode is a success.
    pub success: SuccessRule,
    /// Where pairs come from.
    pub source: PairSource,
    /// Candidates that were left out, by reason.
    pub excluded: Excluded,
    /// Pairs that are solved before the first action: historic manifests have some.
    pub solved_at_start: usize,
    /// The pairs, one episode each.
    pub pairs: Vec<Pair>,
}

/// Where pairs come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
#[non_exhaustive]
pub enum PairSource {
    /// Sampled by the environment's reset.
    Online,
    /// Rows of recorded episodes.
    Dataset {
        /// File name, for people.
        name: String,
        /// SHA-256 of the file, or of its files.
        hash: String,
        /// Episodes it holds.
        episodes: usize,
        /// Rows it holds.
        rows: usize,
        /// The goal is this many rows after the start.
        goal_offset: usize,
        /// The share of episodes that pairs were sampled from: those that are held out from training by
        /// [`super::is_held_out`]. 1: all.
        held_out: f64,
    },
    /// Steps of recorded episodes that were chosen one by one.
    Chosen {
        /// File name, for people.
        name: String,
        /// SHA-256 of the file, or of its files.
        hash: String,
        /// Episodes it holds.
        episodes: usize,
        /// Rows it holds.
        rows: usize,
    },
}

impl PairSource {
    /// In words.
    pub fn describe(&self) -> String {
        match self {
            PairSource::Online => "sampled by the environment".to_owned(),
            PairSource::Dataset { name, episodes, rows, goal_offset, held_out, .. } => {
                let share = match *held_out < 1.0 {
                    true => format!(", {:.0} % held out", 100.0 * held_out),
                    false => String::new(),
                };
                format!("{name}: {episodes} episodes, {rows} rows{share}; goals {goal_offset} rows ahead")
            }
            PairSource::Chosen { name, episodes, rows, .. } => {
                format!("{name}: {episodes} episodes, {rows} rows; pairs chosen one by one")
            }
        }
    }
}

/// Candidates that were left out, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Excluded {
    /// Solved before the first action.
    pub solved_at_start: usize,
    /// Too little between start and goal.
    pub little_motion: usize,
    /// Episodes too short for the goal offset.
    pub too_short: usize,
}

impl Excluded {
    /// In words.
    pub fn describe(&self) -> String {
        let Self { solved_at_start, little_motion, too_short } = self;
        if *self == Self::default() {
            return "nothing".to_owned();
        }
        format!(
            "{solved_at_start} solved at the start, {little_motion} with little motion, {too_short} too short"
        )
    }
}

/// One episode of a manifest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Pair {
    /// Its seed.
    pub seed: i64,
    /// The phase of a stream that it belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<usize>,
    /// Factors that are sampled, by the seed; without it, the environment's default list.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vary: Option<Vec<String>>,
    /// Factors that are set.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub set: BTreeMap<String, Json>,
    /// Columns of the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<BTreeMap<String, Json>>,
    /// Columns of the goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<BTreeMap<String, Json>>,
    /// Episode, start row and goal row of the dataset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<[usize; 3]>,
    /// The episode of the goal's row, where it is not that of the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal_episode: Option<usize>,
    /// Digest of the first row that this gives, images apart: what [`witness`](super::witness) makes of it.
    pub witness: String,
}

impl Manifest {
    /// SHA-256 of the content: of its JSON with sorted keys and without spaces. TOML and JSON of the same content have the
    /// same hash.
    pub fn hash(&self) -> String {
        let json = serde_json::to_value(self).map(sorted).unwrap_or_default();
        sha256(json.to_string().as_bytes())
    }

    /// What an evaluation needs: a reset per pair, in order.
    ///
    /// # Errors
    ///
    /// A value that is no number, text or list of numbers.
    pub fn resets(&self) -> Result<Vec<ResetOptions>, WorldError> {
        self.pairs.iter().map(|pair| Ok(pair.reset()?)).collect()
    }

    /// The rollout of these pairs, each from its own start.
    ///
    /// # Errors
    ///
    /// As of [`Manifest::resets`].
    pub fn rollout(&self, pairs: Range<u64>) -> Result<Rollout, WorldError> {
        Ok(Rollout::new(pairs).seed(self.seed).each(self.resets()?))
    }

    /// Refuses versions that this program does not know, and what can be no evaluation.
    ///
    /// # Errors
    ///
    /// [`WorldError::Option`], which says what is wrong.
    pub fn check(&self) -> Result<(), WorldError> {
        let wrong = |reason: String| Err(WorldError::Option { option: "manifest", reason });
        if self.version != MANIFEST_VERSION {
            let reason = format!("has version {}, this program reads {MANIFEST_VERSION}", self.version);
            return wrong(format!("{reason}; make it again with `swm manifest make`"));
        }
        if self.pairs.is_empty() {
            return wrong("holds no pairs".to_owned());
        }
        if let Some(phase) =
            self.pairs.iter().filter_map(|pair| pair.phase).find(|&phase| phase >= self.pairs.len())
        {
            return wrong(format!("has a pair of phase {phase}, and only {} pairs", self.pairs.len()));
        }
        if self.budget == 0 {
            return wrong("allows 0 actions; use 1 or more".to_owned());
        }
        if !self.distractors.is_empty() && self.image.is_none() {
            return wrong("has distractors, which change images, and no image size; give one".to_owned());
        }
        Ok(())
    }

    /// How many phases its stream has; 1 if it is none.
    pub fn phases(&self) -> usize {
        let last = self.pairs.iter().filter_map(|pair| pair.phase).max();
        // Each has a pair, whatever a file says.
        last.map_or(1, |last| last.saturating_add(1)).min(self.pairs.len().max(1))
    }
}

impl Pair {
    /// The reset that gives its start and goal.
    ///
    /// # Errors
    ///
    /// A value that is no number, text or list of numbers.
    pub fn reset(&self) -> Result<ResetOptions, BatchError> {
        let values = |columns: &BTreeMap<String, Json>| -> Result<BTreeMap<String, Value>, BatchError> {
            columns.iter().map(|(name, json)| Ok((name.clone(), Value::from_json(name, json)?))).collect()
        };
        Ok(ResetOptions {
            variation: self.vary.clone(),
            variation_values: values(&self.set)?,
            start: self.start.as_ref().map(values).transpose()?,
            goal: self.goal.as_ref().map(values).transpose()?,
            goal_image: None,
            seed: Some(EpisodeSeed::new(self.seed as u64)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest() -> Manifest {
        Manifest {
            version: MANIFEST_VERSION,
            env: "swm/Toy-v0".to_owned(),
            settings: Map::new(),
            tier: Tier::Historic,
            budget: 5,
            frame_skip: 1,
            image: None,
            seed: 1,
            distractors: Vec::new(),
            success: SuccessRule::default(),
            source: PairSource::Online,
            excluded: Excluded::default(),
            solved_at_start: 0,
            pairs: vec![Pair {
                seed: 7,
                phase: None,
                vary: Some(Vec::new()),
                set: BTreeMap::from([("point.gain".to_owned(), 0.1.into())]),
                start: Some(BTreeMap::from([("state".to_owned(), Json::from(vec![0.1 + 0.2]))])),
                goal: None,
                from: None,
                goal_episode: None,
                witness: String::new(),
            }],
        }
    }

    #[test]
    fn the_hash_is_that_of_the_content() {
        let (first, mut second) = (manifest(), manifest());
        let text = serde_json::to_string_pretty(&first).unwrap();
        let again: Manifest = serde_json::from_str(&text).unwrap();
        assert_eq!((again.hash(), again), (first.hash(), first.clone()));
        // The order in which settings were given does not count.
        let (mut a, mut b) = (first.clone(), first.clone());
        a.settings = [("x".to_owned(), 1.into()), ("y".to_owned(), 2.into())].into_iter().collect();
        b.settings = [("y".to_owned(), 2.into()), ("x".to_owned(), 1.into())].into_iter().collect();
        assert_eq!(a.hash(), b.hash());
        second.pairs[0].seed = 8;
        assert_ne!(first.hash(), second.hash());
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn wrong_manifests_are_refused() {
        let message = |manifest: &Manifest| manifest.check().unwrap_err().to_string();
        assert!(message(&Manifest { version: 9, ..manifest() }).contains("version 9"));
        assert!(message(&Manifest { pairs: Vec::new(), ..manifest() }).contains("no pairs"));
        assert!(message(&Manifest { budget: 0, ..manifest() }).contains("0 actions"));
        let blind = Manifest { distractors: vec!["noise".to_owned()], ..manifest() };
        assert!(message(&blind).contains("no image size"));
        assert!(serde_json::from_str::<Manifest>("{\"version\":1,\"environment\":\"x\"}").is_err());
    }
}
