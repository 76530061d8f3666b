//! The windowed loader: clips of `num_steps` rows at a `frameskip`, for training world models.
//!
//! A clip spans `num_steps × frameskip` rows of one episode. Columns are taken every `frameskip` rows and have the
//! shape `[num_steps, …]`; the column `action` stays dense, since all actions between two observations matter, and
//! has the shape `[num_steps, frameskip × A]`. Batches are filled by several threads into tables that are reused;
//! what they hold depends on nothing but the dataset, the options, the seeds and the epoch.

mod batches;
mod clips;
mod decoded;
mod floats;
mod goals;
mod images;
mod options;
mod plan;
mod reader;
mod table;

use std::iter::repeat_with;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;
use swm_core::{Batch, Schema};

use crate::dataset::Dataset;
use crate::error::DataError;

pub use batches::{Batches, Position};
pub use clips::{Clip, Clips};
pub use decoded::CachedImages;
pub use options::{BatchOptions, CacheOptions, ClipOptions, GoalOptions, GoalWeights, Images, Rewards};
pub use table::Table;

use plan::Plan;
use reader::Reader;

/// Reads clips of one dataset: single ones by their number with [`Loader::read`], all of them with
/// [`Loader::batches`].
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{Rollout, World, WorldOptions, policies};
/// use swm_data::{BatchOptions, ClipOptions, Loader, ReplayBuffer};
///
/// // Any dataset will do: `swm_data::open` opens files, a buffer lends its episodes.
/// let mut world = World::new(&TOY, WorldOptions::default().max_episode_steps(20))?;
/// world.set_policy(policies::random())?;
/// let mut buffer = ReplayBuffer::new(1000);
/// let rollout = Rollout::new(0..8);
/// world.record_dataset(&rollout, &mut buffer)?;
///
/// let clips = ClipOptions::default().num_steps(3).frameskip(2);
/// let loader = Loader::new(Box::new(buffer.dataset()?), &clips)?;
/// let mut batches = loader.batches(&BatchOptions::default().size(16).shuffle(Some(42)))?;
/// let mut batch = batches.new_batch();
/// assert!(batches.next_batch(&mut batch)?);
/// assert_eq!(batch.get::<f64>("state")?.len(), 16 * 3); // [16, 3, 1]
/// assert_eq!(batch.get::<f32>("action")?.len(), 16 * 3 * 2); // [16, 3, 2 × 1]
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Loader {
    plan: Arc<Plan>,
    threads: usize,
    /// Opens more handles.
    dataset: Mutex<Box<dyn Dataset>>,
    /// Handles that no call uses.
    idle: Mutex<Vec<Reader>>,
    cached: Vec<CachedImages>,
}

impl Loader {
    /// Checks the options against the dataset.
    ///
    /// # Errors
    ///
    /// Unknown columns, options out of their bounds, or no episode that is long enough for a clip. With [`ClipOptions::cache`]: the images
    /// need more bytes than its limit, cannot be decoded or written, or are not those of files.
    pub fn new(dataset: Box<dyn Dataset>, options: &ClipOptions) -> Result<Self, DataError> {
        let mut plan = Plan::new(dataset.as_ref(), options)?;
        let threads = match options.threads {
            Some(0) => return wrong("threads", "0; use 1 or more"),
            Some(threads @ 1..=MAX_THREADS) => threads,
            Some(threads) => return wrong("threads", format!("{threads} is more than {MAX_THREADS}")),
            None => std::thread::available_parallelism().map_or(1, usize::from),
        };
        let (mut dataset, mut cached) = (dataset, Vec::new());
        if let Some(cache) = &options.cache {
            (dataset, cached) = decoded::cached(dataset, &plan, cache, threads)?;
            plan = Plan::new(dataset.as_ref(), options)?;
        }
        let (plan, dataset) = (Arc::new(plan), Mutex::new(dataset));
        Ok(Self { plan, threads, dataset, idle: Mutex::default(), cached })
    }

    /// The files of decoded images that clips are read from, with what they cost: one per column.
    pub fn cached(&self) -> &[CachedImages] {
        &self.cached
    }

    /// So many readers that no other call uses.
    fn readers(&self, count: usize) -> Vec<Reader> {
        let mut idle = lock(&self.idle);
        let kept = idle.len().saturating_sub(count);
        let mut readers = idle.split_off(kept);
        drop(idle);
        let missing = count - readers.len();
        let dataset = lock(&self.dataset);
        readers.extend(repeat_with(|| Reader::new(dataset.share())).take(missing));
        readers
    }

    /// The number of clips.
    pub fn len(&self) -> usize {
        self.plan.index.len()
    }

    /// Never true: a loader without clips is an error.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where clip `index` lies; `None` if there is no such clip.
    pub fn clip(&self, index: usize) -> Option<Clip> {
        self.plan.index.get(index)
    }

    /// The episode and row of the goal that clip `index` gets in this epoch; `None` without goals or such a clip.
    pub fn goal(&self, index: usize, epoch: u64) -> Option<(usize, usize)> {
        let clip = self.clip(index)?;
        self.plan.goals.as_ref().map(|goals| goals.draw(epoch, index, clip))
    }

    /// The columns of a batch: one row per clip, shapes `[num_steps, …]`.
    pub fn schema(&self) -> &Arc<Schema> {
        &self.plan.schema
    }

    /// An empty table for [`Loader::read`] and [`Batches::next_batch`].
    pub fn new_batch(&self) -> Batch {
        Batch::new(self.plan.schema.clone(), 0)
    }

    /// Reads ahead on threads of its own, from the first clip of the first epoch on.
    ///
    /// # Errors
    ///
    /// Options out of their bounds: a size of 0, or more than the dataset has with `drop_last`. What reading meets comes from
    /// [`Batches::next_batch`].
    pub fn batches(&self, options: &BatchOptions) -> Result<Batches, DataError> {
        self.batches_into(options, None, || self.new_batch())
    }

    /// As [`Loader::batches`] or, with a position, [`Loader::batches_from`], into tables of the caller's making: `table`
    /// makes empty ones with the columns of [`Loader::schema`].
    ///
    /// # Errors
    ///
    /// As of [`Loader::batches_from`].
    pub fn batches_into<T: Table>(
        &self,
        options: &BatchOptions,
        position: Option<&Position>,
        table: impl FnMut() -> T,
    ) -> Result<Batches<T>, DataError> {
        Batches::new(self, options, position, table)
    }

    /// As [`Loader::batches`], going on at a [`Position`] that a loader of the same dataset and options has reached.
    ///
    /// # Errors
    ///
    /// As of [`Loader::batches`]; and a position of another dataset or other options.
    pub fn batches_from(&self, options: &BatchOptions, position: &Position) -> Result<Batches, DataError> {
        self.batches_into(options, Some(position), || self.new_batch())
    }

    /// Reads clips into `out`, a table of this loader; its old rows are replaced, its memory is reused. Goals are those
    /// of epoch 0. Several threads may read at once.
    ///
    /// # Errors
    ///
    /// `out` was made for another loader, no such clip, or reading fails.
    pub fn read(&self, clips: &[usize], out: &mut impl Table) -> Result<(), DataError> {
        self.read_in(0, clips, out)
    }

    /// As [`Loader::read`], with the goals of another epoch.
    ///
    /// # Errors
    ///
    /// As of [`Loader::read`].
    pub fn read_in(&self, epoch: u64, clips: &[usize], out: &mut impl Table) -> Result<(), DataError> {
        if out.schema() != &*self.plan.schema {
            return wrong("batch", "it was made for another loader; use `new_batch`");
        }
        out.resize(clips.len());
        let plan = &self.plan;
        let per_reader = clips.len().div_ceil(self.threads).max(1);
        let mut readers = self.readers(clips.len().div_ceil(per_reader));
        let mut rest = out.rows_mut();
        let mut jobs = Vec::with_capacity(readers.len());
        for (reader, clips) in readers.iter_mut().zip(clips.chunks(per_reader)) {
            let (part, after) = rest.split_at(clips.len());
            rest = after;
            jobs.push(move || reader.read(plan, epoch, clips, part));
        }
        // Of several errors, the one that comes first in the batch.
        let read = match jobs.len() {
            1 => jobs.into_iter().try_for_each(|job| job()),
            _ => jobs.into_par_iter().map(|job| job()).collect::<Vec<_>>().into_iter().collect(),
        };
        let mut idle = lock(&self.idle);
        idle.append(&mut readers);
        idle.truncate(self.threads);
        read
    }
}

/// Whatever a panicking thread left behind is whole: only whole values are put in.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// More in one process are a typing error.
const MAX_THREADS: usize = 1024;

fn wrong<T>(setting: &'static str, reason: impl Into<String>) -> Result<T, DataError> {
    Err(DataError::Loader { setting, reason: reason.into() })
}
