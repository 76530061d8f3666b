//! Datasets as the core sees them: a sink of whole episodes, a source of rows, and what is written about them.
//! No file format is known here.

mod restore;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::batch::{Batch, Field, Schema};
use crate::env::{ImageSize, ResetOptions, VARIATION_PREFIX, selects};
use crate::error::{BoxError, WorldError};
use crate::recorder::{LiveRow, Recorder};
use crate::run::{EpisodeEnd, Rollout, RunInfo};
use crate::world::World;

pub use crate::checkpoint::{CHECKPOINT, Checkpoints};
pub use restore::{read_known, read_row, recorded_moment, whole_episode};

/// Takes whole episodes, in the order of their index.
pub trait EpisodeSink: Send {
    /// Called once, before the first episode: the columns (kind tells step from episode columns) and what is
    /// known of the data. Returns how many episodes the dataset holds already.
    ///
    /// # Errors
    ///
    /// What is there has other columns or settings, or cannot be written.
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError>;

    /// Appends one episode; row = step. When it returns, the episode is safe: a crash cannot lose it.
    ///
    /// # Errors
    ///
    /// The rows have other columns than were committed, or cannot be written. The episode is then not part of the
    /// dataset.
    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError>;

    /// Ends the dataset cleanly.
    ///
    /// # Errors
    ///
    /// The rest cannot be written.
    fn finish(&mut self) -> Result<(), BoxError>;
}

/// Gives rows of recorded episodes.
pub trait EpisodeSource: Send {
    /// What it holds.
    fn contents(&self) -> &Contents;

    /// Reads rows of one episode into `out`, whose schema names the wanted columns; its old rows are replaced.
    ///
    /// # Errors
    ///
    /// No such episode, rows or columns, or what is stored cannot be read.
    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError>;

    /// The columns.
    fn schema(&self) -> &Arc<Schema> {
        &self.contents().schema
    }

    /// The number of episodes.
    fn num_episodes(&self) -> usize {
        self.contents().lengths.len()
    }

    /// The number of rows of one episode; 0 for one that does not exist.
    fn episode_len(&self, episode: usize) -> usize {
        self.contents().len_of(episode)
    }

    /// What is known of the data; `None` for files that say nothing of themselves.
    fn metadata(&self) -> Option<&Metadata> {
        self.contents().metadata()
    }
}

/// What a source of episodes holds: known once it is open, and the same as long as it is. Cheap to clone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contents {
    /// The columns.
    pub schema: Arc<Schema>,
    /// The number of rows, by episode.
    pub lengths: Arc<[usize]>,
    /// The runs that recorded it, each with its first episode; empty for files that say nothing of themselves.
    pub runs: Arc<[(u64, Metadata)]>,
}

impl Contents {
    /// The number of rows of one episode; 0 for one that does not exist.
    pub fn len_of(&self, episode: usize) -> usize {
        self.lengths.get(episode).copied().unwrap_or(0)
    }

    /// What the first run said of the data; `None` for files that say nothing of themselves.
    pub fn metadata(&self) -> Option<&Metadata> {
        self.runs.first().map(|(_, metadata)| metadata)
    }
}

/// What a dataset says of itself, so that it can be repeated and checked. It holds nothing that does not change
/// the content: no time, host, thread count or number of environments.
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
    /// The policy, in words.
    pub policy: String,
    /// The factors that were asked to be drawn; `None`: the environment's default list.
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
    /// What drew the images, in words, where there is a choice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renderer: Option<String>,
    /// Time limit of an episode.
    #[serde(default)]
    pub max_episode_steps: Option<u64>,
    /// Environment steps per row.
    #[serde(default = "one")]
    pub frame_skip: u32,
    /// Rows from one checkpoint to the next in the column `checkpoint`; `None`: it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checkpoints: Option<u32>,
    /// Versions of the packages that made it.
    #[serde(default)]
    pub packages: BTreeMap<String, String>,
}

fn one() -> u32 {
    1
}

/// The version of [`Metadata`] that is written.
pub const METADATA_VERSION: u32 = 1;

impl Metadata {
    /// What can be said of a run.
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
            checkpoints: run.options.checkpoints,
            packages: BTreeMap::from([("swm-core".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]),
        }
    }
}

/// A recorder that hands whole episodes to a sink, in the order of their index, whatever the order in which they
/// end.
pub struct DatasetRecorder<'a> {
    sink: &'a mut dyn EpisodeSink,
    schema: Arc<Schema>,
    /// For every column of the dataset, its position in the infos.
    from: Vec<usize>,
    /// Episodes that run or wait for an earlier one.
    open: BTreeMap<u64, Buffered>,
    spare: Vec<Batch>,
    next: u64,
}

struct Buffered {
    rows: Batch,
    complete: bool,
}

impl<'a> DatasetRecorder<'a> {
    /// Records into `sink`.
    pub fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        let schema = Arc::new(Schema::default());
        Self { sink, schema, from: Vec::new(), open: BTreeMap::new(), spare: Vec::new(), next: 0 }
    }

    /// The columns of the dataset: all infos, except those that the world was told to leave out, and factors that
    /// were neither drawn nor set.
    fn choose_columns(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        let varied = varied_factors(run);
        let unrecorded = &run.options.unrecorded;
        let wanted = |field: &Field| match field.name.strip_prefix(VARIATION_PREFIX) {
            _ if unrecorded.contains(&field.name) => false,
            Some(factor) => varied.contains(factor),
            None => true,
        };
        let fields = run.schema.fields().iter().enumerate().filter(|(_, field)| wanted(field));
        let (from, fields): (Vec<_>, Vec<_>) = fields.map(|(index, field)| (index, field.clone())).unzip();
        self.schema = Schema::new(fields)?;
        self.from = from;
        Ok(())
    }
}

/// The factors that a run draws or sets.
fn varied_factors(run: &RunInfo<'_>) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut add = |options: &ResetOptions| {
        for factor in &run.spec.factors {
            let drawn = match &options.variation {
                None => factor.drawn_by_default,
                Some(list) => list.iter().any(|asked| selects(asked, &factor.name)),
            };
            if drawn || options.variation_values.contains_key(&factor.name) {
                names.insert(factor.name.clone());
            }
        }
    };
    run.rollout.all_options().iter().for_each(&mut add);
    names
}

impl Recorder for DatasetRecorder<'_> {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        self.choose_columns(run)?;
        self.next = run.rollout.episodes.start;
        let held = self.sink.begin(&self.schema, &Metadata::of(run))?;
        if held != self.next {
            let next = self.next;
            return Err(
                format!("the dataset holds {held} episodes, so {held} must come next, not {next}").into()
            );
        }
        Ok(())
    }

    fn step(&mut self, row: &LiveRow<'_>) -> Result<(), BoxError> {
        let buffered = self.open.entry(row.episode.index).or_insert_with(|| {
            let mut rows = self.spare.pop().unwrap_or_else(|| Batch::new(self.schema.clone(), 0));
            rows.clear();
            Buffered { rows, complete: false }
        });
        Ok(buffered.rows.push_row(row.values, &self.from)?)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        if let Some(buffered) = self.open.get_mut(&end.index) {
            buffered.complete = true;
        }
        while self.open.get(&self.next).is_some_and(|buffered| buffered.complete) {
            let Some(buffered) = self.open.remove(&self.next) else { break };
            self.sink.write_episode(&buffered.rows)?;
            self.spare.push(buffered.rows);
            self.next += 1;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.sink.finish()
    }
}

impl World {
    /// Records the episodes of `rollout` into `sink`, in the order of their index.
    ///
    /// # Errors
    ///
    /// As [`World::run`], and what writing meets; episodes that were committed before are safe.
    pub fn record_dataset(
        &mut self,
        rollout: &Rollout,
        sink: &mut dyn EpisodeSink,
    ) -> Result<(), WorldError> {
        self.run(rollout, &mut DatasetRecorder::new(sink))
    }

    /// As [`World::record_dataset`], watched by another recorder too.
    ///
    /// # Errors
    ///
    /// As [`World::record_dataset`], and whatever `recorder` meets.
    pub fn record_dataset_with(
        &mut self,
        rollout: &Rollout,
        sink: &mut dyn EpisodeSink,
        recorder: &mut dyn Recorder,
    ) -> Result<(), WorldError> {
        self.run(rollout, &mut (DatasetRecorder::new(sink), recorder))
    }
}
