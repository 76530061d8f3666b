//! The commands that a job can divide: their requests, those of a shard, and how the shards are joined.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{CommandFactory as _, FromArgMatches as _};
use swm_core::Registry;
use swm_core::error::BoxError;
use swm_data::WriteMode;
use swm_tasks::request::{Divided, Shard};
use swm_tasks::threads::within;

use super::task::Redirected;
use super::{Cli, Command, Failure, Output, collect, eval, run_command, sweep, usage};
use crate::jobs::files::cannot;
use crate::jobs::job::extension;
use crate::jobs::{Job, JobFolder};
use crate::text_file::read_text;

/// The commands that can be divided.
const DIVIDED: &[&str] = &["collect", "eval", "sweep", "train"];
/// Arguments of a training run that `swm submit` adds itself.
const OF_RUNS: &[&str] = &["--resume", "--list", "--out", "-o"];
/// How a command to divide is named.
const EXAMPLE: &str = "-- collect swm/PushT-v1 --episodes 1000";

/// What is divided by a command.
pub(super) struct Work {
    /// None of training runs.
    pub(super) request: Option<Divided>,
    /// See [`Job::report_every`].
    pub(super) report_every: Option<u64>,
}

/// Whether this is a command that can be divided.
pub(super) fn is_divided(name: &str) -> bool {
    DIVIDED.contains(&name)
}

/// What a command line divides.
///
/// # Errors
///
/// It is none that can be divided, or has options by which its parts are told apart.
pub(super) fn work(registry: &Registry, line: &[String], output: &Output) -> Result<Work, Failure> {
    let name = line.first().map(String::as_str);
    match name {
        Some(name) if is_divided(name) => {}
        Some("swm") => {
            return Err(usage(format!("name the command to divide without `swm`, such as `{EXAMPLE}`")));
        }
        Some(other) => {
            return Err(usage(format!(
                "`swm {other}` cannot be divided; jobs are of collect, eval --manifest, sweep and train"
            )));
        }
        None => {
            return Err(usage(format!("name the command to divide, such as `{EXAMPLE}`")));
        }
    }
    if name == Some("train") {
        let mut given = line.iter().map(|word| word.split_once('=').map_or(word.as_str(), |(name, _)| name));
        if let Some(name) = given.find(|name| OF_RUNS.contains(name)) {
            return Err(usage(format!("leave out {name}: the job's folder is where runs go")));
        }
        // Each run's line is read as a whole.
        return Ok(Work { request: None, report_every: None });
    }
    let (request, report_every) = match parse(line)? {
        Command::Collect(command) => {
            (Divided::Record(Box::new(command.request(registry, output)?)), command.report_every())
        }
        Command::Eval(command) => (Divided::Evaluate(Box::new(command.request(registry, output)?)), None),
        Command::Sweep(command) => (Divided::Sweep(Box::new(command.request()?)), None),
        _ => return Err(usage("this command cannot be divided")),
    };
    request.check_undivided()?;
    Ok(Work { request: Some(request), report_every })
}

/// Opens the job in `dir`; `None` if there is none. Jobs of former versions are read from their command.
///
/// # Errors
///
/// As of [`JobFolder::open`].
pub(super) fn open(registry: &Registry, dir: &Path) -> Result<Option<JobFolder>, BoxError> {
    let silent = Output::new(false, true);
    JobFolder::open(dir, |line| Ok(work(registry, line, &silent).map_err(Failure::into_source)?.request))
}

/// The files that the runs of a training job read.
pub(super) fn inputs_of_runs(folder: &JobFolder) -> Result<Vec<PathBuf>, Failure> {
    let mut inputs = Vec::new();
    for shard in 1..=folder.job.shards {
        match parse(&run_line(folder, shard))? {
            Command::Train(train) => inputs.extend(train.inputs()?),
            _ => return Err(usage("this command cannot be divided")),
        }
    }
    Ok(inputs)
}

/// Runs a command line inside of this one.
pub(super) fn run(registry: &Registry, line: &[String], output: &Output) -> Result<(), Failure> {
    run_command(registry, parse(line)?, output)
}

fn parse(line: &[String]) -> Result<Command, Failure> {
    let words = std::iter::once("swm").map(OsString::from).chain(line.iter().map(OsString::from));
    // A recording that a job divides names no file.
    let cli = Cli::command()
        .mut_subcommand("collect", |collect| collect.mut_arg("out", |out| out.required(false)))
        .try_get_matches_from(words)
        .and_then(|matches| Cli::from_arg_matches(&matches));
    let cli =
        cli.map_err(|error| usage(error.to_string().trim_start_matches("error: ").trim_end().to_owned()))?;
    Ok(cli.command)
}

/// Runs a shard of a job, or the rest of it.
pub(super) fn run_shard(
    registry: &Registry,
    folder: &JobFolder,
    shard: u64,
    output: &Output,
) -> Result<(), Failure> {
    match part(folder, shard)? {
        Some(request) => run_request(registry, &folder.job, &request, output),
        None => run(registry, &run_line(folder, shard), output),
    }
}

/// The request of a shard; `None` of a training run.
pub(super) fn part(folder: &JobFolder, shard: u64) -> Result<Option<Divided>, Failure> {
    let Some(request) = &folder.job.request else { return Ok(None) };
    let out = match request {
        Divided::Record(_) => folder.written(shard),
        _ => folder.dir.clone(),
    };
    let shards = folder.job.shards;
    let part = Shard::new(shard, shards).ok_or_else(|| usage(format!("no shard {shard} of {shards}")))?;
    Ok(Some(request.part(part, out)))
}

/// Runs a request of a job as its command does.
fn run_request(registry: &Registry, job: &Job, request: &Divided, output: &Output) -> Result<(), Failure> {
    within(request.threads(), || match request {
        Divided::Record(record) => collect::run(record, job.report_every, registry, output),
        Divided::Evaluate(evaluate) => eval::run(evaluate, registry, output),
        Divided::Sweep(sweep) => sweep::run(sweep, registry, output),
        _ => Err(usage("this request cannot be divided")),
    })?
}

/// The command line of a training run of a job.
fn run_line(folder: &JobFolder, shard: u64) -> Vec<String> {
    let (job, run) = (&folder.job, folder.run(shard));
    let mut line = job.command.clone();
    line.extend(job.each.get(shard as usize - 1).into_iter().flatten().cloned());
    if run.join("config.json").is_file() {
        line = resumed(&line);
    }
    line.extend(["--out".to_owned(), run.display().to_string()]);
    line
}

/// The line that resumes a training run: its settings stand in its folder, but not what it is computed on.
fn resumed(line: &[String]) -> Vec<String> {
    let mut resumed = vec!["train".to_owned(), "--resume".to_owned()];
    for (at, word) in line.iter().enumerate() {
        if word == "--device" || word == "--threads" {
            resumed.extend(line[at..].iter().take(2).cloned());
        } else if word.starts_with("--device=") || word.starts_with("--threads=") {
            resumed.push(word.clone());
        }
    }
    resumed
}

/// Records a first part of about `episodes` episodes, whose size is that of the others; the path of its dataset.
pub(super) fn run_pilot(registry: &Registry, folder: &JobFolder, episodes: u64) -> Result<PathBuf, Failure> {
    let Some(Divided::Record(record)) = &folder.job.request else {
        return Err(usage("--pilot records episodes; it is for `swm collect`"));
    };
    let mut pilot = record.clone();
    pilot.out = folder.dir.join(format!("pilot.{}", extension(record)));
    pilot.mode = WriteMode::Overwrite;
    pilot.shard = Shard::new(1, (folder.job.episodes / episodes.max(1)).max(1));
    let out = pilot.out.clone();
    let _redirected = Redirected::to(&folder.dir.join("logs/pilot.log"))?;
    run_request(registry, &folder.job, &Divided::Record(pilot), &Output::new(false, false))?;
    Ok(out)
}

/// What shard `shard` writes: a file, or the file of a training run that tells how far it is.
pub(super) fn shard_output(folder: &JobFolder, shard: u64) -> PathBuf {
    let written = folder.written(shard);
    if folder.job.request.is_none() { written.join("metrics.jsonl") } else { written }
}

/// How far a shard is: committed episodes, or the size of a training run's metrics.
pub(super) fn held(registry: &Registry, folder: &JobFolder, shard: u64) -> u64 {
    let path = shard_output(folder, shard);
    match &folder.job.request {
        Some(Divided::Record(_)) if path.exists() => {
            swm_data::open_in(registry, &path).map_or(0, |dataset| dataset.num_episodes() as u64)
        }
        Some(Divided::Record(_)) => 0,
        // The first line is the head.
        Some(_) => read_text(&path).map_or(0, |text| text.lines().count().max(1) as u64 - 1),
        None => fs::metadata(&path).map_or(0, |metadata| metadata.len()),
    }
}

/// Checks that a shard holds what it should.
///
/// # Errors
///
/// Episodes are missing.
pub(super) fn check_shard(registry: &Registry, folder: &JobFolder, shard: u64) -> Result<(), Failure> {
    let range = folder.job.range(shard);
    let (found, expected) = (held(registry, folder, shard), range.end - range.start);
    if matches!(folder.job.request, Some(Divided::Record(_))) && found != expected {
        let path = shard_output(folder, shard);
        return Err(format!("{} holds {found} episodes, not {expected}", path.display()).into());
    }
    Ok(())
}

/// Joins the shards to the result. What was interrupted goes on.
pub(super) fn join(registry: &Registry, folder: &JobFolder, output: &Output) -> Result<(), Failure> {
    let job = &folder.job;
    let Some(request) = &job.request else { return Ok(()) };
    if let Some(join) = request.join(folder.dir.clone()) {
        return run_request(registry, job, &join, output);
    }
    let result = folder.dir.join(folder.result());
    let out = result.display().to_string();
    let all: Vec<PathBuf> = (1..=job.shards).map(|shard| shard_output(folder, shard)).collect();
    if let [one] = all.as_slice()
        && one.is_file()
    {
        fs::copy(one, &result).map_err(|error| cannot("write", &result, error))?;
    } else {
        let mut line = vec![if all.len() == 1 { "convert" } else { "merge" }.to_owned()];
        line.extend(all.iter().map(|part| part.display().to_string()));
        line.extend((all.len() > 1).then(|| "--out".to_owned()));
        line.push(out.clone());
        run(registry, &line, output)?;
    }
    run(registry, &["verify".to_owned(), out], output)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn only_some_commands_are_divided() {
        let of = |text: &str| work(&crate::registry(), &words(text), &Output::new(false, true));
        let found = of("collect swm/PushT-v1 --episodes 3 --report-every 60").ok().unwrap();
        assert!(matches!(found.request, Some(Divided::Record(_))));
        assert_eq!(found.report_every, Some(60));
        assert!(of("train lewm --dataset a.h5").ok().unwrap().request.is_none());
        for wrong in [
            "",
            "swm collect",
            "merge a b",
            "collect swm/PushT-v1 --episodes 3 --out a.h5",
            "collect swm/PushT-v1 --episodes 3 -oa.h5",
            "eval --again",
            "train x -o a",
        ] {
            assert_eq!(of(wrong).err().map(|failure| failure.exit_code()), Some(2), "{wrong}");
        }
    }

    #[test]
    fn a_resumed_training_keeps_its_device_and_threads() {
        assert_eq!(
            resumed(&words("train lewm --dataset a.h5 --device cuda:1 --threads 2 --epochs 3")),
            words("train --resume --device cuda:1 --threads 2")
        );
        let line = words("train lewm --device=cuda --threads=4");
        assert_eq!(resumed(&line), words("train --resume --device=cuda --threads=4"));
    }
}
