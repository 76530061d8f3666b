//! The state of a job in the queues of engines: its tasks, and the shards that they run.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::engine::{Engine, Queued, Submission, engine};
use crate::error::JobError;
use crate::job::JobFolder;
use crate::progress::shards_of;

/// Engines are asked so often at most, while somebody watches.
pub(crate) const ASK_EVERY: Duration = Duration::from_secs(30);

/// The shards of a job that are queued or run, and when the engines were queried.
#[derive(Debug)]
pub struct QueueState {
    pub(crate) shards: BTreeMap<u64, Queued>,
    asked: Instant,
}

impl QueueState {
    /// Asks the engines. With an error, that of an engine which does not answer, no shards: the files are shown alone.
    pub fn of(folder: &JobFolder) -> (Self, Option<JobError>) {
        let held = Submission::all(folder).and_then(|before| {
            let shards = folder.job.shards;
            Ok(queued_shards(&queued(folder, &before, None)?, &before, shards, shards))
        });
        let (shards, error) = match held {
            Ok(shards) => (shards, None),
            Err(error) => (BTreeMap::new(), Some(error)),
        };
        (Self { shards, asked: Instant::now() }, error)
    }

    /// Whether engines may be asked again.
    pub fn is_old(&self) -> bool {
        self.asked.elapsed() >= ASK_EVERY
    }
}

/// The tasks that engines hold: those of former submissions, and of `another`, to which one may have been handed without a trace.
pub(crate) fn queued(
    folder: &JobFolder,
    before: &[Submission],
    another: Option<&'static Engine>,
) -> Result<Vec<Queued>, JobError> {
    let mut engines: BTreeMap<&str, &Engine> = another.iter().map(|&engine| (engine.name, engine)).collect();
    for submission in before {
        let (engine, _) = engine(&submission.on)?;
        engines.insert(engine.name, engine);
    }
    let mut all = Vec::new();
    for engine in engines.values() {
        let held = engine.driver.queued(folder);
        all.extend(held.map_err(|error| JobError::Queue(Box::new(error)))?);
    }
    Ok(all)
}

/// The shards of queued tasks. What `entries` were when a task was submitted says which shards it runs.
pub(crate) fn queued_shards(
    tasks: &[Queued],
    before: &[Submission],
    entries: u64,
    shards: u64,
) -> BTreeMap<u64, Queued> {
    let mut held = BTreeMap::new();
    for task in tasks {
        let Some(entry) = task.entry else { continue };
        let of = before.iter().find(|submission| submission.id == task.id);
        let entries = of.map_or(entries, |submission| submission.entries);
        held.extend(shards_of(entry, entries, shards).map(|shard| (shard, task.clone())));
    }
    held
}
