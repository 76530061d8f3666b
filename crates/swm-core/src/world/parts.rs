//! Recorders of which every environment has a part of its own, so that environments need not wait for each other.

use std::sync::{Mutex, PoisonError};

use crate::error::BoxError;
use crate::recorder::{LiveStep, Recorder};
use crate::run::{EpisodeEnd, RunInfo};
use crate::threads::lock;

/// A recorder that can be divided once it has been told of the start of a run. It alone is told of the finish.
pub(crate) trait Whole: Recorder {
    /// A part for the steps and ends of one environment; `None`: it cannot be divided.
    fn part(&self) -> Option<Box<dyn Part + '_>>;
}

/// What watches one environment.
pub(crate) trait Part: Recorder {
    /// Whether another episode may begin; else it waits.
    fn has_room(&self) -> bool;
}

impl Part for Box<dyn Part + '_> {
    fn has_room(&self) -> bool {
        (**self).has_room()
    }
}

impl<A: Whole, B: Whole> Whole for (A, B) {
    fn part(&self) -> Option<Box<dyn Part + '_>> {
        Some(Box::new((self.0.part()?, self.1.part()?)))
    }
}

impl<A: Part, B: Part> Part for (A, B) {
    fn has_room(&self) -> bool {
        self.0.has_room() && self.1.has_room()
    }
}

/// Any recorder: its parts pass on to it, one at a time.
pub(crate) struct Watcher<'a>(Mutex<&'a mut dyn Recorder>);

impl<'a> Watcher<'a> {
    pub(crate) fn new(recorder: &'a mut dyn Recorder) -> Self {
        Self(Mutex::new(recorder))
    }

    fn inner(&mut self) -> &mut dyn Recorder {
        *self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Recorder for Watcher<'_> {
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

impl Whole for Watcher<'_> {
    fn part(&self) -> Option<Box<dyn Part + '_>> {
        Some(Box::new(Watching(&self.0)))
    }
}

/// A part of a [`Watcher`].
struct Watching<'s, 'a>(&'s Mutex<&'a mut dyn Recorder>);

impl Recorder for Watching<'_, '_> {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        lock(self.0).step(row)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        lock(self.0).episode(end)
    }
}

impl Part for Watching<'_, '_> {
    fn has_room(&self) -> bool {
        true
    }
}
