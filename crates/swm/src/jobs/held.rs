//! What engines hold of a job: its tasks, and the shards that they run.

use std::collections::BTreeMap;

use super::JobFolder;
use super::engine::{Engine, Queued, Submission};
use super::error::JobError;
use super::progress::shards_of;

/// The tasks that engines hold: those of former submissions, and of `engine`, to which one may have been handed without a trace.
pub(crate) fn queued(
    folder: &JobFolder,
    before: &[Submission],
    engine: Option<&'static Engine>,
) -> Result<Vec<Queued>, JobError> {
    let mut engines: BTreeMap<&str, &Engine> = engine.iter().map(|&engine| (engine.name, engine)).collect();
    for submission in before {
        let (engine, _) = super::engine(&submission.on)?;
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
pub(crate) fn held_shards(
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
