//! The commands that a job can divide: what they need, the arguments of a shard, and how the shards are joined.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{CommandFactory as _, FromArgMatches as _};
use swm_core::Registry;

use super::{Cli, Command, Failure, Output, run_command, usage};
use crate::jobs::JobFolder;
use crate::jobs::files::{cannot, extension};
use crate::text_file::read_text;

/// What a command needs, found out before anything is queued.
pub(super) struct Plan {
    /// Episodes of all shards; 0 for training runs.
    pub(super) episodes: u64,
    /// Files and folders that are read.
    pub(super) inputs: Vec<PathBuf>,
}

/// The commands that can be divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Collect,
    Eval,
    Sweep,
    Train,
}

/// Arguments that `swm submit` adds itself.
const OWN: &[(Kind, &[&str])] = &[
    (Kind::Collect, &["--shard", "--mode", "--mix", "--out", "-o"]),
    (Kind::Eval, &["--shard", "--join", "--again", "--out", "-o"]),
    (Kind::Sweep, &["--shard", "--join", "--again", "--out", "-o"]),
    (Kind::Train, &["--resume", "--list", "--out", "-o"]),
];
/// How a command to divide is named.
const EXAMPLE: &str = "-- collect swm/PushT-v1 --episodes 1000";
/// A format that writes a file per image is refused above so many.
const MAX_IMAGE_FILES: u64 = 1_000_000;

impl Kind {
    /// What `command` is.
    pub(super) fn of(command: &[String]) -> Result<Self, Failure> {
        let kind = match command.first().map(String::as_str) {
            Some("collect") => Self::Collect,
            Some("eval") => Self::Eval,
            Some("sweep") => Self::Sweep,
            Some("train") => Self::Train,
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
        };
        let own = OWN.iter().find(|(of, _)| *of == kind).map_or(&[][..], |(_, own)| own);
        for word in &command[1..] {
            let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
            if own.contains(&name) {
                return Err(usage(format!(
                    "leave out {name}: the job's folder says where results go, and each task which shard it is"
                )));
            }
        }
        Ok(kind)
    }

    /// The result, in the folder of the job.
    pub(super) fn result(self, command: &[String]) -> String {
        match self {
            Self::Collect => format!("result.{}", extension(command)),
            Self::Eval => "receipt.json".to_owned(),
            Self::Sweep => "sweep.json".to_owned(),
            Self::Train => "runs".to_owned(),
        }
    }
}

/// Parses a command line and finds out what it needs: environment and policy are made, manifests read.
pub(super) fn plan(registry: &Registry, line: &[String], output: &Output) -> Result<Plan, Failure> {
    match parse(line)? {
        Command::Collect(collect) => {
            let (plan, steps) = collect.plan(registry, output)?;
            if extension(line) == "folder" && steps > MAX_IMAGE_FILES {
                return Err(usage(format!(
                    "--format folder: up to {steps} image files are too many for a shared file system; leave --format out"
                )));
            }
            Ok(plan)
        }
        Command::Eval(eval) => eval.plan(registry, output),
        Command::Sweep(sweep) => sweep.plan(registry),
        Command::Train(train) => train.plan(),
        _ => Err(usage("this command cannot be divided")),
    }
}

/// Runs a command line inside of this one.
pub(super) fn run(registry: &Registry, line: &[String], output: &Output) -> Result<(), Failure> {
    run_command(registry, parse(line)?, output)
}

fn parse(line: &[String]) -> Result<Command, Failure> {
    let words = std::iter::once("swm").map(OsString::from).chain(line.iter().map(OsString::from));
    let cli = Cli::command().try_get_matches_from(words).and_then(|matches| Cli::from_arg_matches(&matches));
    let cli =
        cli.map_err(|error| usage(error.to_string().trim_start_matches("error: ").trim_end().to_owned()))?;
    Ok(cli.command)
}

/// The command line of a shard.
pub(super) fn shard_line(folder: &JobFolder, kind: Kind, shard: u64) -> Vec<String> {
    let job = &folder.job;
    let of = format!("{shard}/{}", job.shards);
    let out = |path: &Path| path.display().to_string();
    let mut line = job.command.clone();
    match kind {
        Kind::Collect => {
            let part = out(&folder.written(shard));
            line.extend(["--shard", &of, "--mode", "append", "--out", &part].map(str::to_owned));
        }
        Kind::Eval | Kind::Sweep => {
            line.extend(["--shard", &of, "--out", &out(&folder.dir)].map(str::to_owned));
        }
        Kind::Train => {
            let run = folder.run(shard);
            line.extend(job.each.get(shard as usize - 1).into_iter().flatten().cloned());
            if run.join("config.json").is_file() {
                line = resumed(&line);
            }
            line.extend(["--out".to_owned(), out(&run)]);
        }
    }
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

/// The command line of a first part of about `episodes` episodes, which tells how large an episode is.
pub(super) fn pilot_line(folder: &JobFolder, episodes: u64) -> (Vec<String>, PathBuf) {
    let part = folder.dir.join(format!("pilot.{}", extension(&folder.job.command)));
    let of = format!("1/{}", (folder.job.episodes / episodes.max(1)).max(1));
    let mut line = folder.job.command.clone();
    let out = part.display().to_string();
    line.extend(["--shard", &of, "--mode", "overwrite", "--out", &out].map(str::to_owned));
    (line, part)
}

/// What shard `shard` writes: a file, or the file of a training run that tells how far it is.
pub(super) fn shard_output(folder: &JobFolder, kind: Kind, shard: u64) -> PathBuf {
    let written = folder.written(shard);
    if kind == Kind::Train { written.join("metrics.jsonl") } else { written }
}

/// How far a shard is: committed episodes, or the size of a training run's metrics.
pub(super) fn held(registry: &Registry, folder: &JobFolder, kind: Kind, shard: u64) -> u64 {
    let path = shard_output(folder, kind, shard);
    match kind {
        Kind::Collect if path.exists() => {
            swm_data::open_in(registry, &path).map_or(0, |dataset| dataset.num_episodes() as u64)
        }
        Kind::Collect => 0,
        // The first line is the head.
        Kind::Eval | Kind::Sweep => read_text(&path).map_or(0, |text| text.lines().count().max(1) as u64 - 1),
        Kind::Train => fs::metadata(&path).map_or(0, |metadata| metadata.len()),
    }
}

/// Checks that a shard holds what it should.
///
/// # Errors
///
/// Episodes are missing.
pub(super) fn check_shard(
    registry: &Registry,
    folder: &JobFolder,
    kind: Kind,
    shard: u64,
) -> Result<(), Failure> {
    let range = folder.job.range(shard);
    let (found, expected) = (held(registry, folder, kind, shard), range.end - range.start);
    if kind == Kind::Collect && found != expected {
        let path = shard_output(folder, kind, shard);
        return Err(format!("{} holds {found} episodes, not {expected}", path.display()).into());
    }
    Ok(())
}

/// Joins the shards to the result. What was interrupted goes on.
pub(super) fn join(
    registry: &Registry,
    folder: &JobFolder,
    kind: Kind,
    output: &Output,
) -> Result<(), Failure> {
    let job = &folder.job;
    let result = folder.dir.join(kind.result(&job.command));
    let out = result.display().to_string();
    match kind {
        Kind::Collect => {
            let all: Vec<PathBuf> = (1..=job.shards).map(|shard| shard_output(folder, kind, shard)).collect();
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
        Kind::Eval | Kind::Sweep => {
            let mut line = job.command.clone();
            line.extend(["--join", "--out", &folder.dir.display().to_string()].map(str::to_owned));
            run(registry, &line, output)
        }
        Kind::Train => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn only_some_commands_are_divided() {
        assert_eq!(Kind::of(&words("collect swm/PushT-v1 --episodes 3")).ok(), Some(Kind::Collect));
        for wrong in
            ["", "merge a b", "collect E --out a.h5", "collect E --out=a.h5", "eval --again", "train x -o a"]
        {
            assert_eq!(Kind::of(&words(wrong)).err().map(|failure| failure.exit_code()), Some(2), "{wrong}");
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
