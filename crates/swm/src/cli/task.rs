//! `swm task`: a shard of a job, all that are left, or their join. Schedulers start it.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use swm_core::Registry;
use swm_files::WriterLock;
use swm_tasks::request::cannot;

use super::output::{Postponed, counted, print_to_stderr};
use super::{Failure, Output, interrupt, usage, version, work};
use crate::evaluation::{file_bytes, file_hash};
use crate::jobs::{
    Attempt, Failed, Finished, JobFolder, Progress, attempts, is_written, open_log, shards_of, task,
    write_json,
};

/// Run a shard of a job: what schedulers start.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm task JOB --index 3
  swm task JOB --all        (every shard that is left, one after the other)
  swm task JOB --finish     (join the shards)
  parallel -j8 swm task JOB --index ::: $(seq 64)

Without --index, the shard is that of the scheduler's environment variable: SLURM_ARRAY_TASK_ID, HQ_TASK_ID, JOB_COMPLETION_INDEX \
(Kubernetes), AWS_BATCH_JOB_ARRAY_INDEX, PBS_ARRAY_INDEX or SGE_TASK_ID. A shard that is done is not run again, and one that was \
interrupted goes on. Exit status: 0 done, 1 failed, 2 the request is wrong, 75 stopped in time: start the task again.")]
pub(super) struct Task {
    /// The job's folder.
    #[arg(value_name = "JOB")]
    job: PathBuf,
    /// The shard, counted from 1.
    #[arg(long, value_name = "I", conflicts_with_all = ["all", "finish"])]
    index: Option<u64>,
    /// Also run every T-th shard after it.
    #[arg(long, value_name = "T", requires = "index", value_parser = clap::value_parser!(u64).range(1..))]
    entries: Option<u64>,
    /// Run every shard that is not done, one after the other. Shards that other tasks are running are left to them.
    #[arg(long, conflicts_with = "finish")]
    all: bool,
    /// Join the shards to the result and verify it.
    #[arg(long)]
    finish: bool,
}

/// Before a shard that met an error of the file system is tried once more.
const RETRY_AFTER: Duration = Duration::from_secs(2);
/// A shard is started if so many times the longest one fits into the time that is left.
const TIME_MARGIN: f64 = 1.3;

impl Task {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let started = Instant::now();
        let folder = work::open(registry, &self.job).map_err(usage)?;
        let folder = folder
            .ok_or_else(|| usage(format!("{} holds no job; `swm submit` makes one", self.job.display())))?;
        let dir = folder.dir.display().to_string();
        interrupt::within_task(folder.way_on());
        interrupt::watch_resumable(move || format!("what is committed is safe in {dir}"), interrupt::REPEAT);
        folder.check(version::long(), self.finish).map_err(usage)?;
        let here = &folder.job.folder;
        std::env::set_current_dir(here).map_err(|error| {
            usage(format!(
                "the job was submitted in the folder {}, which is not there: {error}",
                here.display()
            ))
        })?;
        let run = Run { registry, folder: &folder, output };
        if self.finish {
            return run.finish();
        }
        let shards: Vec<u64> = match self.all {
            true => Progress::of(&folder)?.missing(&folder),
            false => {
                let (index, of) = (self.index()?, folder.job.shards);
                let entries = self.entries.unwrap_or(of);
                if !(1..=entries.min(of)).contains(&index) {
                    return Err(usage(format!("--index {index}: the job has {}", counted(of, "shard"))));
                }
                shards_of(index, entries, of).collect()
            }
        };
        let mut failed: Option<Failure> = None;
        let mut longest = 0.0_f64;
        for &shard in &shards {
            let left = task::time_left(started);
            if left.is_some_and(|left| longest > 0.0 && longest * TIME_MARGIN > left) {
                return Err(
                    Postponed("the time that is left is too short for another shard".to_owned()).into()
                );
            }
            let begun = Instant::now();
            match run.shard(shard) {
                Ok(()) => longest = longest.max(begun.elapsed().as_secs_f64()),
                Err(failure) if failure.is_cancelled() => {
                    // What was told when the signal came is in the log of the shard.
                    let how = folder.way_on();
                    output.note(format!("interrupted in shard {shard}; to continue, {how}"));
                    return Err(failure);
                }
                // Such as the process of a node that only seemed lost: it may finish the shard, or end.
                Err(failure) if failure.is_busy() && !self.all => {
                    return Err(Postponed(failure.reason()).into());
                }
                Err(failure) if shards.len() == 1 => return Err(failure),
                Err(failure) if failure.is_busy() => {
                    output.note(format!("shard {shard} is left out: {failure}"));
                }
                Err(failure) => {
                    output.note(format!("shard {shard} failed: {failure}"));
                    failed = failed.or(Some(failure));
                }
            }
        }
        if self.all
            && let Some(join) = Progress::of(&folder)?.join_command(&folder)
        {
            output.note(format!("all shards are done; to join them to the result: {join}"));
        }
        failed.map_or(Ok(()), Err)
    }

    /// The shard that is asked for.
    fn index(&self) -> Result<u64, Failure> {
        self.index
            .or_else(task::entry)
            .ok_or_else(|| usage("no scheduler says which shard this is; give --index I, --all or --finish"))
    }
}

/// A job at work.
struct Run<'a> {
    registry: &'a Registry,
    folder: &'a JobFolder,
    output: &'a Output,
}

impl Run<'_> {
    /// Runs a shard, or the rest of it.
    fn shard(&self, shard: u64) -> Result<(), Failure> {
        let Self { registry, folder, output } = *self;
        let done = folder.done(shard);
        let of = folder.job.shards;
        let lock = WriterLock::take(&folder.shard_lock(shard))?;
        // A part that was lost is made again, unless the result is there.
        let has_result =
            || Ok::<_, Failure>(Finished::of(folder)?.is_some_and(|made| made.lost(folder).is_none()));
        if is_written(&done) && (folder.written(shard).exists() || has_result()?) {
            output.note(format!("shard {shard} of {of} was done already"));
            return Ok(());
        }
        let log_path = folder.log(shard);
        let earlier = attempts(&log_path);
        let attempt = Attempt::after(&earlier, folder.committed(registry, shard));
        let started = Instant::now();
        let run = || {
            attempt.check_progress(&earlier)?;
            let _redirected = Redirected::to(&log_path)?;
            print_to_stderr(&format!("{attempt}\n"));
            let output = Output::new(false, false);
            let ran = again_after_io_error(|| work::run_shard(registry, folder, shard, &output));
            let ran = ran.and_then(|()| Ok(folder.check_shard(registry, shard)?));
            match &ran {
                Err(failure) if failure.is_cancelled() => interrupt::say(),
                Err(failure) => print_to_stderr(&format!("{failure}\n")),
                Ok(()) => {}
            }
            ran
        };
        let ran = run().and_then(|()| Ok(folder.write_done(shard, &attempt, started.elapsed())?));
        match ran {
            Err(failure) if failure.is_cancelled() => Err(failure),
            Err(failure) => {
                let (status, message) = (failure.exit_code(), failure.to_string());
                let Attempt { number: attempt, node, .. } = attempt;
                Failed { status, message, attempt, node }.write(&folder.failed(shard));
                Err(failure)
            }
            Ok(()) => {
                drop(lock);
                output.note(format!(
                    "shard {shard} of {of} is done ({:.1} s)",
                    started.elapsed().as_secs_f64()
                ));
                Ok(())
            }
        }
    }

    /// Joins the shards, if all are done.
    fn finish(&self) -> Result<(), Failure> {
        let Self { registry, folder, output } = *self;
        let _lock = WriterLock::take(&folder.dir.join("finish"))?;
        let result = folder.result();
        let path = folder.dir.join(&result);
        let progress = Progress::of(folder)?;
        if progress.finished.is_some() {
            output.note(format!("{} was there already", path.display()));
            return Ok(());
        }
        if let Some(lost) = &progress.lost_result {
            let what_now =
                if progress.missing(folder).is_empty() { ": the shards are joined again" } else { "" };
            output.note(format!("{} was there before and is missing{what_now}", lost.display()));
        }
        folder.check_complete(&progress)?;
        {
            let _redirected = Redirected::to(&folder.dir.join("logs/finish.log"))?;
            let joined = folder
                .check_parts(&progress)
                .map_err(Failure::from)
                .and_then(|()| work::join(registry, folder, &Output::new(false, false)));
            if let Err(failure) = &joined {
                print_to_stderr(&format!("{failure}\n"));
            }
            joined?;
        }
        let is_divided = !folder.job.request.is_of_runs();
        let sha256 = if is_divided { file_hash(&path)? } else { String::new() };
        let finished = Finished { result, bytes: file_bytes(&path)?, sha256, episodes: folder.job.episodes };
        write_json(&folder.finished(), &finished)?;
        let told = json!({ "job": folder.dir, "result": path, "bytes": finished.bytes, "episodes": finished.episodes });
        output.result(&told, || match is_divided {
            false => format!("all runs are in {}", path.display()),
            true => format!("wrote {} ({})", path.display(), counted(finished.episodes, "episode")),
        })
    }
}

/// Runs something, once more if the file system failed: over networks that passes.
fn again_after_io_error(mut run: impl FnMut() -> Result<(), Failure>) -> Result<(), Failure> {
    match run() {
        Err(failure) if failure.is_passing() => {
            print_to_stderr(&format!("{failure}\nswm task: tried once more\n"));
            std::thread::sleep(RETRY_AFTER);
            run()
        }
        ran => ran,
    }
}

/// What is printed goes to a log until this is dropped.
pub(super) struct Redirected {
    #[cfg(unix)]
    before: [std::os::fd::OwnedFd; 2],
}

#[cfg(unix)]
impl Redirected {
    pub(super) fn to(path: &Path) -> Result<Self, Failure> {
        use std::os::fd::AsFd as _;

        let file = open_log(path).map_err(cannot("write", path))?;
        std::io::stdout().flush()?;
        let before = [
            std::io::stdout().as_fd().try_clone_to_owned()?,
            std::io::stderr().as_fd().try_clone_to_owned()?,
        ];
        rustix::stdio::dup2_stdout(&file)?;
        rustix::stdio::dup2_stderr(&file)?;
        Ok(Self { before })
    }
}

#[cfg(unix)]
impl Drop for Redirected {
    fn drop(&mut self) {
        let [out, err] = &self.before;
        // Where the former ones are closed, nobody reads them.
        let _ = std::io::stdout().flush();
        let _ = rustix::stdio::dup2_stdout(out);
        let _ = rustix::stdio::dup2_stderr(err);
    }
}

#[cfg(not(unix))]
impl Redirected {
    /// Here the log holds the attempts alone; what is printed goes where the scheduler puts it.
    pub(super) fn to(path: &Path) -> Result<Self, Failure> {
        open_log(path).map_err(|error| cannot("write", path, error))?;
        Ok(Self {})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_may_pass_is_tried_again() {
        let tries = |kind: std::io::ErrorKind| {
            let mut count = 0;
            let ran = again_after_io_error(|| {
                count += 1;
                Err(std::io::Error::from(kind).into())
            });
            assert!(ran.is_err());
            count
        };
        assert_eq!(tries(std::io::ErrorKind::StorageFull), 1);
        assert_eq!(tries(std::io::ErrorKind::Other), 2);
    }
}
