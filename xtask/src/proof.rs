//! `cargo xtask proof`: does the whole work? Records TwoRoom, trains small baselines on the processor, plans and acts with
//! them on a manifest, and prints a table with floors and ceiling: the one of docs/proof.md.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context as _, Result};
use serde_json::Value as Json;

use crate::{process, setup};

/// Options of `cargo xtask proof`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only these baselines, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    only: Vec<String>,
    /// Where everything goes; what is there already is not made again
    #[arg(long, default_value = "proof", value_name = "DIR")]
    out: PathBuf,
    /// A command `swm` with baselines; else one is built
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
}

/// One baseline: how it is trained, and the policy that it becomes.
struct Trial {
    baseline: &'static str,
    data: &'static Data,
    train: &'static [&'static [&'static str]],
    policy: &'static str,
    settings: &'static str,
}

const TRIALS: &[Trial] = &[
    Trial {
        baseline: "pldm",
        data: &NOISY,
        train: &[WORLD, &["--steps", "700"]],
        policy: "mpc",
        settings: SEARCH,
    },
    Trial {
        baseline: "lewm",
        data: &NOISY,
        train: &[WORLD, &["--steps", "700"]],
        policy: "mpc",
        settings: SEARCH,
    },
    Trial {
        baseline: "gcbc",
        data: &CALM,
        train: &[POLICY, &["--steps", "900"]],
        policy: "gcbc",
        settings: "",
    },
    Trial {
        baseline: "gcivl",
        data: &CALM,
        train: &[POLICY, &["--steps", "900"]],
        policy: "gcivl",
        settings: "",
    },
    Trial {
        baseline: "gciql",
        data: &CALM,
        train: &[POLICY, &["--steps", "900"]],
        policy: "gciql",
        settings: "",
    },
];

/// A search that a processor does in a fraction of a second.
const SEARCH: &str = ",samples=100,iterations=8,elites=10";

/// Smaller than the preset, and faster: TwoRoom shows a dot and a wall.
const WORLD: &[&str] = &[
    "--set",
    "model.image=32",
    "--set",
    "model.encoder.channels=[16,32,48]",
    "--set",
    "model.width=48",
    "--set",
    "model.projector=192",
    "--set",
    "model.predictor.depth=2",
    "--set",
    "model.predictor.heads=4",
    "--set",
    "model.predictor.head_width=16",
    "--set",
    "model.predictor.hidden=128",
    "--set",
    "optim.lr=0.002",
];
const POLICY: &[&str] =
    &["--set", "model.image=32", "--set", "model.encoder.channels=[16,32,48]", "--set", "optim.lr=0.001"];

const ENV: &str = "swm/TwoRoom-v2";
/// Episodes to learn from.
struct Data {
    file: &'static str,
    collect: &'static [&'static str],
}

/// As the reference records it, and what pairs are drawn from.
const NOISY: Data = Data {
    file: "tworoom.h5",
    collect: &["--policy", "noisy-expert:2", "--episodes", "2000", "--seed", "1"],
};
/// What policies imitate: in the other, the noise hides what the expert wanted.
const CALM: Data = Data {
    file: "calm.h5",
    collect: &[
        "--policy",
        "noisy-expert:0.5",
        "--episodes",
        "1000",
        "--seed",
        "2",
        "--env-option",
        "render=fast",
    ],
};
const COLLECT: &[&str] = &["--image-size", "64x64", "--without", "goal"];
const MANIFEST: &[&str] = &[
    "--tier",
    "historic",
    "--episodes",
    "100",
    "--goal-offset",
    "25",
    "--budget",
    "50",
    "--image-size",
    "64x64",
];

/// The whole proof.
pub(crate) fn run(args: &Args) -> Result<()> {
    if args.swm.is_none() {
        setup::for_demo()?;
        process::run(process::cargo(["build"]).args(BUILD))?;
    }
    let swm = |words: &[&str], paths: &[(&str, &Path)]| swm(args.swm.as_deref(), words, paths);
    let out = std::path::absolute(&args.out)?;
    fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let manifest = out.join("historic.toml");
    for data in [&NOISY, &CALM] {
        let file = out.join(data.file);
        if !file.exists() {
            swm(&[&["collect", ENV], COLLECT, data.collect].concat(), &[("--out", &file)])?;
        }
    }
    if !manifest.exists() {
        swm(
            &[&["manifest", "make", ENV], MANIFEST].concat(),
            &[("--dataset", &out.join(NOISY.file)), ("--out", &manifest)],
        )?;
    }
    let mut table = String::from("| policy | success | 95 % interval | training |\n|---|---|---|---|\n");
    let mut beside = "all";
    let chosen = |trial: &&Trial| args.only.is_empty() || args.only.iter().any(|name| name == trial.baseline);
    for trial in TRIALS.iter().filter(chosen) {
        let run = out.join(trial.baseline);
        let started = Instant::now();
        if run.join("config.json").exists() {
            swm(&["train", "--resume"], &[("--out", &run)])?;
        } else {
            let call = [&["train", trial.baseline, "--preset", "small"][..], &trial.train.concat()].concat();
            swm(&call, &[("--data", &out.join(trial.data.file)), ("--out", &run)])?;
        }
        let minutes = started.elapsed().as_secs_f64() / 60.0;
        let policy = format!("{}:{}{}", trial.policy, run.display(), trial.settings);
        let result = out.join(format!("{}-result", trial.baseline));
        let call = ["eval", "--policy", &policy, "--beside", beside];
        let receipt = swm(&call, &[("--manifest", &manifest), ("--out", &result)])?;
        line(&mut table, trial.baseline, &receipt["summary"], &format!("{minutes:.1} min"));
        for other in receipt["beside"].as_array().into_iter().flatten() {
            line(&mut table, other["role"].as_str().unwrap_or_default(), &other["summary"], "–");
        }
        // Floors and ceiling are the same for all.
        beside = "none";
    }
    println!("\n{table}");
    fs::write(out.join("results.md"), &table)?;
    Ok(())
}

/// The command `swm`, with baselines and without what TwoRoom does not need.
const BUILD: &[&str] = &[
    "--package",
    "swm",
    "--bin",
    "swm",
    "--release",
    "--no-default-features",
    "--features",
    "cli,faer,baselines",
];

/// Runs the command `swm`, that which is given or was built, and returns what it says as JSON.
fn swm(given: Option<&Path>, args: &[&str], paths: &[(&str, &Path)]) -> Result<Json> {
    let mut command = match given {
        Some(file) => Command::new(file),
        None => {
            let mut command = process::cargo(["run", "--quiet"]);
            command.args(BUILD).arg("--");
            command
        }
    };
    command.args(args);
    for (option, path) in paths {
        command.arg(option).arg(path);
    }
    eprintln!("swm {}", args.join(" "));
    let printed = process::output(command.arg("--json"))?;
    serde_json::from_slice(&printed).with_context(|| format!("`swm {}` printed no JSON", args.join(" ")))
}

fn line(table: &mut String, name: &str, summary: &Json, training: &str) {
    let number = |pointer: &str| summary.pointer(pointer).and_then(Json::as_f64).unwrap_or(f64::NAN);
    let _ = writeln!(
        table,
        "| {name} | {:.1} % | {:.1} to {:.1} % | {training} |",
        number("/success_rate"),
        number("/ci95/0"),
        number("/ci95/1"),
    );
}
