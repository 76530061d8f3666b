//! The replay buffer of online learning: the last episodes, whole, in memory. It is a sink, so a world records into it;
//! it gives datasets, so loaders read it and writers of any format take it over.
//!
//! What is drawn from it is a function of its content, the seed and the step, like everything else. It computes no
//! rewards: relabeled goals come as columns, and what they are worth is the task's affair.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rand::RngExt as _;
use swm_core::error::BoxError;
use swm_core::seed::keyed;
use swm_core::{Batch, EpisodeSink, Metadata, Registry, Schema};

use crate::dataset::{Dataset, WriteMode};
use crate::error::DataError;
use crate::format;
use crate::loader::{ClipOptions, Loader};
use crate::memory::MemoryDataset;

/// The name that stands for the path in messages.
const NAME: &str = "replay buffer";

/// A ring of whole episodes. When a new one does not fit, the oldest leave.
///
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{Batch, Rollout, World, WorldOptions, policies};
/// use swm_data::{ClipOptions, ReplayBuffer, Sampler};
///
/// let mut world = World::new(&TOY, WorldOptions::default().max_episode_steps(20))?;
/// world.set_policy(policies::random())?;
/// let mut buffer = ReplayBuffer::new(1000); // rows
/// let rollout = Rollout::new(0..8);
/// world.record_dataset(&rollout, &mut buffer)?;
///
/// let mut sampler = Sampler::new(ClipOptions::default().num_steps(3), 42);
/// let mut batch = Batch::new(Default::default(), 0);
/// sampler.sample(&buffer, 16, 0, &mut batch)?; // of step 0 of a training: 16 clips of 3 rows
/// assert_eq!(batch.rows(), 16);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ReplayBuffer {
    capacity: usize,
    content: Option<(Arc<Schema>, Metadata)>,
    episodes: VecDeque<Arc<Batch>>,
    rows: usize,
    /// Episodes that were ever written.
    written: u64,
}

impl ReplayBuffer {
    /// An empty buffer for at most `capacity` rows.
    pub fn new(capacity: usize) -> Self {
        Self { capacity, content: None, episodes: VecDeque::new(), rows: 0, written: 0 }
    }

    /// The last episodes of a dataset, as many as fit.
    ///
    /// # Errors
    ///
    /// Reading fails.
    pub fn load(dataset: &mut dyn Dataset, capacity: usize) -> Result<Self, DataError> {
        let mut buffer = Self::new(capacity);
        let schema = dataset.schema().clone();
        let (mut first, mut rows) = (dataset.num_episodes(), 0);
        while let Some(earlier) = first.checked_sub(1) {
            rows += dataset.episode_len(earlier);
            if rows > capacity {
                break;
            }
            first = earlier;
        }
        buffer.content = Some((schema.clone(), dataset.metadata().cloned().unwrap_or_default()));
        buffer.written = first as u64;
        let mut batch = Batch::new(schema, 0);
        for episode in first..dataset.num_episodes() {
            dataset.read(episode, 0..dataset.episode_len(episode), &mut batch)?;
            buffer.push(&batch)?;
        }
        Ok(buffer)
    }

    /// The number of rows that it holds.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The number of episodes that it holds.
    pub fn num_episodes(&self) -> usize {
        self.episodes.len()
    }

    /// The number of episodes that were ever written; a world continues with this episode.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Its episodes of this moment as a dataset, without copying them.
    ///
    /// # Errors
    ///
    /// [`DataError::Request`]: nothing was recorded yet.
    pub fn dataset(&self) -> Result<MemoryDataset, DataError> {
        let Some((schema, metadata)) = &self.content else {
            return Err(DataError::request(Path::new(NAME), "nothing was recorded into it yet"));
        };
        MemoryDataset::new(NAME, schema.clone(), Some(metadata.clone()), self.episodes.iter().cloned())
    }

    /// Writes its episodes to a file or folder of any format of this crate (`None`: by the extension).
    ///
    /// # Errors
    ///
    /// Nothing was recorded yet, no format has this name or extension, or writing fails.
    pub fn dump(&self, path: &Path, mode: WriteMode, format: Option<&str>) -> Result<(), DataError> {
        self.dump_in(format::built_in(), path, mode, format)
    }

    /// As [`ReplayBuffer::dump`], in any format of a registry.
    ///
    /// # Errors
    ///
    /// As of [`ReplayBuffer::dump`].
    pub fn dump_in(
        &self,
        registry: &Registry,
        path: &Path,
        mode: WriteMode,
        format: Option<&str>,
    ) -> Result<(), DataError> {
        let Some((schema, metadata)) = &self.content else {
            return Err(DataError::request(Path::new(NAME), "nothing was recorded into it yet"));
        };
        let failed = |error: BoxError| match error.downcast::<DataError>() {
            Ok(error) => *error,
            Err(error) => DataError::record(path, error.to_string()),
        };
        let mut writer = format::create_in(registry, path, &mode.into(), format)?;
        writer.begin(schema, metadata).map_err(failed)?;
        for episode in &self.episodes {
            writer.write_episode(episode).map_err(failed)?;
        }
        writer.finish().map_err(failed)
    }

    fn push(&mut self, rows: &Batch) -> Result<(), DataError> {
        let refuse = |reason| Err(DataError::record(Path::new(NAME), reason));
        let Some((schema, _)) = &self.content else {
            return refuse("no recording is going on".to_owned());
        };
        if rows.schema() != schema {
            return refuse("the episode has other columns than the buffer".to_owned());
        }
        if rows.rows() > self.capacity {
            return refuse(format!(
                "an episode of {} rows does not fit into {}; use a larger capacity or a shorter time limit",
                rows.rows(),
                self.capacity
            ));
        }
        let mut spare = None;
        while self.rows + rows.rows() > self.capacity {
            let Some(oldest) = self.episodes.pop_front() else { break };
            self.rows -= oldest.rows();
            // Its memory is used again, unless a loader still reads it.
            spare = Arc::into_inner(oldest).or(spare);
        }
        let mut kept = spare.unwrap_or_else(|| Batch::new(rows.schema().clone(), 0));
        kept.resize(rows.rows());
        for column in 0..rows.schema().fields().len() {
            assert!(kept.column_mut(column).copy_from(rows.column(column)), "one schema made both");
        }
        self.rows += kept.rows();
        self.written += 1;
        self.episodes.push_back(Arc::new(kept));
        Ok(())
    }
}

impl EpisodeSink for ReplayBuffer {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        if let Some((held, _)) = &self.content
            && held != schema
        {
            let reason = "it holds episodes with other columns; make a new buffer";
            return Err(DataError::record(&PathBuf::from(NAME), reason).into());
        }
        self.content = Some((schema.clone(), metadata.clone()));
        Ok(self.written)
    }

    fn holds(&self, column: &str) -> bool {
        self.content.as_ref().is_some_and(|(held, _)| held.index(column).is_some())
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        Ok(self.push(rows)?)
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

/// Draws batches of clips from a buffer that grows: each clip uniform over all clips that it holds.
pub struct Sampler {
    options: ClipOptions,
    seed: u64,
    /// The loader of the buffer's content, and the number of episodes that had been written.
    loader: Option<(u64, Loader)>,
    clips: Vec<usize>,
}

impl Sampler {
    /// Clips of these options. Goals of [`crate::loader::GoalOptions::hindsight`] relabel them.
    pub fn new(options: ClipOptions, seed: u64) -> Self {
        Self { options, seed, loader: None, clips: Vec::new() }
    }

    /// Draws `size` clips for step `step` of a training, with replacement. `out` becomes a table of clips; the same one
    /// again keeps its memory. Equal content, seed and step give equal clips.
    ///
    /// # Errors
    ///
    /// The buffer is empty or has no episode that is long enough, or the options do not fit its columns.
    pub fn sample(
        &mut self,
        buffer: &ReplayBuffer,
        size: usize,
        step: u64,
        out: &mut Batch,
    ) -> Result<(), DataError> {
        let current = self.loader.take().filter(|(written, _)| *written == buffer.written);
        let (_, loader) = match current {
            Some(current) => self.loader.insert(current),
            None => {
                let loader = Loader::new(Box::new(buffer.dataset()?), &self.options)?;
                self.loader.insert((buffer.written, loader))
            }
        };
        if out.schema() != loader.schema() {
            *out = loader.new_batch();
        }
        let mut rng = keyed(self.seed, "replay", [step, 0]);
        self.clips.clear();
        self.clips.extend((0..size).map(|_| rng.random_range(0..loader.len())));
        loader.read_in(step, &self.clips, out)
    }
}
