//! `swm submit`: divides a command into shards and hands them to a scheduler; again, only those that are missing.

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;
use swm_tasks::request::cannot;

use super::output::counted;
use super::{Failure, Output, usage, version, work};
use crate::evaluation::file_bytes;
use crate::jobs::{
    ENGINES, Engine, Handover, Input, Job, JobFolder, Program, Progress, Submission, Submitted, engine,
    free_bytes,
};
use crate::text_file::read_text;

/// Divide a command into shards, and submit them as tasks of a scheduler: Slurm, HyperQueue, or another.
#[derive(Args)]
#[command(after_help = help())]
pub(super) struct Submit {
    /// The scheduler: slurm, hq (HyperQueue), or script, which prints the commands for another; settings follow as :KEY=VALUE,… Default: as before.
    #[arg(long, value_name = "SCHEDULER")]
    on: Option<String>,
    /// The number of shards: parts of the work, each a task of a Slurm job array. Choose it so that each takes 10 to 60 minutes.
    #[arg(long, value_name = "N", conflicts_with = "each", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    shards: Option<u64>,
    /// The job's folder, which is made: it gets the program, logs, shards and result.
    #[arg(long, value_name = "DIR")]
    job: PathBuf,
    /// With train: a file with further arguments, a line per run; each is a shard.
    #[arg(long, value_name = "FILE")]
    each: Option<PathBuf>,
    /// Print what the scheduler would get, and submit nothing.
    #[arg(long)]
    dry_run: bool,
    /// Wait for the result; exit status 1 if shards fail.
    #[arg(long, conflicts_with = "dry_run")]
    wait: bool,
    /// Let tasks start this program where it is, in place of a copy in the job's folder. The Python package is never copied.
    #[arg(long)]
    no_copy: bool,
    /// With collect: record about K episodes first, and refuse a job that the disk has no space for.
    #[arg(long, value_name = "K", default_value_t = 0)]
    pilot: u64,
    /// Submit although the disk seems too small.
    #[arg(long)]
    force: bool,
    /// The command and its arguments, after `--`.
    #[arg(last = true, value_name = "COMMAND")]
    command: Vec<String>,
}

/// Examples, and the engines with their keys.
fn help() -> String {
    let engines = ENGINES.iter().map(|engine| {
        let keys = engine.keys.iter().map(|(key, about)| format!("    {key:12} {about}\n"));
        format!("  {:12}   {}\n{}", engine.name, engine.about, keys.collect::<String>())
    });
    format!(
        "\
Examples:
  swm submit --on slurm:partition=cpu,time=2:00:00,cpus=16 --shards 64 --job pusht -- collect swm/PushT-v1 --episodes 100000
  swm submit --on hq:cpus=8 --shards 64 --job sweep -- sweep --manifest pusht-strict.toml --policy cem
  swm submit --on script --shards 8 --job pusht -- collect swm/PushT-v1 --episodes 800    (prints the commands)
  swm submit --job pusht      (again: what is neither done nor queued)
  swm submit --on slurm --each runs.txt --job runs -- train lewm --dataset tworoom.h5    (a training run per line of arguments)

The commands are collect, eval --manifest, sweep and train, without --out: results go to the job's folder, which all machines must \
see. It holds the program itself, so that a rebuild does not change queued tasks; of the Python package, its version and hash, which tasks check. The last task joins the shards: the result equals \
that of the undivided command. `swm jobs` shows progress. `swm submit` does not wait; --wait does.

Schedulers and their settings, --on SCHEDULER:KEY=VALUE,…:
{}",
        engines.collect::<String>()
    )
}

/// A result has this part of the free space, so that parts and result fit.
const PARTS_AND_RESULT: u64 = 2;

impl Submit {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let on = self.on.as_deref().map(engine).transpose()?;
        let asked = if self.command.is_empty() { None } else { Some(self.job(registry, output)?) };
        if let (Some((engine, _)), Some(job)) = (&on, &asked)
            && !self.dry_run
            && !self.job.exists()
        {
            // A scheduler that does not answer is said before there is a folder.
            let planned = JobFolder::planned(&self.job, job.clone())?;
            engine.driver.queued(&planned).map_err(|error| {
                format!("--on {}: {error}; --dry-run shows the script without asking it", engine.name)
            })?;
        }
        let _lock = if self.dry_run { None } else { Some(JobFolder::lock(&self.job)?) };
        let folder = match (work::open(registry, &self.job).map_err(usage)?, asked) {
            (Some(held), Some(asked)) => {
                if let Some(difference) = held.job.difference(&asked) {
                    let dir = held.dir.display();
                    return Err(usage(format!("{dir} is another job in {difference}; give another folder")));
                }
                held
            }
            (Some(held), None) => {
                held.job.inputs.iter().try_for_each(|input| input.check(false)).map_err(usage)?;
                held
            }
            (None, Some(job)) if self.dry_run => JobFolder::planned(&self.job, job)?,
            (None, Some(job)) => JobFolder::create(&self.job, job)?,
            (None, None) => {
                let dir = self.job.display();
                return Err(usage(format!("{dir} holds no job; give the command: -- collect …")));
            }
        };
        self.measure(registry, &folder, output)?;
        let submissions = Submission::all(&folder)?;
        let on = self.on.clone().or_else(|| Some(submissions.last()?.on.clone()));
        // Where nothing is left to run, no scheduler is needed.
        let is_done = || Ok::<_, Failure>(Progress::of(&folder)?.missing(&folder).is_empty());
        let on = if on.is_none() && is_done()? { Some("script".to_owned()) } else { on };
        let on = on.ok_or_else(|| {
            let here = folder.command_for_the_rest();
            usage(format!(
                "--on is missing, and the job was not submitted before; name a scheduler (--on slurm, --on hq), let --on script print \
                 the commands, or run it here: {here}"
            ))
        })?;
        let (engine, settings) = engine(&on)?;
        if self.wait && engine.name == "script" {
            return Err(usage(
                "--wait: nothing is started by --on script; `swm task JOB --all` runs the shards here",
            ));
        }
        let handover = Handover { folder: &folder, engine, settings: &settings, on: &on };
        let sent = handover.send(&submissions, self.dry_run)?;
        if self.wait {
            output.note(text(&sent, &folder, engine));
            handover.wait()?;
        }
        let prints_script = !sent.is_submitted && !sent.script.is_empty();
        output.result(&sent.json(&folder, engine), || match prints_script {
            true => sent.script.clone(),
            false => text(&sent, &folder, engine),
        })
    }

    /// The job that is asked for. Environment and policy are made, and manifests read.
    fn job(&self, registry: &Registry, output: &Output) -> Result<Job, Failure> {
        let each = match &self.each {
            None => Vec::new(),
            Some(_) if self.command.first().is_none_or(|name| name != "train") => {
                return Err(usage("--each is for `swm train`; use --shards"));
            }
            Some(path) => {
                let text =
                    read_text(path).map_err(|error| usage(format!("--each {}: {error}", path.display())))?;
                let lines = text.lines().filter(|line| !line.trim().is_empty());
                lines.map(|line| line.split_whitespace().map(str::to_owned).collect()).collect()
            }
        };
        let asked = work::work(registry, &self.command, &each, output)?;
        let is_train = asked.request.is_of_runs();
        let shards = match (is_train, self.shards) {
            (true, None | Some(1)) => each.len().max(1) as u64,
            (true, _) => {
                return Err(usage("a training run is not divided; --each FILE submits several runs"));
            }
            (_, Some(shards)) => shards,
            (_, None) => {
                return Err(usage(
                    "--shards is missing: into how many parts, each a task, is the work divided?",
                ));
            }
        };
        let program = Program::this(version::long(), !self.no_copy)?;
        let job = Job::new(asked, self.command.clone(), each, shards, program)?;
        let folder = JobFolder::planned(&self.job, job.clone())?;
        let (mut episodes, mut inputs) = (0, BTreeSet::new());
        // What one part of a recording or an evaluation needs, all do.
        for shard in 1..=if is_train { shards } else { 1 } {
            let needs = folder.shard_request(shard)?.needs(registry, &mut &*output)?;
            episodes = needs.episodes;
            inputs.extend(needs.inputs);
        }
        if !is_train && shards > episodes {
            let episodes = counted(episodes, "episode");
            return Err(usage(format!(
                "--shards {shards}: there are {episodes}; use as many shards or fewer"
            )));
        }
        let inputs = inputs.iter().map(|path| Input::of(path)).collect::<Result<_, _>>().map_err(usage)?;
        Ok(job.with(episodes, inputs)?)
    }

    /// Records some episodes and compares the space of all with what is free.
    fn measure(&self, registry: &Registry, folder: &JobFolder, output: &Output) -> Result<(), Failure> {
        if self.pilot == 0 || self.dry_run {
            return Ok(());
        }
        let path = work::run_pilot(registry, folder, self.pilot)?;
        let recorded = swm_data::open_in(registry, &path)?.num_episodes().max(1) as u64;
        let bytes = file_bytes(&path)?;
        let removed =
            if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        removed.map_err(cannot("remove", &path))?;
        let needed = (bytes as f64 / recorded as f64 * folder.job.episodes as f64) as u64 * PARTS_AND_RESULT;
        let gigabytes = |bytes: u64| format!("{:.2} GB", bytes as f64 / 1e9);
        let free = free_bytes(&folder.dir);
        match free {
            Some(free) if free < needed && !self.force => Err(usage(format!(
                "{}: parts and result need about {}, and {} are free; use --replayable or another disk, or --force",
                folder.dir.display(),
                gigabytes(needed),
                gigabytes(free)
            ))),
            free => {
                let free =
                    free.map_or(String::new(), |free| format!(" of {} that are free", gigabytes(free)));
                output.note(format!("parts and result need about {}{free}", gigabytes(needed)));
                Ok(())
            }
        }
    }
}

/// What was handed over, in a line.
fn text(sent: &Submitted, folder: &JobFolder, engine: &Engine) -> String {
    let Submitted { shards, done, queued, id, is_finish, .. } = sent;
    match id {
        Some(id) if !shards.is_empty() => format!(
            "submitted {} to {} as job {id} ({done} done, {queued} queued before); swm jobs {} shows progress",
            counted(shards.len(), "shard"),
            engine.name,
            folder.dir.display()
        ),
        _ if *is_finish => format!("all shards are done; their join was submitted to {}", engine.name),
        _ => format!(
            "nothing to submit: of {} {done} are done and {queued} are queued",
            counted(folder.job.shards, "shard")
        ),
    }
}
