//! `cargo xtask proof`: does the whole work? Records TwoRoom and PushT, trains small baselines on the CPU, plans and acts
//! with them on manifests, and prints tables with reference policies: those of docs/proof.md.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use serde_json::Value as Json;

use crate::program::Program;

/// Options of `cargo xtask proof`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only these tasks or baselines, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    only: Vec<String>,
    /// Where everything goes; what is there already is not made again
    #[arg(long, default_value = "proof", value_name = "DIR")]
    out: PathBuf,
    /// A command `swm` with baselines; else one is built
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
}

/// An environment to learn in.
struct Task {
    name: &'static str,
    env: &'static str,
    /// Size of images. Models of smaller ones resize them.
    images: &'static str,
    /// What is recorded: a file, and how.
    data: &'static [(&'static str, &'static [&'static str])],
    /// Which of the files pairs are sampled from.
    pairs: &'static str,
    /// How world models plan.
    search: &'static str,
    trials: &'static [Trial],
}

/// One baseline: what it learns from, for how many steps, and with which options of `swm train`.
struct Trial {
    baseline: &'static str,
    data: &'static str,
    steps: &'static str,
    train: &'static [&'static str],
}

const fn trial(baseline: &'static str, data: &'static str, steps: &'static str) -> Trial {
    Trial { baseline, data, steps, train: &[] }
}

const TASKS: &[Task] = &[
    Task {
        name: "tworoom",
        env: "swm/TwoRoom-v2",
        images: "64x64",
        pairs: "noisy.h5",
        data: &[
            // As the reference records it.
            ("noisy.h5", &["--policy", "noisy-expert:2", "--episodes", "2000", "--seed", "1"]),
            // What policies imitate: in the other, the noise hides what the expert wanted.
            ("calm.h5", &["--policy", "noisy-expert:0.5", "--episodes", "1000", "--seed", "2"]),
        ],
        search: SEARCH,
        trials: &[
            trial("lewm", "noisy.h5", "500"),
            trial("pldm", "noisy.h5", "500"),
            trial("gcbc", "calm.h5", "600"),
            trial("gcivl", "calm.h5", "600"),
            trial("gciql", "calm.h5", "600"),
            trial("hilp", "calm.h5", "300"),
        ],
    },
    Task {
        name: "pusht",
        env: "swm/PushT-v1",
        images: "96x96",
        // Of episodes that nothing learns from.
        pairs: "pairs.h5",
        data: &[
            ("weak.h5", &["--policy", "weak", "--episodes", "3000", "--max-steps", "100", "--seed", "101"]),
            ("pairs.h5", &["--policy", "weak", "--episodes", "200", "--max-steps", "100", "--seed", "103"]),
        ],
        search: REPLANNED,
        trials: &[
            trial("lewm", "weak.h5", "3000"),
            trial("pldm", "weak.h5", "3000"),
            Trial { baseline: "conv-jepa", data: "weak.h5", steps: "2000", train: PLACES },
            Trial { baseline: "gcsl", data: "weak.h5", steps: "1500", train: DRAWN },
            trial(KEYPOINT_WM, "weak.h5", "4000"),
            Trial { baseline: "gcbc", data: "weak.h5", steps: "1500", train: NEAR },
            Trial { baseline: "gciql", data: "weak.h5", steps: "1000", train: NEAR_TOO },
        ],
    },
    // Data and goals of an expert whose steps are as short as those of the people whose episodes the published models learn
    // from: the standard deviation of its actions is 0.21, theirs 0.20.
    Task {
        name: "pusht-slow",
        env: "swm/PushT-v1",
        images: "96x96",
        pairs: "pairs.h5",
        data: &[
            ("slow.h5", &["--policy", SLOW, "--episodes", "2000", "--max-steps", "300", "--seed", "102"]),
            ("pairs.h5", &["--policy", SLOW, "--episodes", "200", "--max-steps", "300", "--seed", "103"]),
        ],
        search: REPLANNED,
        trials: &[
            trial("lewm", "slow.h5", "3000"),
            trial("pldm", "slow.h5", "3000"),
            Trial { baseline: "conv-jepa", data: "slow.h5", steps: "2000", train: PLACES },
            Trial { baseline: "gcsl", data: "slow.h5", steps: "5200", train: DRAWN },
            trial(KEYPOINT_WM, "slow.h5", "4000"),
            Trial { baseline: "gcbc", data: "slow.h5", steps: "1500", train: NEAR },
            Trial { baseline: "gciql", data: "slow.h5", steps: "1000", train: NEAR_TOO },
        ],
    },
];

impl Task {
    /// Whether `--only` with this name means a trial of it, or one that it needs.
    fn is_named(&self, trial: &Trial, name: &str) -> bool {
        name == self.name || name == trial.baseline || (name == KEYPOINT_WM && trial.baseline == "gcsl")
    }

    /// The policy that a trained baseline becomes.
    fn policy(&self, baseline: &str, run: &Path) -> String {
        let run = run.display();
        match baseline {
            "lewm" | "pldm" | "conv-jepa" => format!("mpc:{run}{}", self.search),
            KEYPOINT_WM => format!("mpc:{run}{SINGLE_ACTIONS}"),
            acts => format!("{acts}:{run}"),
        }
    }
}

/// An expert that corrects itself often and whose noise shows a model what other actions do.
const SLOW: &str =
    "noisy-expert:0.15,max_step=8,replan=15,samples=40,refinements=1,beams=2,detours=2,beam_samples=10";
/// Latents that say where things are, from which images are drawn and actions told: what a goal is about.
const PLACES: &[&str] = &[
    "--batch",
    "24",
    "--set",
    "model.encoder.kind=keypoints",
    "--set",
    "model.image=64",
    "--set",
    "model.predictor.channels=256",
    "--set",
    "rollout_steps=5",
    "--set",
    "weights.drawing=1",
    "--set",
    "weights.inverse=1",
    "--set",
    "sigreg.weight=0",
    "--set",
    "optim.ema=0.999",
];
/// Goals as far ahead as those of the pairs, and frames that are seen as what sets them apart from the goal.
const NEAR: &[&str] = &["--set", "model.goal_gamma=0.8", "--set", "model.predictor.compare=true"];
/// Places that see the block, whatever the seed.
const DRAWN: &[&str] = &["--set", "weights.drawing=1"];
/// Near goals of a policy that is extracted from a value, and an encoder that says where things are.
const NEAR_TOO: &[&str] = &[
    "--set",
    "model.goal_gamma=0.8",
    "--set",
    "value.policy_goals=geometric",
    "--set",
    "model.encoder.kind=keypoints",
    "--set",
    "optim.ema=0.999",
];
/// A search that a CPU does in a fraction of a second.
const SEARCH: &str = ",samples=100,iterations=8,elites=10";
/// The same, of which 10 actions are executed before it is planned anew for the rest.
const REPLANNED: &str = ",samples=100,iterations=8,elites=10,receding_horizon=2,shrinking_horizon=true";
/// The same for plans of single actions, of which there are many: within the bounds, and never narrower than a tenth of the std
/// of the data's actions.
const SINGLE_ACTIONS: &str =
    ",samples=100,iterations=8,elites=10,sigma=2,sigma_min=0.1,clip=true,return_best=true";
/// A world model over what the encoder of `gcsl` sees: its run comes before.
const KEYPOINT_WM: &str = "keypoint-wm";
const HISTORIC: &[&str] =
    &["--tier", "historic", "--episodes", "100", "--goal-offset", "25", "--budget", "50"];

/// The whole proof.
pub(crate) fn run(args: &Args) -> Result<()> {
    for name in &args.only {
        let known = |task: &Task| task.trials.iter().any(|trial| task.is_named(trial, name));
        ensure!(
            TASKS.iter().any(known),
            "--only {name}: name tasks (tworoom, pusht, pusht-slow) or baselines"
        );
    }
    let program = Program { given: args.swm.as_deref(), features: "cli,faer,baselines" };
    program.build()?;
    let out = std::path::absolute(&args.out)?;
    let mut page = String::new();
    for task in TASKS {
        let is_chosen =
            |trial: &&Trial| args.only.is_empty() || args.only.iter().any(|name| task.is_named(trial, name));
        let trials: Vec<&Trial> = task.trials.iter().filter(is_chosen).collect();
        if !trials.is_empty() {
            page += &table(task, &trials, &out.join(task.name), &program)?;
        }
    }
    println!("\n{page}");
    fs::write(out.join("results.md"), &page)?;
    Ok(())
}

/// Records, trains and evaluates in folder `out`; what is there already is not made again.
fn table(task: &Task, trials: &[&Trial], out: &Path, program: &Program<'_>) -> Result<String> {
    let swm = |words: &[&str], paths: &[(&str, &Path)]| program.run(words, paths);
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let images = ["--image-size", task.images, "--env-option", "render=fast"];
    for (file, how) in task.data {
        let file = out.join(file);
        if !file.exists() {
            let words = [&["collect", task.env, "--without", "goal"], &images[..], how].concat();
            swm(&words, &[("--out", &file)])?;
        }
    }
    let manifest = out.join("historic.toml");
    if !manifest.exists() {
        let words = [&["manifest", "make", task.env], HISTORIC, &images].concat();
        swm(&words, &[("--dataset", &out.join(task.pairs)), ("--out", &manifest)])?;
    }
    let mut table =
        format!("\n{}\n\n| policy | success | 95 % interval | training |\n|---|---|---|---|\n", task.env);
    let mut references = "all";
    for trial in trials {
        let run = out.join(trial.baseline);
        let started = Instant::now();
        if run.join("config.json").exists() {
            swm(&["train", "--resume"], &[("--out", &run)])?;
        } else {
            let words = ["train", trial.baseline, "--preset", "small", "--steps", trial.steps];
            let (data, encoder) = (out.join(trial.data), out.join("gcsl"));
            let mut paths = vec![("--dataset", data.as_path()), ("--out", &run)];
            paths.extend((trial.baseline == KEYPOINT_WM).then_some(("--encoder", encoder.as_path())));
            swm(&[&words[..], trial.train].concat(), &paths)?;
        }
        let minutes = started.elapsed().as_secs_f64() / 60.0;
        let policy = task.policy(trial.baseline, &run);
        let result = out.join(format!("{}-result", trial.baseline));
        let words = ["eval", "--policy", &policy, "--reference", references, "--again"];
        let receipt = swm(&words, &[("--manifest", &manifest), ("--out", &result)])?;
        line(&mut table, trial.baseline, &receipt["summary"], &format!("{minutes:.1} min"));
        for other in receipt["references"].as_array().into_iter().flatten() {
            line(&mut table, other["role"].as_str().unwrap_or_default(), &other["summary"], "–");
        }
        // The reference policies are the same for all.
        references = "none";
    }
    Ok(table)
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
