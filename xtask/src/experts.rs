//! `cargo xtask experts`: trains the agents behind the policy `learned-expert` of the control suite, evaluates them, and writes their policies' weights to crates/swm-envs-mujoco/src/suite/learned.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use safetensors::SafeTensors;
use serde_json::Value as Json;

use crate::process;
use crate::program::Program;

/// Options of `cargo xtask experts`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only these, such as `cheetah,reacher`
    #[arg(value_delimiter = ',', value_name = "NAMES")]
    only: Vec<String>,
    /// Where the runs are; what is there already is not trained again
    #[arg(long, default_value = "experts", value_name = "DIR")]
    out: PathBuf,
    /// A command `swm` with baselines and MuJoCo; else one is built
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
}

/// How one is trained; the best checkpoint by mean return is taken.
struct Expert {
    /// The file's name, and that of the run.
    name: &'static str,
    env: &'static str,
    steps: &'static str,
    /// Settings of the environment, for training and figures.
    task: &'static [&'static str],
    /// Further options of `swm train`.
    train: &'static [&'static str],
}

/// Half the batch of the preset takes half the time, and learns as much per step.
const HALF: &[&str] = &["--set", "batch=128"];

/// A target is one of an episode's few facts: short episodes show more of them, and many evaluations tell whether all are reached.
const MANY_GOALS: &[&str] = &["--set", "collect.max_episode_steps=100", "--eval-episodes", "20"];

/// The reward is sparse: it is found from starts near the top.
const MANY_STARTS: &[&str] =
    &["--set", "batch=128", "--set", "collect.max_episode_steps=100", "--eval-episodes", "10"];

const EXPERTS: &[Expert] = &[
    Expert { name: "ball_in_cup", env: "swm/BallInCupDMControl-v0", steps: "40000", task: &[], train: HALF },
    // The sparse reward of the default task is rarely met by chance.
    Expert { name: "cartpole", env: "swm/CartpoleDMControl-v0", steps: "60000", task: SWINGUP, train: &[] },
    Expert { name: "cheetah", env: "swm/CheetahDMControl-v0", steps: "100000", task: &[], train: &[] },
    Expert {
        name: "pendulum",
        env: "swm/PendulumDMControl-v0",
        steps: "80000",
        task: &[],
        train: MANY_STARTS,
    },
    Expert { name: "reacher", env: "swm/ReacherDMControl-v0", steps: "60000", task: &[], train: MANY_GOALS },
    Expert { name: "walker", env: "swm/WalkerDMControl-v0", steps: "60000", task: &[], train: HALF },
];
const SWINGUP: &[&str] = &["--env-option", "task=swingup"];

/// Tensors that acting needs.
const ACTING: [&str; 8] = [
    "actor.latent_pi.0.bias",
    "actor.latent_pi.0.weight",
    "actor.latent_pi.2.bias",
    "actor.latent_pi.2.weight",
    "actor.mu.bias",
    "actor.mu.weight",
    "observation.running_mean",
    "observation.running_var",
];
/// Episodes of the figures, from seeds that training did not evaluate on.
const EPISODES: [&str; 4] = ["--episodes", "20", "--seed", "7000"];

pub(crate) fn run(args: &Args) -> Result<()> {
    for name in &args.only {
        let known: Vec<_> = EXPERTS.iter().map(|expert| expert.name).collect();
        ensure!(known.contains(&name.as_str()), "`{name}`: there are {}", known.join(", "));
    }
    let program = Program { given: args.swm.as_deref(), features: "cli,faer,baselines,mujoco" };
    program.build()?;
    let out = std::path::absolute(&args.out)?;
    let folder = process::root().join("crates/swm-envs-mujoco/src/suite/learned");
    fs::create_dir_all(&folder)?;
    let mut table = "| agent | steps | mean return | lowest | highest |\n|---|---|---|---|---|\n".to_owned();
    for expert in EXPERTS.iter().filter(|e| args.only.is_empty() || args.only.iter().any(|n| n == e.name)) {
        let run = out.join(expert.name);
        let (command, step) = expert.train(&program, &run)?;
        let weights = run.join("checkpoints").join(format!("step-{step:08}.safetensors"));
        let policy = format!("sac:{},checkpoint=best", run.display());
        let words = ["eval", expert.env, "--policy", &policy, "--budget", "500", "--image-size", "none"];
        let evaluated = program.run(&[&words[..], expert.task, &EPISODES].concat(), &[])?;
        table += &expert.line(step, &evaluated);
        write(&weights, &folder.join(format!("{}.safetensors", expert.name)), &command, step)?;
    }
    println!("{table}");
    Ok(())
}

impl Expert {
    /// The command that trains it, and the step of its best checkpoint.
    fn train(&self, program: &Program<'_>, run: &Path) -> Result<(String, u64)> {
        let words =
            ["train", "sac", "--env", self.env, "--preset", "small", "--steps", self.steps, "--seed", "1"];
        let words = [&words[..], self.task, self.train].concat();
        match run.join("config.json").exists() {
            true => program.run(&["train", "--resume"], &[("--out", run)])?,
            false => program.run(&words, &[("--out", run)])?,
        };
        let checkpoints = program.run(&["checkpoints", &run.display().to_string()], &[])?;
        let best = best(&checkpoints).context("the run has no checkpoint with a return")?;
        Ok((format!("swm {}", words.join(" ")), best))
    }

    fn line(&self, step: u64, evaluated: &Json) -> String {
        let returns = evaluated["episode_returns"].as_array().into_iter().flatten().filter_map(Json::as_f64);
        let returns: Vec<f64> = returns.collect();
        let mean = returns.iter().sum::<f64>() / returns.len() as f64;
        let (low, high) = (
            returns.iter().copied().fold(f64::INFINITY, f64::min),
            returns.iter().copied().fold(0.0, f64::max),
        );
        format!("| {} | {step} | {mean:.0} | {low:.0} | {high:.0} |\n", self.name)
    }
}

/// The step of the greatest mean return, of what `swm checkpoints --json` says.
fn best(checkpoints: &Json) -> Option<u64> {
    let mean = |checkpoint: &Json| {
        let figures = checkpoint["state"]["evaluation"].as_array()?;
        figures.iter().find(|figure| figure[0] == "return")?[1].as_f64()
    };
    let all = checkpoints["checkpoints"].as_array()?.iter();
    let (_, best) =
        all.filter_map(|c| Some((mean(c)?, c["step"].as_u64()?))).max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(best)
}

/// Writes what acting needs of the weights `from`, and how they came about.
fn write(from: &Path, to: &Path, command: &str, step: u64) -> Result<()> {
    let bytes = fs::read(from).with_context(|| format!("cannot read {}", from.display()))?;
    let file = SafeTensors::deserialize(&bytes).with_context(|| format!("{} is damaged", from.display()))?;
    let tensors = ACTING.iter().map(|name| Ok((*name, file.tensor(name)?))).collect::<Result<Vec<_>>>()?;
    let about =
        HashMap::from([("command".to_owned(), command.to_owned()), ("step".to_owned(), step.to_string())]);
    safetensors::serialize_to_file(tensors, Some(about), to)
        .with_context(|| format!("cannot write {}", to.display()))
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_checkpoint_of_the_greatest_return_is_the_best() {
        let one = |step: u64, mean: f64| serde_json::json!({ "step": step, "state": { "evaluation": [["return_min", 900.0], ["return", mean]] } });
        let all = serde_json::json!({ "checkpoints": [one(5, 10.0), one(10, 30.0), one(15, 20.0)] });
        assert_eq!(super::best(&all), Some(10));
        assert_eq!(super::best(&serde_json::json!({ "checkpoints": [] })), None);
    }
}
