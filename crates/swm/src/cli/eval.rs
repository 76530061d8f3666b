//! `swm eval`: the success rate of a policy.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use swm_core::{Cancel, Evaluation, Registry};
use swm_tasks::request::{Evaluate, Evaluated, ImageChoice, ManifestSource, Request as _};

use super::args::{ImageArg, OptionalEnvArgs, PartArgs, WorldArgs, part_done};
use super::opening::DataArgs;
use super::output::key_values;
use super::receipt_text::receipt_text;
use super::reporter::Reporter;
use super::scenario::ScenarioArgs;
use super::{Failure, Output, interrupt};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<Evaluate> = LazyLock::new(Evaluate::default);

/// Evaluate a policy: online, from starts and goals of a dataset, or on a manifest.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm eval swm/PushT-v1 --policy expert --episodes 100 --seed 42
  swm eval swm/PushT-v1 --policy cem:samples=300,iterations=30,elites=30 --dataset pusht.h5 --goal-offset 25 --budget 50 --out results
  swm eval swm/PushT-v1 --policy expert --episodes 50 --vary all --json
  swm eval --manifest pusht-strict.toml --policy cem --out results
  swm eval --manifest pusht-strict.toml --policy cem --out results --shard 3/64    (one of 64 parts; then --join in place of it)

With --manifest, the task is that of the manifest, reference policies are evaluated on the same pairs (--reference), --out gets \
receipt.json, and an interrupted evaluation continues where it stopped. Without --manifest, --out gets result.json, a contact sheet \
(episodes.png) and videos (--videos). If --out holds a result, the same evaluation is skipped and another one is an error; \
--again overwrites it.")]
pub(super) struct Eval {
    #[command(flatten)]
    env: OptionalEnvArgs,
    /// Evaluate on this manifest; `swm manifest make` makes one.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["env", "env_options", "episodes", "seed", "dataset", "goal_offset", "budget", "frame_skip", "vary", "set", "videos", "video_format", "image_size"])]
    manifest: Option<PathBuf>,
    /// With --manifest: seed of the policy's noise, for repetitions on the same pairs. 0: noise is seeded by the pairs.
    #[arg(long, default_value_t = DEFAULT.policy_seed, requires = "manifest", value_name = "SEED")]
    policy_seed: u64,
    /// With --manifest: reference policies to evaluate on the same pairs, separated by commas.
    #[arg(long, value_parser = references(), default_value = "all", requires = "manifest", value_delimiter = ',')]
    reference: Vec<String>,
    /// With --manifest: the planner to use as the oracle. Default: the policy's own planner on the true dynamics, or `cem`.
    #[arg(long, requires = "manifest", value_name = "POLICY")]
    oracle: Option<String>,
    /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE; `swm envs ENV` lists them.
    #[arg(long)]
    policy: String,
    /// Episodes to evaluate.
    #[arg(long, default_value_t = DEFAULT.episodes)]
    episodes: u64,
    /// Seed of starts, goals and policy.
    #[arg(long, default_value_t = DEFAULT.seed)]
    seed: u64,
    /// Take starts and goals from this dataset.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// With --dataset: the goal is this many steps after the start.
    #[arg(long, default_value_t = DEFAULT.goal_offset, requires = "dataset")]
    goal_offset: usize,
    /// Actions allowed per episode. Default: 200, or 50 with --dataset.
    #[arg(long)]
    budget: Option<u64>,
    #[command(flatten)]
    world: WorldArgs,
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    opening: DataArgs,
    /// A folder for the result: receipt.json with --manifest, else result.json, images and videos.
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// With --out: run again what the folder holds already, and replace it.
    #[arg(long, requires = "out")]
    again: bool,
    #[command(flatten)]
    part: PartArgs,
    /// With --out: episodes to record as videos.
    #[arg(long, default_value_t = DEFAULT.videos)]
    videos: u64,
    /// With --out: kind of video. Default: mp4 where this build can make it.
    #[arg(long, value_parser = ["mp4", "gif"])]
    video_format: Option<String>,
    /// Image size. Default: that of the policy's model; else 128x128 with --out, or none.
    #[arg(long)]
    image_size: Option<ImageArg>,
}

/// The reference policies by name.
fn references() -> PossibleValuesParser {
    [
        PossibleValue::new("random").help("Actions sampled uniformly"),
        PossibleValue::new("no-op").help("Zeros").aliases(["no_op", "noop", "nop"]),
        PossibleValue::new("oracle").help("The same planner on the true dynamics"),
        PossibleValue::new("all").help("All of them"),
        PossibleValue::new("none").help("None of them"),
    ]
    .into()
}

impl Eval {
    /// What is asked for.
    pub(super) fn request(&self, registry: &Registry, output: &Output) -> Result<Evaluate, Failure> {
        let (env, env_option) = self.env.named(registry)?;
        Ok(Evaluate {
            env,
            env_option,
            manifest: self.manifest.clone().map(ManifestSource::File),
            policy: self.policy.clone(),
            policy_seed: self.policy_seed,
            reference: self.reference.clone(),
            oracle: self.oracle.clone(),
            plan_steps: None,
            episodes: self.episodes,
            seed: self.seed,
            dataset: self.dataset.clone(),
            opening: self.opening.options()?,
            goal_offset: self.goal_offset,
            budget: self.budget,
            frame_skip: self.world.frame_skip,
            image_size: self.image_size.map(|size| ImageChoice(size.0)),
            vary: self.scenario.vary.clone(),
            set: self.scenario.set(output)?,
            num_envs: self.world.num_envs,
            threads: self.world.threads.count(),
            out: self.out.clone(),
            again: self.again,
            shard: self.part.shard,
            join: self.part.join,
            videos: self.videos,
            video_format: self.video_format.clone(),
        })
    }

    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        run(&self.request(registry, output)?, registry, output)
    }
}

/// Evaluates, and prints what came out.
pub(super) fn run(request: &Evaluate, registry: &Registry, output: &Output) -> Result<(), Failure> {
    request.check(registry)?;
    let out = request.out.as_deref();
    match request.run(registry, &mut Reporter::new(output, watch(request)))? {
        Evaluated::Receipt(receipt, path) => {
            output.result(&receipt, || receipt_text(&receipt, path.as_deref()))
        }
        Evaluated::Part(shard, episodes) => part_done(out, shard, episodes, output),
        Evaluated::Episodes(evaluation, written) => {
            // The figures first: they are printed even where a video fails.
            let files = written.as_deref().unwrap_or_default();
            output.result(&evaluation, || text(&evaluation, &request.policy, files))?;
            written.map(drop).map_err(Failure::from)
        }
        _ => Ok(()),
    }
}

/// What ends an evaluation when the command is interrupted.
fn watch(request: &Evaluate) -> Cancel {
    match (&request.manifest, &request.out) {
        (Some(_), Some(dir)) => {
            interrupt::watch_resumable(interrupt::episodes_are_in(dir), interrupt::REPEAT)
        }
        (Some(_), None) => interrupt::watch(|| {
            "nothing is kept of this evaluation; with --out DIR it can be continued".to_owned()
        }),
        (None, _) => interrupt::watch(|| "nothing is kept of this evaluation; run it again".to_owned()),
    }
}

/// A short summary for people.
fn text(evaluation: &Evaluation, policy: &str, written: &[PathBuf]) -> String {
    let [low, high] = evaluation.ci95;
    let won = evaluation.episode_successes.iter().filter(|&&success| success).count();
    let steps = evaluation.mean_success_steps.map_or("–".to_owned(), |steps| format!("{steps:.1}"));
    let success = format!("{:.1} % ({won} of {})", evaluation.success_rate, evaluation.episodes);
    let mut rows = match evaluation.has_success {
        true => vec![
            ("success", success),
            ("95 % interval", format!("{low:.1} to {high:.1} %")),
            ("mean steps to success", steps),
            (
                "success at reset",
                match evaluation.solved_at_start {
                    0 => "0".to_owned(),
                    solved => format!("{solved} of {}, counted as successes", evaluation.episodes),
                },
            ),
        ],
        false => vec![("success", "the task has none, only rewards".to_owned())],
    };
    rows.extend([
        ("return per episode", returns(&evaluation.episode_returns)),
        ("policy", policy.to_owned()),
        ("environment", evaluation.setup.env.clone()),
        ("wall time", format!("{:.1} s", evaluation.wall_time_s)),
    ]);
    let files = written.iter().map(|path| format!("{}\n", Path::display(path)));
    format!("{}{}", key_values(&rows), files.collect::<String>())
}

/// Mean, its standard error, and the range.
fn returns(all: &[f64]) -> String {
    let count = all.len() as f64;
    let mean = all.iter().sum::<f64>() / count;
    if all.len() < 2 {
        return format!("{mean:.2} (one episode)");
    }
    let squares: f64 = all.iter().map(|value| (value - mean) * (value - mean)).sum();
    let error = (squares / (count - 1.0) / count).sqrt();
    let (low, high) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (v.min(l), v.max(h)));
    format!("{mean:.2} ± {error:.2} (standard error), from {low:.2} to {high:.2}")
}
