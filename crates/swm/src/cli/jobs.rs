//! `swm jobs`: what is done of a job, from its files; the scheduler is asked only who is at work.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
#[cfg(feature = "ui")]
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Value as Json, json};
use swm_data::recording::WriterLock;

use super::output::{counted, key_values, print, table};
use super::{Failure, Output, usage};
use crate::jobs::JobFolder;
use crate::jobs::engine::{Queued, Submission, engine};
use crate::jobs::files::{ranges, read_json};
use crate::jobs::held::{held_shards, queued};
use crate::jobs::log::{attempts, last_episode};
use crate::jobs::progress::{Done, Failed, Finished, Progress};
use crate::text_file::read_text;

/// Show the progress of jobs.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm jobs                    (every job in this folder)
  swm jobs pusht --watch
  swm jobs --logs pusht 3     (what shard 3 printed)
  swm jobs --cancel pusht     (what is done is kept; swm submit --job pusht goes on)")]
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

/// Schedulers are asked so often at most.
const ASK_EVERY: Duration = Duration::from_secs(30);
/// Shards that are listed.
const MAX_LISTED: usize = 20;

impl Jobs {
    pub(super) fn run(self, output: &Output) -> Result<(), Failure> {
        let folders = match &self.job {
            Some(job) => {
                let folder = JobFolder::open(job).map_err(usage)?;
                vec![folder.ok_or_else(|| {
                    usage(format!("{} holds no job; `swm submit` makes one", job.display()))
                })?]
            }
            None => jobs_in(Path::new("."))?,
        };
        if let (true, [folder]) = (self.logs, folders.as_slice()) {
            return self.print_log(folder);
        }
        if let (true, [folder]) = (self.cancel, folders.as_slice()) {
            return cancel(folder, output);
        }
        let mut asked: Option<(Instant, Vec<Held>)> = None;
        loop {
            let is_old = asked.as_ref().is_none_or(|(time, _)| time.elapsed() >= ASK_EVERY);
            if is_old {
                let ask = |folder: &JobFolder| {
                    let (held, note) = Held::of(folder);
                    note.iter().for_each(|note| output.note(note));
                    held
                };
                asked = Some((Instant::now(), folders.iter().map(ask).collect()));
            }
            let held = asked.as_ref().map_or(&[][..], |(_, held)| held.as_slice());
            let all: Vec<Status> = folders
                .iter()
                .zip(held)
                .map(|(folder, held)| Status::of(folder, held))
                .collect::<Result<_, _>>()?;
            let json: Vec<Json> = all.iter().map(Status::json).collect();
            let json = match (&self.job, json.as_slice()) {
                (Some(_), [one]) => one.clone(),
                _ => Json::Array(json),
            };
            output.result(&json, || text(&all, self.job.is_some()))?;
            let is_finished = all.iter().all(|status| status.finished.is_some());
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
        let text = read_text(&path);
        print(&text.map_err(|error| format!("cannot read {}: {error} (has it started?)", path.display()))?)
    }
}

/// The jobs in a folder, by name.
fn jobs_in(dir: &Path) -> Result<Vec<JobFolder>, Failure> {
    let entries = std::fs::read_dir(dir).map_err(|error| format!("cannot read the folder: {error}"))?;
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.retain(|path| path.join("job.json").is_file());
    if paths.is_empty() {
        return Err(usage("this folder holds no jobs; name one, or make one with `swm submit`"));
    }
    let mut folders = Vec::new();
    for path in paths {
        folders.extend(JobFolder::open(&path).map_err(usage)?);
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
        true => "nothing was submitted".to_owned(),
        false => format!(
            "canceled on {}; {done} of {} are done, and swm submit --job {} goes on",
            names.join(" and "),
            counted(folder.job.shards, "shard"),
            folder.dir.display()
        ),
    })
}

/// What engines hold of a job.
struct Held(BTreeMap<u64, Queued>);

impl Held {
    /// An engine that does not answer is named in a note, and the files are shown alone.
    fn of(folder: &JobFolder) -> (Self, Option<String>) {
        let tasks = Submission::all(folder).map_err(Failure::from).and_then(|before| {
            let shards = folder.job.shards;
            Ok(held_shards(&queued(folder, &before, None)?, &before, shards, shards))
        });
        match tasks {
            Ok(held) => (Self(held), None),
            Err(failure) => (Self(BTreeMap::new()), Some(format!("{}: {failure}", folder.dir.display()))),
        }
    }
}

/// When engines were asked, what they held, and a note where one did not answer.
#[cfg(feature = "ui")]
type Asked = (Instant, Held, Option<String>);

/// What engines held of jobs that are watched, by folder.
#[cfg(feature = "ui")]
#[derive(Default)]
pub(super) struct Watched(Mutex<BTreeMap<PathBuf, Asked>>);

#[cfg(feature = "ui")]
impl Watched {
    /// What `swm jobs DIR --json` prints, and as `note` what it tells.
    ///
    /// # Errors
    ///
    /// The folder holds no job, or one that cannot be read.
    pub(super) fn status(&self, dir: &Path) -> Result<Json, Failure> {
        let folder = JobFolder::open(dir)?.ok_or_else(|| format!("{} holds no job", dir.display()))?;
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.get(dir).is_none_or(|(time, ..)| time.elapsed() >= ASK_EVERY) {
            let (held, note) = Held::of(&folder);
            all.insert(dir.to_owned(), (Instant::now(), held, note));
        }
        let Some((_, held, note)) = all.get(dir) else { return Err("the job is not watched".into()) };
        let mut json = Status::of(&folder, held)?.json();
        json["note"] = note.clone().into();
        Ok(json)
    }
}

/// What is known of a job.
struct Status<'a> {
    folder: &'a JobFolder,
    done: BTreeMap<u64, Done>,
    failed: BTreeMap<u64, Failed>,
    /// What engines hold and is not done.
    held: BTreeMap<u64, Queued>,
    /// Neither done nor held.
    missing: Vec<u64>,
    /// Episodes of shards that are not done, as their logs say.
    begun: BTreeMap<u64, u64>,
    /// Who runs shards without an engine, on this machine.
    by_hand: BTreeMap<u64, String>,
    /// The node of the last start of other shards that have neither ended nor are with an engine: lost, or at work on another machine.
    started: BTreeMap<u64, String>,
    /// What shards are called that nobody began, and those of `started`.
    words: [&'static str; 2],
    finished: Option<Finished>,
}

impl<'a> Status<'a> {
    fn of(folder: &'a JobFolder, held: &Held) -> Result<Self, Failure> {
        let progress = Progress::of(folder)?;
        let done = Done::all(folder, &progress)?;
        let mut failed = BTreeMap::new();
        for &shard in &progress.failed {
            failed.extend(read_json(&folder.failed(shard))?.map(|failed: Failed| (shard, failed)));
        }
        let left = progress.missing(folder);
        let begun = left.iter().filter_map(|&shard| {
            let range = folder.job.range(shard);
            Some((shard, last_episode(&folder.log(shard))?.clamp(range.start, range.end) - range.start))
        });
        let begun = begun.collect();
        let held: BTreeMap<u64, Queued> =
            left.iter().filter_map(|shard| Some((*shard, held.0.get(shard)?.clone()))).collect();
        let mut missing: Vec<u64> = left.into_iter().filter(|shard| !held.contains_key(shard)).collect();
        let at_work = |&shard: &u64| Some((shard, WriterLock::holder_here(&folder.shard_lock(shard))?));
        let by_hand: BTreeMap<u64, String> = missing.iter().filter_map(at_work).collect();
        missing.retain(|shard| !by_hand.contains_key(shard));
        let unexplained = missing.iter().filter(|shard| !failed.contains_key(shard));
        let started = unexplained
            .filter_map(|&shard| Some((shard, attempts(&folder.log(shard)).pop()?.node)))
            .collect();
        let finished = read_json(&folder.finished())?;
        let words = match folder.is_with_an_engine() {
            true => ["not submitted", "started, not queued"],
            false => ["not started", "interrupted"],
        };
        Ok(Self { folder, done, failed, held, missing, begun, by_hand, started, words, finished })
    }

    fn episodes(&self) -> u64 {
        self.done.values().map(|done| done.episodes).sum::<u64>() + self.begun.values().sum::<u64>()
    }

    fn running(&self) -> usize {
        self.held.values().filter(|task| task.is_running).count() + self.by_hand.len()
    }

    fn waiting(&self) -> usize {
        self.held.values().filter(|task| !task.is_running).count()
    }

    fn json(&self) -> Json {
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
            "each": (1..=job.shards).map(|shard| self.shard(shard)).collect::<Vec<_>>(),
        })
    }

    /// The state of one shard: `done`, what its engine says, who runs it by hand, `failed`, or one of `words`.
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
        let untouched = |shard: &&u64| !self.failed.contains_key(shard) && !self.started.contains_key(shard);
        let [untouched_name, begun] = self.words;
        let counts = [
            (self.done.len(), "done"),
            (self.running(), "running"),
            (self.waiting(), "waiting"),
            (self.failed.len(), "failed"),
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

    fn page(&self) -> String {
        let (job, dir) = (&self.folder.job, self.folder.dir.display().to_string());
        let mut rows = vec![("job", dir.clone()), ("command", format!("swm {}", job.command.join(" ")))];
        rows.push(("shards", self.line()));
        if job.episodes > 0 {
            rows.push(("episodes", format!("{} of {}", self.episodes(), job.episodes)));
        }
        let took: f64 = self.done.values().map(|done| done.seconds).sum();
        if !self.done.is_empty() {
            let longest = self.done.values().map(|done| done.seconds).fold(0.0, f64::max);
            let mean = took / self.done.len() as f64;
            rows.push(("time per shard", format!("{mean:.1} s, longest {longest:.1} s")));
        }
        if let Some(finished) = &self.finished {
            rows.push(("result", format!("{dir}/{} ({} bytes)", finished.result, finished.bytes)));
        } else if self.missing.is_empty() && self.held.is_empty() {
            rows.push(("result", format!("not joined yet: swm task {dir} --finish")));
        } else if !self.missing.is_empty() {
            let missing = ranges(&self.missing);
            rows.push(("missing", format!("{missing}: {}", self.folder.command_for_the_rest())));
        }
        let mut text = key_values(&rows);
        let shown = |&shard: &u64| {
            let episodes = self.begun.get(&shard).map_or(String::new(), ToString::to_string);
            vec![shard.to_string(), self.state(shard), episodes, self.message(shard).to_owned()]
        };
        let mut open: Vec<u64> = self
            .failed
            .keys()
            .chain(self.held.keys())
            .chain(self.by_hand.keys())
            .chain(self.started.keys())
            .copied()
            .collect();
        open.sort_unstable();
        open.dedup();
        let rows: Vec<Vec<String>> = open.iter().take(MAX_LISTED).map(shown).collect();
        if !rows.is_empty() {
            text += &format!("\n{}", table(&["shard", "state", "episodes", ""], &rows));
        }
        if open.len() > MAX_LISTED {
            text += &format!("and {} more\n", open.len() - MAX_LISTED);
        }
        text
    }
}

fn text(all: &[Status<'_>], is_one: bool) -> String {
    if let ([status], true) = (all, is_one) {
        return status.page();
    }
    let rows: Vec<Vec<String>> = all
        .iter()
        .map(|status| {
            let dir = status.folder.dir.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let result =
                status.finished.as_ref().map_or("–".to_owned(), |finished| finished.result.clone());
            vec![
                dir,
                status.folder.job.command[..2.min(status.folder.job.command.len())].join(" "),
                status.line(),
                result,
            ]
        })
        .collect();
    table(&["job", "command", "progress", "result"], &rows)
}
