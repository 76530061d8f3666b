//! Recorders that split into one shard per environment, so that environments need not wait for each other.

use std::sync::{Mutex, PoisonError};

use crate::error::BoxError;
use crate::recorder::{LiveStep, Recorder};
use crate::run::{EpisodeEnd, RunInfo};
use crate::threads::lock;

/// A recorder that can be split after its `start`. Its shards get neither `start` nor `finish`.
pub(crate) trait SplitRecorder: Recorder {
    /// A shard for the steps and ends of one environment; `None`: it cannot be split.
    fn shard(&self) -> Option<Box<dyn RecorderShard + '_>>;
}

/// The recorder of one environment.
pub(crate) trait RecorderShard: Recorder {
    /// Whether another episode may begin; else it waits.
    fn has_room(&self) -> bool;
}

impl RecorderShard for Box<dyn RecorderShard + '_> {
    fn has_room(&self) -> bool {
        (**self).has_room()
    }
}

impl<A: SplitRecorder, B: SplitRecorder> SplitRecorder for (A, B) {
    fn shard(&self) -> Option<Box<dyn RecorderShard + '_>> {
        Some(Box::new((self.0.shard()?, self.1.shard()?)))
    }
}

impl<A: RecorderShard, B: RecorderShard> RecorderShard for (A, B) {
    fn has_room(&self) -> bool {
        self.0.has_room() && self.1.has_room()
    }
}

/// Makes any recorder a [`SplitRecorder`]: its shards call it, one at a time.
pub(crate) struct SharedRecorder<'a>(Mutex<&'a mut dyn Recorder>);

impl<'a> SharedRecorder<'a> {
    pub(crate) fn new(recorder: &'a mut dyn Recorder) -> Self {
        Self(Mutex::new(recorder))
    }

    fn inner(&mut self) -> &mut dyn Recorder {
        *self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Recorder for SharedRecorder<'_> {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        self.inner().start(run)
    }

    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        self.inner().step(row)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.inner().episode(end)
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.inner().finish()
    }
}

impl SplitRecorder for SharedRecorder<'_> {
    fn shard(&self) -> Option<Box<dyn RecorderShard + '_>> {
        Some(Box::new(SharedShard(&self.0)))
    }
}

/// A shard of a [`SharedRecorder`].
struct SharedShard<'s, 'a>(&'s Mutex<&'a mut dyn Recorder>);

impl Recorder for SharedShard<'_, '_> {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        lock(self.0).step(row)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        lock(self.0).episode(end)
    }
}

impl RecorderShard for SharedShard<'_, '_> {
    fn has_room(&self) -> bool {
        true
    }
}
