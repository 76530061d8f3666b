//! Batches of clips, read ahead by threads into tables that go round: the consumer takes a full one and gives back the
//! last. Batch `k` is always read by thread `k mod threads`, so their order is fixed without any sorting, and content
//! depends on no clock. Where the consumer is can be written down and taken up again.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};
use swm_core::seed::keyed;
use swm_core::{Batch, Schema};

use super::plan::Plan;
use super::reader::Reader;
use super::{BatchOptions, Loader, Table, lock, wrong};
use crate::error::DataError;

/// Batches that a thread may have read ahead, at most: their tables are made at once.
const MAX_AHEAD: usize = 1024;

/// A stream of batches, epoch after epoch.
///
/// [`Batches::next_batch`] fills a table of the caller's and allocates nothing; as an iterator it gives tables away, and
/// makes new ones. Both end at the end of an epoch, and then go on with the next.
pub struct Batches<T = Batch> {
    plan: Arc<Plan>,
    options: BatchOptions,
    /// Clips that this process gives in an epoch, before `drop_last`.
    clips: usize,
    lanes: Vec<Lane<T>>,
    /// Batches that are being read, the oldest first.
    pending: VecDeque<Pending>,
    /// The lane of the oldest one.
    turn: usize,
    next: Next,
    /// The last batch was the last of its epoch, and the caller has not been told.
    ended: bool,
    position: Position,
}

/// Where a [`Batches`] is: what its next batch will be. Small, and made to be stored with a training checkpoint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Position {
    /// The epoch, from 0.
    pub epoch: u64,
    /// Clips of the epoch that have been given.
    pub clip: u64,
    /// The seed of the order.
    pub shuffle: Option<u64>,
    /// All clips of the loader, as a check that it is the same.
    pub clips: u64,
    /// [`BatchOptions::shard`].
    #[serde(default = "undivided", skip_serializing_if = "is_undivided")]
    pub shard: (usize, usize),
}

fn undivided() -> (usize, usize) {
    (0, 1)
}

fn is_undivided(shard: &(usize, usize)) -> bool {
    *shard == undivided()
}

/// The next batch to be read.
struct Next {
    epoch: u64,
    clip: usize,
    /// The order of that epoch, once a batch of it has been handed out.
    order: Option<Arc<Vec<usize>>>,
}

/// A batch that is being read.
#[derive(Clone, Copy)]
struct Pending {
    epoch: u64,
    /// Clips of the epoch that have been given once this batch is.
    end: usize,
    last: bool,
}

/// One thread, and the channels to and from it.
struct Lane<T> {
    /// Closing it ends the thread.
    jobs: Option<SyncSender<Job<T>>>,
    done: Receiver<(T, Result<(), DataError>)>,
    thread: Option<JoinHandle<()>>,
}

struct Job<T> {
    batch: T,
    epoch: u64,
    order: Arc<Vec<usize>>,
    clips: Range<usize>,
}

impl<T: Table> Batches<T> {
    pub(super) fn new(
        loader: &Loader,
        options: &BatchOptions,
        position: Option<&Position>,
        mut table: impl FnMut() -> T,
    ) -> Result<Self, DataError> {
        let (rank, world) = options.shard;
        if rank >= world {
            return wrong("shard", format!("rank {rank} of {world}; use 0 to one less than their number"));
        }
        let (all, clips) = (loader.len(), loader.len() / world);
        if clips == 0 {
            return wrong("shard", format!("{all} clips are too few for {world} processes"));
        }
        if options.size == 0 {
            return wrong("size", "batches of 0 clips; use 1 or more");
        }
        if !(1..=MAX_AHEAD).contains(&options.ahead) {
            return wrong("ahead", format!("{} batches per thread; use 1 to {MAX_AHEAD}", options.ahead));
        }
        if options.drop_last && options.size > clips {
            return wrong(
                "drop_last",
                format!("no batch of {} is full: there are {clips} clips", options.size),
            );
        }
        let start =
            Position { epoch: 0, clip: 0, shuffle: options.shuffle, clips: all as u64, shard: options.shard };
        let position = position.cloned().unwrap_or_else(|| start.clone());
        let same = Position { epoch: position.epoch, clip: position.clip, ..start.clone() } == position;
        if !same || position.clip > clips as u64 {
            let reason = format!(
                "it was {} of {} clips with shuffle {:?} and shard {:?}, this loader has {all} clips, shuffle {:?} and \
                 shard {:?}",
                position.clip,
                position.clips,
                position.shuffle,
                position.shard,
                options.shuffle,
                options.shard
            );
            return wrong("position", reason);
        }
        // It fits: it is at most `clips`.
        let clip = position.clip as usize;
        let ahead = options.ahead;
        let dataset = lock(&loader.dataset);
        let lanes = (0..loader.threads)
            .map(|_| Lane::start(loader.plan.clone(), Reader::new(dataset.share()), ahead))
            .collect::<Result<Vec<_>, _>>()?;
        drop(dataset);
        let mut batches = Self {
            plan: loader.plan.clone(),
            options: *options,
            clips,
            pending: VecDeque::with_capacity(lanes.len() * ahead),
            lanes,
            turn: 0,
            next: Next { epoch: position.epoch, clip, order: None },
            ended: false,
            position,
        };
        if clip >= batches.epoch_len() {
            batches.ended = true;
            batches.next = Next { epoch: batches.position.epoch.saturating_add(1), clip: 0, order: None };
        }
        for turn in 0..batches.lanes.len() * ahead {
            let lane = turn % batches.lanes.len();
            batches.hand_out(lane, table())?;
        }
        Ok(batches)
    }

    /// The columns of a batch.
    pub fn schema(&self) -> &Arc<Schema> {
        &self.plan.schema
    }

    /// Where the stream is. With it, [`Loader::batches_from`] goes on with the batch that `next_batch` would give.
    pub fn position(&self) -> Position {
        self.position.clone()
    }

    /// Replaces the rows of `batch`, a table of this loader, by the next clips. `false` (and an unchanged table) at the
    /// end of an epoch; the call after that begins the next epoch, unless it was the last. After an error, the stream
    /// goes on with the batch after the one that could not be read.
    ///
    /// # Errors
    ///
    /// `batch` was made for another loader, or reading fails.
    pub fn next_batch(&mut self, batch: &mut T) -> Result<bool, DataError> {
        if batch.schema() != &*self.plan.schema {
            return wrong("batch", "it was made for another loader; use `new_batch`");
        }
        if self.ended {
            self.ended = false;
            let epoch = self.position.epoch.saturating_add(1);
            self.position = Position { epoch, clip: 0, ..self.position };
            return Ok(false);
        }
        let Some(pending) = self.pending.pop_front() else { return Ok(false) };
        let lane = self.turn;
        self.turn = (lane + 1) % self.lanes.len();
        let (mut full, read) = self.lanes[lane].done.recv().map_err(|_| gone())?;
        std::mem::swap(batch, &mut full);
        self.position = Position { epoch: pending.epoch, clip: pending.end as u64, ..self.position };
        self.ended = pending.last;
        self.hand_out(lane, full)?;
        read.map(|()| true)
    }

    /// Clips that an epoch gives.
    fn epoch_len(&self) -> usize {
        let clips = self.clips;
        if self.options.drop_last { clips - clips % self.options.size } else { clips }
    }

    /// Lets a lane read the next batch into `batch`, if there is one.
    fn hand_out(&mut self, lane: usize, batch: T) -> Result<(), DataError> {
        let Next { epoch, clip, order } = &mut self.next;
        if self.options.epochs.is_some_and(|epochs| *epoch >= epochs) {
            return Ok(());
        }
        let clips = self.plan.index.len();
        let order = order.get_or_insert_with(|| Arc::new(order_of(clips, &self.options, *epoch)));
        let (epoch, order) = (*epoch, order.clone());
        let first = *clip;
        let len = self.epoch_len();
        let end = (first + self.options.size).min(len);
        let last = end == len;
        self.next = match last {
            true => Next { epoch: epoch.saturating_add(1), clip: 0, order: None },
            false => Next { epoch, clip: end, order: Some(order.clone()) },
        };
        self.pending.push_back(Pending { epoch, end, last });
        let jobs = self.lanes[lane].jobs.as_ref().ok_or_else(gone)?;
        jobs.send(Job { batch, epoch, order, clips: first..end }).map_err(|_| gone())
    }
}

/// The clips of an epoch in their order, as far as they are this process's.
fn order_of(clips: usize, options: &BatchOptions, epoch: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..clips).collect();
    if let Some(seed) = options.shuffle {
        order.shuffle(&mut keyed(seed, "loader", [epoch, 0]));
    }
    match options.shard {
        (_, 1) => order,
        (rank, world) => order.into_iter().skip(rank).step_by(world).take(clips / world).collect(),
    }
}

fn gone() -> DataError {
    DataError::Loader { setting: "threads", reason: "a reading thread ended; make a new loader".to_owned() }
}

impl Batches {
    /// An empty table for [`Batches::next_batch`].
    pub fn new_batch(&self) -> Batch {
        Batch::new(self.plan.schema.clone(), 0)
    }
}

/// One epoch, then the next when it is called again.
impl Iterator for Batches {
    type Item = Result<Batch, DataError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut batch = self.new_batch();
        match self.next_batch(&mut batch) {
            Ok(true) => Some(Ok(batch)),
            Ok(false) => None,
            Err(error) => Some(Err(error)),
        }
    }
}

impl<T: Table> Lane<T> {
    fn start(plan: Arc<Plan>, mut reader: Reader, ahead: usize) -> Result<Self, DataError> {
        // No more tables than `ahead` go round, so neither channel is ever full.
        let (jobs, todo) = sync_channel::<Job<T>>(ahead);
        let (finished, done) = sync_channel(ahead);
        let work = move || {
            while let Ok(Job { mut batch, epoch, order, clips }) = todo.recv() {
                batch.resize(clips.len());
                let read = reader.read(&plan, epoch, &order[clips], batch.rows_mut());
                if finished.send((batch, read)).is_err() {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("swm-loader".to_owned()).spawn(work);
        let thread =
            thread.map_err(|error| DataError::Loader { setting: "threads", reason: error.to_string() })?;
        Ok(Self { jobs: Some(jobs), done, thread: Some(thread) })
    }
}

impl<T> Drop for Lane<T> {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was reported when its batch was asked for.
            let _ = thread.join();
        }
    }
}
