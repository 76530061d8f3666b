//! What is done of a job, from its files alone.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use swm_files::is_plain_name;
use swm_tasks::request::cannot;

use crate::error::JobError;
use crate::files::{is_written, read_json, write_json};
use crate::job::JobFolder;

/// `done/0003.json`: a shard is done.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Done {
    /// Its number, counted from 1.
    pub shard: u64,
    /// Its first episode, and the one after its last.
    pub range: [u64; 2],
    /// How many.
    pub episodes: u64,
    /// Of what it wrote.
    pub bytes: u64,
    /// Of what it wrote.
    pub sha256: String,
    /// The number of the last attempt.
    pub attempt: u64,
    /// Where it ran.
    pub node: String,
    /// Of the last attempt.
    pub seconds: f64,
}

/// `done/0003.failed`: a shard ended with an error.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Failed {
    /// The exit status: 1 failed, 2 the request is wrong.
    pub status: u8,
    /// Why.
    pub message: String,
    /// The number of the attempt.
    pub attempt: u64,
    /// Where it ran.
    pub node: String,
}

impl Failed {
    /// Writes it. On a full disk that fails, but a file without content needs no space. The error that counts is the shard's.
    pub fn write(&self, path: &Path) {
        if write_json(path, self).is_err() {
            let _ = fs::File::create(path);
        }
    }

    /// What an empty file stands for.
    pub fn without_space() -> Self {
        let message = "error: it failed, and there was no space to write why".to_owned();
        Self { status: 1, message, attempt: 0, node: String::new() }
    }
}

/// `finished.json`: the shards are joined.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Finished {
    /// The result, relative to the folder.
    pub result: String,
    /// Its size.
    pub bytes: u64,
    /// Of its content.
    pub sha256: String,
    /// How many.
    pub episodes: u64,
}

impl Finished {
    /// What `finished.json` says, whether or not the result is still there; `None` if the shards were never joined.
    ///
    /// # Errors
    ///
    /// The file cannot be read.
    pub fn of(folder: &JobFolder) -> Result<Option<Self>, JobError> {
        let path = folder.finished();
        let finished: Option<Self> = read_json(&path)?;
        match &finished {
            Some(made) if !is_plain_name(&made.result) => {
                Err(JobError::OtherResult { file: path, named: made.result.clone() })
            }
            _ => Ok(finished),
        }
    }

    /// What of the result is not there any more: its file, or the first folder of a training run.
    pub fn lost(&self, folder: &JobFolder) -> Option<PathBuf> {
        let result = folder.dir.join(&self.result);
        // Training runs are not joined: they are the result.
        let runs = (1..=folder.job.shards).map(|shard| folder.written(shard));
        let runs = runs.filter(|run| run.starts_with(&result));
        std::iter::once(result.clone()).chain(runs).find(|path| !path.exists())
    }

    /// The size of the result's file, if it is not what it was.
    pub fn changed_bytes(&self, folder: &JobFolder) -> Option<u64> {
        let there = fs::metadata(folder.dir.join(&self.result)).ok()?;
        (there.is_file() && there.len() != self.bytes).then_some(there.len())
    }
}

/// What `done/` lists, without the shards whose parts are gone.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    /// Shards that are done.
    pub done: BTreeSet<u64>,
    /// Shards that were done, and what they wrote is not there any more: they are to be run again.
    pub lost: BTreeSet<u64>,
    /// Shards that ended with an error.
    pub failed: BTreeSet<u64>,
    /// What was joined, if the result is there.
    pub finished: Option<Finished>,
    /// What of the result is not there any more, where the shards were joined: it is to be made again.
    pub lost_result: Option<PathBuf>,
}

impl Progress {
    /// Lists what is done.
    ///
    /// # Errors
    ///
    /// The folder cannot be read.
    pub fn of(folder: &JobFolder) -> Result<Self, JobError> {
        let dir = folder.dir.join("done");
        let finished = Finished::of(folder)?;
        let lost_result = finished.as_ref().and_then(|finished| finished.lost(folder));
        let finished = finished.filter(|_| lost_result.is_none());
        let mut progress = Self { finished, lost_result, ..Self::default() };
        let failed = cannot("read the folder", &dir);
        let entries = match fs::read_dir(&dir) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(progress),
            entries => entries.map_err(failed)?,
        };
        for entry in entries {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let Some((shard, kind)) = name.to_str().and_then(|name| name.split_once('.')) else { continue };
            let Some(shard) = shard.parse().ok().filter(|shard| (1..=folder.job.shards).contains(shard))
            else {
                continue;
            };
            match kind {
                "json" => is_written(&entry.path()) && progress.done.insert(shard),
                "failed" => progress.failed.insert(shard),
                _ => false,
            };
        }
        // While the result is there, nobody needs the parts.
        if progress.finished.is_none() && !progress.done.is_empty() {
            let there = names_beside(&folder.written(1))?;
            // Listings of shared file systems can be older than a look at the file itself.
            let is_there = |shard: &u64| {
                let written = folder.written(*shard);
                written.file_name().is_some_and(|name| there.contains(name)) || written.exists()
            };
            (progress.done, progress.lost) = progress.done.iter().partition(|&shard| is_there(shard));
        }
        let done = &progress.done;
        progress.failed.retain(|shard| !done.contains(shard));
        Ok(progress)
    }

    /// The command that makes the result, where all shards are done and nobody has joined them.
    pub fn join_command(&self, folder: &JobFolder) -> Option<String> {
        let awaits_join = self.finished.is_none() && self.done.len() as u64 == folder.job.shards;
        awaits_join.then(|| format!("swm task {} --finish", folder.dir.display()))
    }

    /// The shards that are not done.
    pub fn missing(&self, folder: &JobFolder) -> Vec<u64> {
        (1..=folder.job.shards).filter(|shard| !self.done.contains(shard)).collect()
    }
}

/// What the folder that holds `path` lists: one look, whatever the number of shards.
fn names_beside(path: &Path) -> Result<BTreeSet<OsString>, JobError> {
    let dir = path.parent().unwrap_or(path);
    let failed = cannot("read the folder", dir);
    match fs::read_dir(dir) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(BTreeSet::new()),
        Err(error) => Err(failed(error).into()),
        Ok(entries) => entries.map(|entry| Ok(entry.map_err(failed)?.file_name())).collect(),
    }
}

impl Done {
    /// All that are done.
    ///
    /// # Errors
    ///
    /// A file cannot be read.
    pub fn all(folder: &JobFolder, progress: &Progress) -> Result<BTreeMap<u64, Self>, JobError> {
        let read = |&shard: &u64| Ok(read_json(&folder.done(shard))?.map(|done| (shard, done)));
        progress.done.iter().filter_map(|shard| read(shard).transpose()).collect()
    }
}

/// The shards of entry `entry` (counted from 1) of `entries`: every `entries`-th.
pub fn shards_of(entry: u64, entries: u64, shards: u64) -> impl Iterator<Item = u64> {
    (entry..=shards).step_by(usize::try_from(entries.max(1)).unwrap_or(usize::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_share_the_shards() {
        assert_eq!(shards_of(2, 3, 8).collect::<Vec<_>>(), [2, 5, 8]);
        let all: BTreeSet<u64> = (1..=3).flat_map(|entry| shards_of(entry, 3, 8)).collect();
        assert_eq!(all, (1..=8).collect());
        assert_eq!(shards_of(9, 9, 8).count(), 0);
    }
}
