//! The description of a job, `job.json`: the request, its shards, the program and the files that it depends on; and the folder.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use swm_core::evaluate::sha256;
use swm_data::tools::parts;
use swm_files::WriterLock;
use swm_files::remote::is_remote;
use swm_tasks::request::{Divided, Record, TaskError, cannot};

use crate::error::JobError;
use crate::files::{read_json, seconds, write_json};
use crate::program::{Program, copy_in};
use crate::tracking::Tracking;
use swm_tasks::evaluation::file_hash;

/// The version of [`Job`] that is written. Version 1 had no request, and version 2 none of trainings at first.
const JOB_VERSION: u32 = 2;

/// Schedulers have arrays of thousands of tasks; each shard is a file, too.
const MAX_SHARDS: u64 = 1_000_000;
/// Beyond this, episodes times shards is no number of this program.
const MAX_EPISODES: u64 = 1_000_000_000_000;

/// What is asked for.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    version: u32,
    /// SHA-256 of what the results depend on; see [`Job::new`].
    pub hash: String,
    /// What is divided into shards.
    #[serde(default = "nothing")]
    pub request: Divided,
    /// The command by which it was asked for, without what divides it: for people.
    pub command: Vec<String>,
    /// In the log of a recording, seconds between lines, where they were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report_every: Option<u64>,
    /// What follows each training run; none where nothing follows any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tracking: Vec<Tracking>,
    /// Further arguments of each training run, for people.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub each: Vec<Vec<String>>,
    /// The number of shards.
    pub shards: u64,
    /// Episodes of all shards; 0 for training runs.
    pub episodes: u64,
    /// What runs the shards.
    pub program: Program,
    /// What they read.
    pub inputs: Vec<Input>,
    /// The working folder of the command, to which its paths are relative.
    pub folder: PathBuf,
}

/// No request, as in a job that was written by its words alone.
fn nothing() -> Divided {
    Divided::Train(Vec::new())
}

/// What a command asks for.
pub struct Asked {
    /// What is divided.
    pub request: Divided,
    /// See [`Job::report_every`].
    pub report_every: Option<u64>,
    /// See [`Job::tracking`].
    pub tracking: Vec<Tracking>,
}

impl Default for Asked {
    fn default() -> Self {
        Self { request: nothing(), report_every: None, tracking: Vec::new() }
    }
}

/// A file or folder that the command reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The file or folder.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Seconds since 1970.
    pub modified: u64,
    /// Of the content.
    pub sha256: String,
}

impl Input {
    /// The file or folder at `path`.
    ///
    /// # Errors
    ///
    /// It cannot be read.
    pub fn of(path: &Path) -> Result<Self, JobError> {
        if is_remote(path) {
            // Its hash is that of its version, which costs little.
            return Ok(Self { bytes: 0, modified: 0, sha256: file_hash(path)?, path: path.to_owned() });
        }
        let path = std::path::absolute(path).map_err(cannot("read", path))?;
        let (bytes, modified) = stamp(&path)?;
        Ok(Self { bytes, modified, sha256: file_hash(&path)?, path })
    }

    /// Checks that it is as it was: size and time, else its content; with `fully` always the content.
    ///
    /// # Errors
    ///
    /// It is missing or has changed.
    pub fn check(&self, fully: bool) -> Result<(), JobError> {
        let has_stamp = !fully && !is_remote(&self.path) && !self.path.is_dir();
        let is_as_it_was = has_stamp && stamp(&self.path)? == (self.bytes, self.modified);
        if is_as_it_was || file_hash(&self.path)? == self.sha256 {
            return Ok(());
        }
        Err(JobError::Changed(self.path.clone()))
    }
}

/// Size and time of the last change.
fn stamp(path: &Path) -> Result<(u64, u64), JobError> {
    let metadata = fs::metadata(path).map_err(cannot("read", path))?;
    Ok((metadata.len(), metadata.modified().map_or(0, seconds)))
}

impl Job {
    /// A job. Its hash is of the request, the shards, the program and the content of the inputs.
    ///
    /// # Errors
    ///
    /// The working folder is unknown.
    pub fn new(
        asked: Asked,
        command: Vec<String>,
        each: Vec<Vec<String>>,
        shards: u64,
        program: Program,
    ) -> Result<Self, JobError> {
        let (hash, inputs, folder) = (String::new(), Vec::new(), std::env::current_dir()?);
        let version = JOB_VERSION;
        let Asked { request, report_every, mut tracking } = asked;
        if tracking.iter().all(|one| one.trackers.is_empty()) {
            tracking.clear();
        }
        let mut job = Self {
            version,
            hash,
            request,
            command,
            report_every,
            tracking,
            each,
            shards,
            episodes: 0,
            program,
            inputs,
            folder,
        };
        job.hash = job.hashed()?;
        Ok(job)
    }

    /// The job with so many episodes, that reads these files.
    ///
    /// # Errors
    ///
    /// As of [`Job::new`].
    pub fn with(self, episodes: u64, inputs: Vec<Input>) -> Result<Self, JobError> {
        let mut job = Self { episodes, inputs, ..self };
        job.hash = job.hashed()?;
        Ok(job)
    }

    fn hashed(&self) -> Result<String, JobError> {
        let contents: Vec<(&Path, &str)> =
            self.inputs.iter().map(|input| (input.path.as_path(), input.sha256.as_str())).collect();
        let Self { request, shards, episodes, program, .. } = self;
        let no_words: [(); 0] = [];
        let all =
            (JOB_VERSION, request, no_words, shards, episodes, &program.sha256, &program.about, contents);
        Ok(sha256(serde_json::to_string(&all)?.as_bytes()))
    }

    /// Checks what its numbers are: others may have changed them.
    fn check(&self) -> Result<(), String> {
        let Self { shards, episodes, .. } = *self;
        match () {
            () if !(1..=MAX_SHARDS).contains(&shards) => {
                Err(format!("`shards` is {shards}; a job has 1 to {MAX_SHARDS}"))
            }
            () if episodes > MAX_EPISODES => {
                Err(format!("`episodes` is {episodes}; a job has up to {MAX_EPISODES}"))
            }
            () => match &self.request {
                Divided::Train(runs) if runs.len() as u64 == shards => Ok(()),
                Divided::Train(runs) => Err(format!("`shards` is {shards}, of {} runs", runs.len())),
                _ if shards > episodes => Err(format!("`shards` is {shards}, of {episodes} episodes")),
                _ => Ok(()),
            },
        }
    }

    /// The episodes of a shard, counted from 1; none of training runs.
    pub fn range(&self, shard: u64) -> Range<u64> {
        parts::range(shard, self.shards, self.episodes)
    }

    /// The name that engines show, by which its tasks are found again.
    pub fn name(&self) -> String {
        format!("swm-{}", &self.hash[..12.min(self.hash.len())])
    }

    /// In what `asked` differs from this job.
    pub fn difference(&self, asked: &Job) -> Option<String> {
        let line = |job: &Job| job.command.join(" ");
        let differs = |a: &Input, b: &Input| (&a.path, &a.sha256) != (&b.path, &b.sha256);
        let changed = self.inputs.iter().zip(&asked.inputs).find(|(a, b)| differs(a, b));
        if self.hash == asked.hash {
            None
        } else if self.request != asked.request {
            Some(format!("its arguments: it holds `{}`, not `{}`", line(self), line(asked)))
        } else if self.shards != asked.shards {
            Some(format!("its shards: it has {}, not {}", self.shards, asked.shards))
        } else if let Some((input, _)) = changed {
            Some(format!("its inputs: {} has changed", input.path.display()))
        } else if self.program.sha256 != asked.program.sha256 {
            Some("its program: this is another build of `swm`".to_owned())
        } else {
            Some("what it depends on: the physics, the number of episodes or the version of `swm`".to_owned())
        }
    }
}

/// The folder of a job.
#[derive(Clone, Debug)]
pub struct JobFolder {
    /// The folder.
    pub dir: PathBuf,
    /// The description in it.
    pub job: Job,
}

impl JobFolder {
    /// The command that runs what is missing: by the engine that it was submitted to, or else on this machine.
    pub fn command_for_the_rest(&self) -> String {
        let dir = self.dir.display();
        match self.is_with_an_engine() {
            true => format!("swm submit --job {dir}"),
            false => format!("swm task {dir} --all"),
        }
    }

    /// Opens the job in `dir`; `None` if there is none. `read` reads the words of a job that has no request: its command, and further
    /// arguments of each run.
    ///
    /// # Errors
    ///
    /// The folder holds something else, or a job of a newer version; or `read` fails.
    pub fn open(
        dir: &Path,
        read: impl FnOnce(&[String], &[Vec<String>]) -> Result<Asked, TaskError>,
    ) -> Result<Option<Self>, JobError> {
        let dir = std::path::absolute(dir).map_err(cannot("read", dir))?;
        let Some(mut job) = read_json::<Job>(&dir.join("job.json"))? else {
            let is_used = fs::read_dir(&dir).is_ok_and(|entries| {
                // What an interrupted `swm submit` leaves is no obstacle.
                entries.flatten().any(|entry| !OWN_FOLDERS.iter().any(|own| entry.file_name() == *own))
            });
            return if is_used { Err(JobError::NoJob(dir)) } else { Ok(None) };
        };
        if job.version > JOB_VERSION {
            return Err(JobError::Newer { dir, version: job.version });
        }
        if job.request == nothing() {
            let Asked { request, tracking, .. } = read(&job.command, &job.each)?;
            (job.request, job.tracking) = (request, tracking);
        }
        job.check().map_err(|reason| JobError::Damaged { file: dir.join("job.json"), reason })?;
        Ok(Some(Self { dir, job }))
    }

    /// Makes the folder of a job, with the program in it. The description comes last.
    ///
    /// # Errors
    ///
    /// The folder cannot be written.
    pub fn create(dir: &Path, job: Job) -> Result<Self, JobError> {
        let created = Self::planned(dir, job)?;
        for folder in ["parts", "done", "logs"] {
            let folder = created.dir.join(folder);
            fs::create_dir_all(&folder).map_err(cannot("make the folder", &folder))?;
        }
        if created.job.program.is_copied {
            let (to, new) = (copy_in(&created.dir), created.dir.join("swm.new"));
            let copied = fs::copy(&created.job.program.path, &new).and_then(|_| fs::rename(&new, &to));
            copied.map_err(cannot("copy the program to", &to))?;
        }
        write_json(&created.dir.join("job.json"), &created.job)?;
        Ok(created)
    }

    /// The folder of a job that is not made yet.
    ///
    /// # Errors
    ///
    /// The working folder is unknown.
    pub fn planned(dir: &Path, job: Job) -> Result<Self, JobError> {
        let dir = std::path::absolute(dir).map_err(cannot("write", dir))?;
        Ok(Self { dir, job })
    }

    /// Held while the job is being submitted, so that nobody submits it at the same time.
    ///
    /// # Errors
    ///
    /// Another process holds it, who is named.
    pub fn lock(dir: &Path) -> Result<WriterLock, JobError> {
        fs::create_dir_all(dir).map_err(cannot("make the folder", dir))?;
        Ok(WriterLock::take(&dir.join("job"))?)
    }

    /// Checks that the program, which `about` describes, and the inputs are those of the job; with `fully` the content of all.
    ///
    /// # Errors
    ///
    /// One of them differs.
    pub fn check(&self, about: &str, fully: bool) -> Result<(), JobError> {
        self.job.program.check(&self.dir, about)?;
        self.job.inputs.iter().try_for_each(|input| input.check(fully))
    }

    /// `DIR/parts/0003-of-0064.h5`: what shard `shard` writes.
    pub fn part(&self, shard: u64, extension: &str) -> PathBuf {
        self.dir.join("parts").join(format!("{shard:04}-of-{:04}.{extension}", self.job.shards))
    }

    /// What shard `shard` leaves behind: its part, or the folder of a training run.
    pub fn written(&self, shard: u64) -> PathBuf {
        match &self.job.request {
            Divided::Train(_) => self.run(shard),
            Divided::Record(record) => self.part(shard, extension(record)),
            _ => self.part(shard, "jsonl"),
        }
    }

    /// The result, in the folder of the job.
    pub fn result(&self) -> String {
        match &self.job.request {
            Divided::Record(record) => format!("result.{}", extension(record)),
            Divided::Sweep(_) => "sweep.json".to_owned(),
            Divided::Train(_) => "runs".to_owned(),
            _ => "receipt.json".to_owned(),
        }
    }

    /// `DIR/runs/0003`: the folder of a training run.
    pub fn run(&self, shard: u64) -> PathBuf {
        self.dir.join("runs").join(format!("{shard:04}"))
    }

    /// `DIR/done/0003.json`: that shard `shard` is done.
    pub fn done(&self, shard: u64) -> PathBuf {
        self.dir.join("done").join(format!("{shard:04}.json"))
    }

    /// `DIR/done/0003.failed`: that shard `shard` ended with an error.
    pub fn failed(&self, shard: u64) -> PathBuf {
        self.dir.join("done").join(format!("{shard:04}.failed"))
    }

    /// `DIR/logs/0003.log`: what shard `shard` printed.
    pub fn log(&self, shard: u64) -> PathBuf {
        self.dir.join("logs").join(format!("{shard:04}.log"))
    }

    /// `DIR/finished.json`: that the shards were joined to the result.
    pub fn finished(&self) -> PathBuf {
        self.dir.join("finished.json")
    }

    /// What continues an interrupted task.
    pub fn way_on(&self) -> String {
        let command = self.command_for_the_rest();
        match self.is_with_an_engine() {
            true => format!("start the task again, or `{command}`"),
            false => format!("start the task again, or all that are left: {command}"),
        }
    }

    /// Whether it was handed to an engine; else its shards are run by hand.
    pub fn is_with_an_engine(&self) -> bool {
        self.submissions().is_file()
    }

    /// What a lock says of who runs a shard: beside `DIR/done/0003`.
    pub fn shard_lock(&self, shard: u64) -> PathBuf {
        self.dir.join("done").join(format!("{shard:04}"))
    }

    /// `DIR/submissions.jsonl`: what was handed to engines.
    pub fn submissions(&self) -> PathBuf {
        self.dir.join("submissions.jsonl")
    }
}

/// The extension of the parts of a recording: that of its format.
pub fn extension(record: &Record) -> &str {
    match record.format.as_deref() {
        None | Some("hdf5") => "h5",
        Some(format) => format,
    }
}

/// What `swm submit` makes before `job.json`.
const OWN_FOLDERS: &[&str] = &["parts", "done", "logs", "swm", "swm.new", "job.lock"];

#[cfg(test)]
mod tests {
    use swm_tasks::request::Train;

    use super::*;

    fn job(seed: u64, shards: u64, program: &str, content: &str) -> Job {
        let (about, path) = ("swm".to_owned(), "/bin/swm".into());
        let program = Program { about, path, is_copied: true, sha256: program.into(), package: None };
        let input = Input { path: "/m.toml".into(), bytes: 1, modified: 2, sha256: content.into() };
        let request = Record { seed, ..Record::default() };
        let command = vec!["collect".to_owned(), format!("--seed={seed}")];
        let asked = Asked { request: Divided::Record(Box::new(request)), ..Asked::default() };
        Job::new(asked, command, Vec::new(), shards, program).unwrap().with(16, vec![input]).unwrap()
    }

    #[test]
    fn what_differs_is_named() {
        let one = job(1, 4, "p", "c");
        assert_eq!(one.difference(&job(1, 4, "p", "c")), None);
        let named = |other: Job| one.difference(&other).unwrap();
        assert!(named(job(2, 4, "p", "c")).contains("`collect --seed=1`, not `collect --seed=2`"));
        assert!(named(job(1, 8, "p", "c")).contains("it has 4, not 8"));
        assert!(named(job(1, 4, "q", "c")).contains("another build"));
        assert!(named(job(1, 4, "p", "d")).contains("/m.toml has changed"));
        assert_eq!(one.name().len(), 16);
    }

    #[test]
    fn other_words_for_the_same_request_and_the_time_of_a_change_are_no_change() {
        let mut other = job(1, 4, "p", "c");
        other.command = vec!["collect".to_owned(), "--seed".to_owned(), "1".to_owned()];
        other.inputs[0].modified = 9;
        let inputs = other.inputs.clone();
        assert_eq!(other.with(16, inputs).unwrap().hash, job(1, 4, "p", "c").hash);
    }

    #[test]
    fn the_format_gives_the_extension() {
        let of = |format: Option<&str>| {
            extension(&Record { format: format.map(str::to_owned), ..Record::default() }).to_owned()
        };
        assert_eq!([None, Some("hdf5"), Some("video")].map(of), ["h5", "h5", "video"]);
    }

    #[test]
    fn the_request_of_an_older_job_is_read_from_its_words() {
        let folder = tempfile::tempdir().unwrap();
        let each = vec![vec!["--seed=1".to_owned()]];
        let job = Job { version: 1, each, ..job(1, 4, "p", "c") };
        let written = Job { request: nothing(), ..job.clone() };
        let mut json = serde_json::to_value(&written).unwrap();
        json.as_object_mut().unwrap().remove("request");
        write_json(&folder.path().join("job.json"), &json).unwrap();
        let opened = JobFolder::open(folder.path(), |command, each| {
            assert_eq!((command, each), (&job.command[..], &job.each[..]));
            Ok(Asked { request: job.request.clone(), ..Asked::default() })
        });
        assert_eq!(opened.unwrap().unwrap().job.request, job.request);
        let failed = JobFolder::open(folder.path(), |_, _| Err("no such command".into()));
        assert_eq!(failed.unwrap_err().to_string(), "no such command");
    }

    #[test]
    fn a_training_is_written_as_its_requests_and_has_a_shard_for_each() {
        let folder = tempfile::tempdir().unwrap();
        let runs = [1, 2].map(|seed| Train { seed: Some(seed), ..Train::default() }).to_vec();
        let of = |shards: u64| Job { request: Divided::Train(runs.clone()), ..job(1, shards, "p", "c") };
        let open = |job: &Job| {
            write_json(&folder.path().join("job.json"), job).unwrap();
            JobFolder::open(folder.path(), |_, _| Err("it has a request".into()))
        };
        assert_eq!(open(&of(2)).unwrap().unwrap().job.request, Divided::Train(runs.clone()));
        assert!(open(&of(3)).unwrap_err().to_string().contains("`shards` is 3, of 2 runs"));
    }
}
