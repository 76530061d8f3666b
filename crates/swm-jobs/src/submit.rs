//! Submitting a job: what is neither done nor queued goes to an engine, and then the join of the shards.

use std::collections::BTreeSet;
use std::thread::sleep;
use std::time::Duration;

use serde_json::{Value as Json, json};

use crate::engine::{Engine, Request, Settings, Submission};
use crate::error::JobError;
use crate::files::{now, ranges};
use crate::job::JobFolder;
use crate::progress::Progress;
use crate::queue_state::{ASK_EVERY, queued, queued_shards};

/// A job and the engine that gets it.
#[derive(Debug)]
pub struct Handover<'a> {
    /// The job.
    pub folder: &'a JobFolder,
    /// The engine.
    pub engine: &'static Engine,
    /// Its settings.
    pub settings: &'a Settings,
    /// Engine and settings, as they were given.
    pub on: &'a str,
}

/// What was handed over.
#[derive(Clone, Debug)]
pub struct Submitted {
    /// The shards.
    pub shards: Vec<u64>,
    /// Shards that are done.
    pub done: usize,
    /// Shards that engines hold already.
    pub queued: usize,
    /// The engine's name for it.
    pub id: Option<String>,
    /// Whether only the join was left.
    pub is_finish: bool,
    /// Whether the engine got something.
    pub is_submitted: bool,
    /// What the engine got, or would get.
    pub script: String,
}

impl Handover<'_> {
    /// Hands over the shards that are neither done nor queued, and their join. `before`: the submissions of the job. `is_dry`: only the
    /// script is made.
    ///
    /// # Errors
    ///
    /// A setting is wrong, a file cannot be read or written, or the engine refuses it.
    pub fn send(&self, before: &[Submission], is_dry: bool) -> Result<Submitted, JobError> {
        let Self { folder, engine, settings, on } = *self;
        let shards = folder.job.shards;
        let progress = Progress::of(folder)?;
        let entries = engine.driver.entries(shards, settings)?;
        let tasks =
            if is_dry && before.is_empty() { Vec::new() } else { queued(folder, before, Some(engine))? };
        let held = queued_shards(&tasks, before, entries, shards);
        let is_free = |shard: &u64| !held.contains_key(shard);
        let missing: Vec<u64> = progress.missing(folder).into_iter().filter(is_free).collect();
        let waiting = held.keys().filter(|shard| !progress.done.contains(shard)).count();
        let is_finish = progress.done.len() as u64 == shards
            && progress.finished.is_none()
            && tasks.iter().all(|task| task.entry.is_some());
        let entry = |shard: &u64| (shard - 1) % entries + 1;
        let indices: Vec<u64> = missing.iter().map(entry).collect::<BTreeSet<u64>>().into_iter().collect();
        let after: BTreeSet<String> =
            tasks.iter().filter(|task| task.entry.is_some()).map(|task| task.id.clone()).collect();
        let after: Vec<String> = after.into_iter().collect();
        let request = Request { folder, settings, entries, indices: &indices, after: &after };
        let mut sent = Submitted {
            shards: missing,
            done: progress.done.len(),
            queued: waiting,
            id: None,
            is_finish,
            is_submitted: false,
            script: String::new(),
        };
        if indices.is_empty() && !is_finish {
            return Ok(sent);
        }
        let only_finish = if is_finish { engine.driver.finish_script(&request, "")? } else { None };
        sent.script = match (only_finish, is_dry) {
            (Some(script), _) => script,
            (None, true) => engine.driver.dry_run(&request)?,
            (None, false) => engine.driver.script(&request)?,
        };
        if is_dry {
            return Ok(sent);
        }
        sent.shards.iter().try_for_each(|&shard| folder.forget_failure(shard))?;
        sent.id = engine.driver.submit(&request, &sent.script)?;
        sent.is_submitted = engine.name != "script";
        if let Some(id) = &sent.id {
            let (on, indices, script) = (on.to_owned(), ranges(&indices), sent.script.clone());
            Submission { on, id: id.clone(), entries, indices, script, time: now() }.record(folder)?;
            engine.driver.submit_finish(&request, id).map_err(|error| JobError::JoinNotSubmitted {
                id: id.clone(),
                reason: Box::new(error),
                dir: folder.dir.clone(),
            })?;
        }
        Ok(sent)
    }

    /// Waits until the result is there, or nobody is at it any more.
    ///
    /// # Errors
    ///
    /// The engine has ended without a result, or does not answer.
    pub fn wait(&self) -> Result<(), JobError> {
        let Self { folder, engine, .. } = *self;
        let mut pause = Duration::from_secs(1);
        loop {
            sleep(pause);
            pause = (pause * 2).min(ASK_EVERY);
            if Progress::of(folder)?.finished.is_some() {
                return Ok(());
            }
            if queued(folder, &[], Some(engine))?.is_empty() {
                // It may have ended between the two looks.
                let progress = Progress::of(folder)?;
                if progress.finished.is_some() {
                    return Ok(());
                }
                return Err(JobError::Parts(format!(
                    "{} has ended without a result, and these shards are not done: {}; swm jobs {} shows why",
                    engine.name,
                    ranges(&progress.missing(folder)),
                    folder.dir.display()
                )));
            }
        }
    }
}

impl Submitted {
    /// For programs.
    pub fn json(&self, folder: &JobFolder, engine: &Engine) -> Json {
        json!({
            "job": folder.dir,
            "name": folder.job.name(),
            "engine": engine.name,
            "id": self.id,
            "shards": folder.job.shards,
            "submitted": self.shards,
            "done": self.done,
            "queued": self.queued,
            "script": self.script,
        })
    }
}
