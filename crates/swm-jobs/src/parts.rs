//! What shards write: the request of each, its file, how far it is, and whether the file is still what its shard wrote.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use swm_core::Registry;
use swm_tasks::evaluation::{file_bytes, file_hash};
use swm_tasks::request::{Divided, Message, Shard, cannot};
use swm_tasks::text_file::read_text;

use crate::error::JobError;
use crate::files::{ranges, write_json};
use crate::job::JobFolder;
use crate::log::Attempt;
use crate::progress::{Done, Progress};

impl JobFolder {
    /// The request of a shard, begun or not.
    ///
    /// # Errors
    ///
    /// There is no such shard.
    pub fn shard_request(&self, shard: u64) -> Result<Divided, JobError> {
        let request = &self.job.request;
        let out = match request {
            Divided::Record(_) | Divided::Train(_) => self.written(shard),
            _ => self.dir.clone(),
        };
        let shards = self.job.shards;
        let part =
            Shard::new(shard, shards).ok_or_else(|| Message::new(format!("no shard {shard} of {shards}")))?;
        Ok(request.part(part, out))
    }

    /// What shard `shard` writes: a file, or the file of a training run that shows how far it is.
    pub fn shard_output(&self, shard: u64) -> PathBuf {
        let written = self.written(shard);
        if self.job.request.is_of_runs() { written.join("metrics.jsonl") } else { written }
    }

    /// How far a shard is: committed episodes, or the size of a training run's metrics.
    pub fn committed(&self, registry: &Registry, shard: u64) -> u64 {
        let path = self.shard_output(shard);
        match &self.job.request {
            Divided::Record(_) if path.exists() => {
                swm_data::open_in(registry, &path).map_or(0, |dataset| dataset.num_episodes() as u64)
            }
            Divided::Record(_) => 0,
            Divided::Train(_) => fs::metadata(&path).map_or(0, |metadata| metadata.len()),
            // The first line is the head.
            _ => read_text(&path).map_or(0, |text| text.lines().count().max(1) as u64 - 1),
        }
    }

    /// Checks that a shard has all of its episodes.
    ///
    /// # Errors
    ///
    /// Episodes are missing.
    pub fn check_shard(&self, registry: &Registry, shard: u64) -> Result<(), JobError> {
        let range = self.job.range(shard);
        let (found, expected) = (self.committed(registry, shard), range.end - range.start);
        if matches!(self.job.request, Divided::Record(_)) && found != expected {
            let path = self.shard_output(shard);
            let reason = format!("{} holds {found} episodes, not {expected}", path.display());
            return Err(JobError::Parts(reason));
        }
        Ok(())
    }

    /// Writes that a shard is done.
    ///
    /// # Errors
    ///
    /// A file cannot be read or written.
    pub fn write_done(&self, shard: u64, attempt: &Attempt, took: Duration) -> Result<(), JobError> {
        let (range, path) = (self.job.range(shard), self.shard_output(shard));
        let done = Done {
            shard,
            range: [range.start, range.end],
            episodes: range.end - range.start,
            bytes: file_bytes(&path)?,
            sha256: file_hash(&path)?,
            attempt: attempt.number,
            node: attempt.node.clone(),
            seconds: took.as_secs_f64(),
        };
        write_json(&self.done(shard), &done)?;
        self.forget_failure(shard)
    }

    /// Removes what a failed attempt left.
    pub(crate) fn forget_failure(&self, shard: u64) -> Result<(), JobError> {
        let path = self.failed(shard);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(cannot("remove", &path)(error).into())
            }
            _ => Ok(()),
        }
    }

    /// Checks that all shards are done.
    ///
    /// # Errors
    ///
    /// Some are not: which, why, and what runs them.
    pub fn check_complete(&self, progress: &Progress) -> Result<(), JobError> {
        let missing = progress.missing(self);
        if missing.is_empty() {
            return Ok(());
        }
        let dir = self.dir.display();
        let mut why = String::new();
        if let Some(&first) = progress.failed.first() {
            let failed = ranges(&progress.failed);
            why = format!(" (failed: {failed}; {} shows why)", self.log(first).display());
        }
        if let Some(&first) = progress.lost.first() {
            let (lost, part) = (ranges(&progress.lost), self.written(first));
            why += &format!(" (done before, but parts are missing: {lost}; {})", part.display());
        }
        Err(JobError::Parts(format!(
            "{} of {} shards of {dir} are not done: {}{why}; to run them: {}",
            missing.len(),
            self.job.shards,
            ranges(&missing),
            self.command_for_the_rest()
        )))
    }

    /// Checks that the parts are what their shards wrote, byte for byte.
    ///
    /// # Errors
    ///
    /// Some are not: of which shards, and what to do.
    pub fn check_parts(&self, progress: &Progress) -> Result<(), JobError> {
        if self.job.request.is_of_runs() {
            // Runs are not joined, and go on when they are resumed.
            return Ok(());
        }
        let (mut shards, mut parts) = (Vec::new(), Vec::new());
        for (shard, done) in Done::all(self, progress)? {
            let part = self.shard_output(shard);
            if file_bytes(&part)? != done.bytes || file_hash(&part)? != done.sha256 {
                shards.push(shard);
                parts.push(part);
            }
        }
        let Some(first) = parts.first() else { return Ok(()) };
        let first = match parts.len() {
            1 => first.display().to_string(),
            more => format!("{} and the {} others", first.display(), more - 1),
        };
        Err(JobError::Parts(format!(
            "the parts of {} cannot be joined: what {} {} wrote has changed since: remove {first}, and make the missing parts again: {}",
            self.dir.display(),
            if shards.len() == 1 { "shard" } else { "shards" },
            ranges(&shards),
            self.command_for_the_rest()
        )))
    }
}
