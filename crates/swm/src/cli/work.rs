//! The commands that a job can divide: their requests, those of a shard, and how the shards are joined.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{CommandFactory as _, FromArgMatches as _};
use swm_core::Registry;
use swm_data::WriteMode;
use swm_tasks::request::{Divided, Shard, TaskError, cannot};
use swm_tasks::threads::within;

use super::task::Redirected;
use super::{Cli, Command, Failure, Output, collect, convert, eval, sweep, train, usage, verify};
use crate::jobs::tracking::around;
use crate::jobs::{Asked, Job, JobError, JobFolder, Tracking, extension};

/// The commands that can be divided.
const DIVIDED: &[&str] = &["collect", "eval", "sweep", "train"];
/// How a command to divide is named.
const EXAMPLE: &str = "-- collect swm/PushT-v1 --episodes 1000";

/// Whether this is a command that can be divided.
pub(super) fn is_divided(name: &str) -> bool {
    DIVIDED.contains(&name)
}

/// What a command line divides; of trainings, what it asks for with each of several further arguments.
///
/// # Errors
///
/// It is none that can be divided, or has options by which its parts are told apart.
pub(super) fn work(
    registry: &Registry,
    line: &[String],
    each: &[Vec<String>],
    output: &Output,
) -> Result<Asked, Failure> {
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
    let (mut report_every, mut tracking) = (None, Vec::new());
    let request = match parse(line)? {
        Command::Collect(command) => {
            report_every = command.report_every();
            Divided::Record(Box::new(command.request(registry, output)?))
        }
        Command::Eval(command) => Divided::Evaluate(Box::new(command.request(registry, output)?)),
        Command::Sweep(command) => Divided::Sweep(Box::new(command.request()?)),
        Command::Train(_) => {
            let mut runs = Vec::new();
            let alone = [Vec::new()];
            for more in if each.is_empty() { &alone[..] } else { each } {
                let Command::Train(command) = parse(&[line, more.as_slice()].concat())? else { continue };
                if command.lists() {
                    return Err(usage("leave out --list: a job trains"));
                }
                tracking.push(command.track.tracking());
                runs.push(command.request()?);
            }
            Divided::Train(runs)
        }
        _ => return Err(usage("this command cannot be divided")),
    };
    request.check_undivided()?;
    Ok(Asked { request, report_every, tracking })
}

/// Opens the job in `dir`; `None` if there is none. Jobs of former versions are read from their command.
///
/// # Errors
///
/// As of [`JobFolder::open`].
pub(super) fn open(registry: &Registry, dir: &Path) -> Result<Option<JobFolder>, JobError> {
    let silent = Output::new(false, true);
    JobFolder::open(dir, |line, each| {
        work(registry, line, each, &silent).map_err(|failure| TaskError::from(failure.into_source()))
    })
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
    let request = folder.shard_request(shard)?;
    let work = || run_request(registry, &folder.job, &request, output);
    let nobody = Tracking::default();
    let tracking = folder.job.tracking.get(shard as usize - 1).unwrap_or(&nobody);
    around(tracking, &folder.written(shard), |note| output.note(note), work)
}

/// Runs a request of a job as its command does.
fn run_request(registry: &Registry, job: &Job, request: &Divided, output: &Output) -> Result<(), Failure> {
    within(request.threads(), || match request {
        Divided::Record(record) => collect::run(record, job.report_every, registry, output),
        Divided::Evaluate(evaluate) => eval::run(evaluate, registry, output),
        Divided::Sweep(sweep) => sweep::run(sweep, registry, output),
        Divided::Train(runs) => runs.iter().try_for_each(|run| train::run(run, registry, output)),
        _ => Err(usage("this request cannot be divided")),
    })?
}

/// Records a first part of about `episodes` episodes, whose size is that of the others; the path of its dataset.
pub(super) fn run_pilot(registry: &Registry, folder: &JobFolder, episodes: u64) -> Result<PathBuf, Failure> {
    let Divided::Record(record) = &folder.job.request else {
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

/// Joins the shards to the result. What was interrupted goes on.
pub(super) fn join(registry: &Registry, folder: &JobFolder, output: &Output) -> Result<(), Failure> {
    let (job, request) = (&folder.job, &folder.job.request);
    if request.is_of_runs() {
        return Ok(());
    }
    if let Some(join) = request.join(folder.dir.clone()) {
        return run_request(registry, job, &join, output);
    }
    let result = folder.dir.join(folder.result());
    let all: Vec<PathBuf> = (1..=job.shards).map(|shard| folder.shard_output(shard)).collect();
    match all.as_slice() {
        [one] if one.is_file() => {
            fs::copy(one, &result).map_err(cannot("write", &result))?;
        }
        _ => convert::join(all, result.clone(), registry, output)?,
    }
    verify::whole(result, registry, output)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn only_some_commands_are_divided() {
        let of = |text: &str| work(&crate::registry(), &words(text), &[], &Output::new(false, true));
        let found = of("collect swm/PushT-v1 --episodes 3 --report-every 60").ok().unwrap();
        assert!(matches!(found.request, Divided::Record(_)));
        assert_eq!(found.report_every, Some(60));
        for wrong in [
            "",
            "swm collect",
            "merge a b",
            "collect swm/PushT-v1 --episodes 3 --out a.h5",
            "collect swm/PushT-v1 --episodes 3 -oa.h5",
            "eval --again",
            "train x -o a",
            "train --list",
            "train --resume runs/a",
        ] {
            assert_eq!(of(wrong).err().map(|failure| failure.exit_code()), Some(2), "{wrong}");
        }
    }

    #[test]
    fn trainings_are_requests_with_the_arguments_of_each_line() {
        let line = words("train lewm --dataset a.h5 --track wandb");
        let of = |each: &[Vec<String>]| {
            let asked = work(&crate::registry(), &line, each, &Output::new(false, true)).ok().unwrap();
            serde_json::to_value((asked.request, asked.tracking)).unwrap()
        };
        let run = |seed: u64| json!({ "baseline": "lewm", "dataset": "a.h5", "seed": seed });
        let own = json!({ "trackers": ["wandb"], "project": null });
        let each = [words("--seed 1"), words("--seed 2 --track-project p")];
        let other = json!({ "trackers": ["wandb"], "project": "p" });
        assert_eq!(of(&each), json!([{ "train": [run(1), run(2)] }, [own, other]]));
        let alone = json!({ "baseline": "lewm", "dataset": "a.h5" });
        assert_eq!(of(&[]), json!([{ "train": [alone] }, [own]]));
    }
}
