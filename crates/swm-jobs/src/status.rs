//! What is done of a job, for people and for programs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde_json::{Value as Json, json};
use swm_core::Registry;
use swm_files::WriterLock;
use swm_tasks::request::Divided;

use crate::engine::Queued;
use crate::error::JobError;
use crate::files::{ranges, read_json};
use crate::job::JobFolder;
use crate::log::{attempts, last_episode};
use crate::progress::{Done, Failed, Finished, Progress};
use crate::queue_state::QueueState;

/// What is known of a job.
#[derive(Debug)]
pub struct Status<'a> {
    folder: &'a JobFolder,
    done: BTreeMap<u64, Done>,
    failed: BTreeMap<u64, Failed>,
    /// What engines hold and is not done.
    held: BTreeMap<u64, Queued>,
    /// Neither done nor held.
    missing: Vec<u64>,
    /// Episodes of shards that are not done.
    begun: BTreeMap<u64, u64>,
    /// Who runs shards without an engine, on this machine.
    by_hand: BTreeMap<u64, String>,
    /// Shards that were done, and whose parts are gone.
    lost: BTreeSet<u64>,
    /// The node of the last start of other shards that have neither ended nor are with an engine: lost, or at work on another machine.
    started: BTreeMap<u64, String>,
    /// What shards are called that nobody began, and those of `started`.
    words: [&'static str; 2],
    finished: Option<Finished>,
    /// What of the result is gone, where it was made.
    lost_result: Option<PathBuf>,
    /// The command that joins the shards, where all are done and nobody has.
    join_command: Option<String>,
}

impl<'a> Status<'a> {
    /// Reads the files of a job. `held`: what engines hold of it.
    ///
    /// # Errors
    ///
    /// A file cannot be read.
    pub fn of(registry: &Registry, folder: &'a JobFolder, held: &QueueState) -> Result<Self, JobError> {
        let progress = Progress::of(folder)?;
        let done = Done::all(folder, &progress)?;
        let mut failed = BTreeMap::new();
        for &shard in &progress.failed {
            failed.insert(shard, read_json(&folder.failed(shard))?.unwrap_or_else(Failed::without_space));
        }
        let left = progress.missing(folder);
        let begun = left.iter().map(|&shard| (shard, episodes_of(registry, folder, shard)));
        // The log of a shard whose part is gone has episodes that are gone, too.
        let mut lost = progress.lost.clone();
        let begun = begun.filter(|(shard, episodes)| *episodes > 0 && !lost.contains(shard)).collect();
        let held: BTreeMap<u64, Queued> =
            left.iter().filter_map(|shard| Some((*shard, held.shards.get(shard)?.clone()))).collect();
        let mut missing: Vec<u64> = left.into_iter().filter(|shard| !held.contains_key(shard)).collect();
        let at_work = |&shard: &u64| Some((shard, WriterLock::holder_here(&folder.shard_lock(shard))?));
        let by_hand: BTreeMap<u64, String> = missing.iter().filter_map(at_work).collect();
        missing.retain(|shard| !by_hand.contains_key(shard));
        lost.retain(|shard| missing.contains(shard) && !failed.contains_key(shard));
        let unexplained = missing.iter().filter(|shard| !failed.contains_key(shard) && !lost.contains(shard));
        let started = unexplained
            .filter_map(|&shard| Some((shard, attempts(&folder.log(shard)).pop()?.node)))
            .collect();
        let join_command = progress.join_command(folder);
        let Progress { finished, lost_result, .. } = progress;
        let words = match folder.is_with_an_engine() {
            true => ["not submitted", "started, not queued"],
            false => ["not started", "interrupted"],
        };
        Ok(Self {
            folder,
            done,
            failed,
            held,
            missing,
            begun,
            by_hand,
            lost,
            started,
            words,
            finished,
            lost_result,
            join_command,
        })
    }

    /// Whether the result is there.
    pub fn is_finished(&self) -> bool {
        self.finished.is_some()
    }

    fn episodes(&self) -> u64 {
        let done = self.done.values().map(|done| done.episodes);
        done.chain(self.begun.values().copied()).fold(0, u64::saturating_add)
    }

    fn running(&self) -> usize {
        self.held.values().filter(|task| task.is_running).count() + self.by_hand.len()
    }

    fn waiting(&self) -> usize {
        self.held.values().filter(|task| !task.is_running).count()
    }

    /// All of it, with every shard.
    pub fn json(&self) -> Json {
        let job = &self.folder.job;
        json!({
            "job": self.folder.dir,
            "name": job.name(),
            "command": job.command,
            "shards": job.shards,
            "done": self.done.len(),
            "running": self.running(),
            "waiting": self.waiting(),
            "failed": self.failed,
            "missing": self.missing,
            "episodes": self.episodes(),
            "total_episodes": job.episodes,
            "result": self.finished,
            "lost_result": self.lost_result,
            "result_line": self.result(),
            "progress": self.line(),
            "each": (1..=job.shards).map(|shard| self.shard(shard)).collect::<Vec<_>>(),
        })
    }

    /// The state of one shard: `done`, what its engine says, who runs it by hand, `failed`, `lost`, or one of `words`.
    fn shard(&self, shard: u64) -> Json {
        let job = &self.folder.job;
        let of = job.range(shard).count();
        if let Some(done) = self.done.get(&shard) {
            let (episodes, seconds) = (done.episodes, done.seconds);
            return json!({ "shard": shard, "state": "done", "episodes": episodes, "of": of, "seconds": seconds });
        }
        json!({
            "shard": shard,
            "state": self.state(shard),
            "running": self.held.get(&shard).is_some_and(|task| task.is_running) || self.by_hand.contains_key(&shard),
            "episodes": self.begun.get(&shard).copied().unwrap_or(0),
            "of": of,
            "message": self.message(shard),
        })
    }

    /// The state of a shard that is not done.
    fn state(&self, shard: u64) -> String {
        if let Some(who) = self.by_hand.get(&shard) {
            return format!("running: {who}");
        }
        let [untouched, begun] = self.words;
        match (self.held.get(&shard), self.failed.get(&shard)) {
            (Some(task), _) => task.state.clone(),
            (None, Some(failed)) => format!("failed on {}", failed.node),
            (None, None) if self.lost.contains(&shard) => "lost: its part is missing".to_owned(),
            (None, None) => match self.started.get(&shard) {
                Some(node) => format!("{begun}: last on {node}"),
                None => untouched.to_owned(),
            },
        }
    }

    /// Why a shard failed, in a line.
    fn message(&self, shard: u64) -> &str {
        self.failed.get(&shard).map_or("", |failed| failed.message.lines().next().unwrap_or(""))
    }

    /// One line: how far it is.
    fn line(&self) -> String {
        let untouched = |shard: &&u64| {
            let Self { failed, started, lost, .. } = self;
            !failed.contains_key(shard) && !started.contains_key(shard) && !lost.contains(shard)
        };
        let [untouched_name, begun] = self.words;
        let counts = [
            (self.done.len(), "done"),
            (self.running(), "running"),
            (self.waiting(), "waiting"),
            (self.failed.len(), "failed"),
            (self.lost.len(), "lost"),
            (self.started.len(), begun),
            (self.missing.iter().filter(untouched).count(), untouched_name),
        ];
        let counts: Vec<String> = counts
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        format!("{} shards: {}", self.folder.job.shards, counts.join(", "))
    }

    /// Where the result is, that it is lost or not as it was joined, or how to make it; `None` while there is nothing to join.
    fn result(&self) -> Option<String> {
        if let Some(finished) = &self.finished {
            let joined = finished.bytes;
            let size = match finished.changed_bytes(self.folder) {
                Some(bytes) => format!(
                    "{bytes} bytes, where the shards were joined to {joined}: it was changed or cut short"
                ),
                None => format!("{joined} bytes"),
            };
            return Some(format!("{}/{} ({size})", self.folder.dir.display(), finished.result));
        }
        let lost = self.lost_result.as_ref().map(|lost| format!("lost: {} is missing", lost.display()));
        match (lost, &self.join_command) {
            (Some(lost), Some(join)) => Some(format!("{lost}; to join it again: {join}")),
            (None, Some(join)) => Some(format!("not joined yet: {join}")),
            (lost, None) => lost,
        }
    }

    /// Names and values.
    pub fn summary(&self) -> Vec<(&'static str, String)> {
        let (job, dir) = (&self.folder.job, self.folder.dir.display().to_string());
        let mut rows = vec![("job", dir), ("command", format!("swm {}", job.command.join(" ")))];
        rows.push(("shards", self.line()));
        if job.episodes > 0 {
            rows.push(("episodes", format!("{} of {}{}", self.episodes(), job.episodes, what(&job.request))));
        }
        let took: f64 = self.done.values().map(|done| done.seconds).sum();
        if !self.done.is_empty() {
            let longest = self.done.values().map(|done| done.seconds).fold(0.0, f64::max);
            let mean = took / self.done.len() as f64;
            rows.push(("time per shard", format!("{mean:.1} s, longest {longest:.1} s")));
        }
        rows.extend(self.result().map(|result| ("result", result)));
        if self.finished.is_none() && !self.missing.is_empty() {
            let missing = ranges(&self.missing);
            rows.push(("to do", format!("shards {missing}, by: {}", self.folder.command_for_the_rest())));
        }
        rows
    }

    /// The shards that are not done and of which something is known: number, state, episodes, and why it failed.
    pub fn open_shards(&self) -> Vec<Vec<String>> {
        let Self { failed, held, by_hand, started, lost, .. } = self;
        let known = failed.keys().chain(held.keys()).chain(by_hand.keys()).chain(started.keys()).chain(lost);
        let row = |&shard: &u64| {
            let episodes = self.begun.get(&shard).map_or(String::new(), ToString::to_string);
            vec![shard.to_string(), self.state(shard), episodes, self.message(shard).to_owned()]
        };
        known.collect::<BTreeSet<_>>().into_iter().map(row).collect()
    }

    /// One of several jobs: its folder, command, progress and result.
    pub fn row(&self) -> Vec<String> {
        let (dir, command) = (&self.folder.dir, &self.folder.job.command);
        let result = match &self.finished {
            Some(finished) => finished.result.clone(),
            None if self.lost_result.is_some() => "lost".to_owned(),
            None if self.join_command.is_some() => "not joined yet".to_owned(),
            None => "–".to_owned(),
        };
        let name = dir.file_name().unwrap_or_default().to_string_lossy().into_owned();
        vec![name, command[..2.min(command.len())].join(" "), self.line(), result]
    }
}

/// What the episodes of a job are, where they are more than those of its manifest.
fn what(request: &Divided) -> &'static str {
    match request {
        Divided::Evaluate(_) => " (every pair, with the policy and with each reference policy)",
        Divided::Sweep(_) => " (every pair, unchanged and with each change)",
        _ => "",
    }
}

/// Episodes that a shard which is not done has committed: those in its file, or of its log where the file cannot be read now.
fn episodes_of(registry: &Registry, folder: &JobFolder, shard: u64) -> u64 {
    let range = folder.job.range(shard);
    let logged =
        last_episode(&folder.log(shard)).unwrap_or(range.start).clamp(range.start, range.end) - range.start;
    match folder.job.request {
        Divided::Train(_) => logged,
        _ => folder.committed(registry, shard).min(range.end - range.start).max(logged),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn episodes_are_explained_where_a_pair_counts_several_times() {
        let evaluate = Divided::Evaluate(Box::default());
        assert!(what(&evaluate).contains("each reference policy"));
        let sweep = Divided::Sweep(Box::default());
        assert!(what(&sweep).contains("each change"));
        assert_eq!(what(&Divided::Record(Box::default())), "");
    }
}
