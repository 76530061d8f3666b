//! `swm jobs`: what is done of a job, from its files; the scheduler is asked only who is at work.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use serde_json::{Value as Json, json};
use swm_core::Registry;
use swm_tasks::request::cannot;

use super::output::{counted, key_values, print, table};
use super::{Failure, Output, usage, work};
use crate::jobs::{JobFolder, Progress, QueueState, Status, Submission, engine};
use crate::text_file::read_text;

/// Show the progress of the jobs of `swm submit`.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm jobs                    (every job in this folder)
  swm jobs pusht --watch
  swm jobs --logs pusht 3     (what shard 3 printed)
  swm jobs --cancel pusht     (what is done is kept; swm submit --job pusht goes on)

A job is a folder that `swm submit` makes; its shards are tasks of a scheduler, such as those of a Slurm job array. States of shards: \
`done`; `running`; `waiting` (queued by the scheduler); `failed` (the table and the log say why); `started, not queued` (a task \
began and is gone, say killed) and `not submitted`, which `swm submit --job JOB` sends again; and without a scheduler `interrupted` and \
`not started`, which `swm task JOB --all` runs. When all are done, a last task joins them to the result.")]
pub(super) struct Jobs {
    /// The job's folder. Default: every job in this folder.
    #[arg(value_name = "JOB")]
    job: Option<PathBuf>,
    /// With --logs: the shard.
    #[arg(value_name = "I", requires = "logs")]
    shard: Option<u64>,
    /// Show it again every S seconds until the result is there.
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = "10", require_equals = true)]
    watch: Option<u64>,
    /// Print the log of shard I, or of the join where no shard is given.
    #[arg(long, requires = "job", conflicts_with = "watch")]
    logs: bool,
    /// Cancel what is queued and running.
    #[arg(long, requires = "job", conflicts_with_all = ["watch", "logs"])]
    cancel: bool,
}

/// Shards that are listed.
const MAX_LISTED: usize = 20;

impl Jobs {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let folders = match &self.job {
            Some(job) => {
                let folder = work::open(registry, job).map_err(usage)?;
                vec![folder.ok_or_else(|| {
                    usage(format!("{} holds no job; `swm submit` makes one", job.display()))
                })?]
            }
            None => jobs_in(registry, Path::new("."))?,
        };
        if let (true, [folder]) = (self.logs, folders.as_slice()) {
            return self.print_log(folder);
        }
        if let (true, [folder]) = (self.cancel, folders.as_slice()) {
            return cancel(folder, output);
        }
        let mut held: Vec<QueueState> = Vec::new();
        loop {
            if held.first().is_none_or(QueueState::is_old) {
                held = folders.iter().map(|folder| ask(folder, |note| output.note(note))).collect();
            }
            let all: Vec<Status> = folders
                .iter()
                .zip(&held)
                .map(|(folder, held)| Status::of(registry, folder, held))
                .collect::<Result<_, _>>()?;
            let json: Vec<Json> = all.iter().map(Status::json).collect();
            let json = match (&self.job, json.as_slice()) {
                (Some(_), [one]) => one.clone(),
                _ => Json::Array(json),
            };
            output.result(&json, || text(&all, self.job.is_some()))?;
            let is_finished = all.iter().all(Status::is_finished);
            match self.watch {
                Some(seconds) if !is_finished => std::thread::sleep(Duration::from_secs(seconds.max(1))),
                _ => return Ok(()),
            }
        }
    }

    fn print_log(&self, folder: &JobFolder) -> Result<(), Failure> {
        let path = match self.shard {
            Some(shard) if (1..=folder.job.shards).contains(&shard) => folder.log(shard),
            Some(shard) => {
                return Err(usage(format!("{shard}: the job has {}", counted(folder.job.shards, "shard"))));
            }
            None => folder.dir.join("logs/finish.log"),
        };
        if !path.exists() {
            let (what, path) = (
                self.shard.map_or("the join of the shards".to_owned(), |shard| format!("shard {shard}")),
                path.display(),
            );
            return Err(usage(format!("{what} has no log yet, as it was not started: {path}")));
        }
        let text = read_text(&path);
        print(&text.map_err(cannot("read", &path))?)
    }
}

/// The jobs in a folder, by name.
fn jobs_in(registry: &Registry, dir: &Path) -> Result<Vec<JobFolder>, Failure> {
    let entries = std::fs::read_dir(dir).map_err(|error| format!("cannot read the folder: {error}"))?;
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.retain(|path| path.join("job.json").is_file());
    if paths.is_empty() {
        return Err(usage("this folder holds no jobs; name one, or make one with `swm submit`"));
    }
    let mut folders = Vec::new();
    for path in paths {
        folders.extend(work::open(registry, &path).map_err(usage)?);
    }
    Ok(folders)
}

fn cancel(folder: &JobFolder, output: &Output) -> Result<(), Failure> {
    let mut names = Vec::new();
    for submission in Submission::all(folder)? {
        let (engine, _) = engine(&submission.on)?;
        if !names.contains(&engine.name) {
            engine.driver.cancel(folder)?;
            names.push(engine.name);
        }
    }
    let done = Progress::of(folder)?.done.len();
    let result = json!({ "job": folder.dir, "engines": names, "done": done });
    output.result(&result, || match names.is_empty() {
        true => "nothing to cancel: no scheduler has a task of this job".to_owned(),
        false => format!(
            "canceled on {}; {done} of {} are done, and swm submit --job {} goes on",
            names.join(" and "),
            counted(folder.job.shards, "shard"),
            folder.dir.display()
        ),
    })
}

/// Asks the engines of a job, and notes the one that does not answer.
pub(super) fn ask(folder: &JobFolder, note: impl FnOnce(String)) -> QueueState {
    let (held, error) = QueueState::of(folder);
    if let Some(error) = error {
        note(format!("{}: {}", folder.dir.display(), Failure::from(error)));
    }
    held
}

/// One job as a page, several as a table.
fn text(all: &[Status<'_>], is_one: bool) -> String {
    let ([status], true) = (all, is_one) else {
        return table(&["job", "command", "progress", "result"], all.iter().map(Status::row));
    };
    let (mut text, mut open) = (key_values(&status.summary()), status.open_shards());
    let more = open.len().saturating_sub(MAX_LISTED);
    open.truncate(MAX_LISTED);
    if !open.is_empty() {
        text += &format!("\n{}", table(&["shard", "state", "episodes", ""], open));
    }
    if more > 0 {
        text += &format!("and {more} more\n");
    }
    text
}
