//! `swm eval`: the success rate of a policy.

use std::path::{Path, PathBuf};

use clap::Args;
use swm_core::error::BoxError;
use swm_core::evaluate::GoalImages;
use swm_core::{
    Cancel, EpisodeEnd, EvalOptions, Evaluation, ImageSize, LiveStep, Recorder, Registry, Rollout, World,
};
use swm_media::Format;
use swm_tasks::request::{BUDGET_DATASET, BUDGET_ONLINE};

use super::args::{
    EnvArgs, ImageArg, OptionalEnvArgs, PartArgs, WorldArgs, model_image, note_images, policy, policy_args,
};
use super::eval_manifest::{EvalManifest, ReferenceArg};
use super::output::{claim, create_folder, key_values};
use super::scenario::ScenarioArgs;
use super::training_note::Ask;
use super::work::Plan;
use super::{Failure, Output, held, inputs, interrupt, usage};
use crate::evaluation::RunOptions;
use crate::report::write_report;
use crate::video::Video;

/// Largest side of a video, in pixels.
const MAX_VIDEO_SIDE: usize = 2160;

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
(episodes.png) and videos (--videos). A folder that holds a result is kept: the same evaluation is not run twice, another one is \
refused, and --again repeats or replaces it.")]
pub(super) struct Eval {
    #[command(flatten)]
    env: OptionalEnvArgs,
    /// Evaluate on this manifest; `swm manifest make` makes one.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["env", "env_options", "episodes", "seed", "dataset", "goal_offset", "budget", "frame_skip", "vary", "set", "videos", "video_format", "image_size"])]
    manifest: Option<PathBuf>,
    /// With --manifest: seed of the policy's noise, for repetitions on the same pairs. 0: noise is seeded by the pairs.
    #[arg(long, default_value_t = 0, requires = "manifest", value_name = "SEED")]
    policy_seed: u64,
    /// With --manifest: reference policies to evaluate on the same pairs, separated by commas.
    #[arg(
        long,
        alias = "beside",
        value_enum,
        default_value = "all",
        requires = "manifest",
        value_delimiter = ','
    )]
    reference: Vec<ReferenceArg>,
    /// With --manifest: the planner to use as the oracle. Default: the policy's own planner on the true dynamics, or `cem`.
    #[arg(long, alias = "ceiling", requires = "manifest", value_name = "POLICY")]
    oracle: Option<String>,
    /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE; `swm envs ENV` lists them.
    #[arg(long)]
    policy: String,
    /// Episodes to evaluate.
    #[arg(long, default_value_t = 50)]
    episodes: u64,
    /// Seed of starts, goals and policy.
    #[arg(long, default_value_t = 42)]
    seed: u64,
    /// Take starts and goals from this dataset.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// With --dataset: the goal is this many steps after the start.
    #[arg(long, default_value_t = 25, requires = "dataset")]
    goal_offset: usize,
    /// Actions allowed per episode. Default: 200, or 50 with --dataset.
    #[arg(long)]
    budget: Option<u64>,
    #[command(flatten)]
    pub(super) world: WorldArgs,
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// A folder for the result: receipt.json with --manifest, else result.json, images and videos.
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// With --out: run again what the folder holds already, and replace it.
    #[arg(long, requires = "out")]
    again: bool,
    #[command(flatten)]
    part: PartArgs,
    /// With --out: episodes to record as videos.
    #[arg(long, alias = "films", default_value_t = 4)]
    videos: u64,
    /// With --out: kind of video. Default: mp4 where this build can make it.
    #[arg(long, alias = "film-format", value_parser = ["mp4", "gif"])]
    video_format: Option<String>,
    /// Image size. Default: that of the policy's model; else 128x128 with --out, or none.
    #[arg(long)]
    image_size: Option<ImageArg>,
}

impl Eval {
    /// What a job needs to know before it is submitted.
    pub(super) fn plan(&self, registry: &Registry) -> Result<Plan, Failure> {
        let Some(manifest) = &self.manifest else {
            return Err(usage("only an evaluation on a manifest can be divided; give --manifest"));
        };
        self.on_manifest(manifest, self.world.run_options()).plan(registry)
    }

    fn on_manifest<'a>(&'a self, manifest: &'a Path, options: RunOptions) -> EvalManifest<'a> {
        EvalManifest {
            manifest,
            policy: &self.policy,
            policy_seed: self.policy_seed,
            reference: &self.reference,
            oracle: self.oracle.as_deref(),
            out: self.out.as_deref(),
            again: self.again,
            part: &self.part,
            options,
        }
    }

    pub(super) fn run(mut self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        if self.manifest.is_none() && (self.part.shard.is_some() || self.part.join) {
            return Err(usage("--shard and --join divide an evaluation on a manifest; give --manifest"));
        }
        if let Some(manifest) = &self.manifest {
            let options = RunOptions { cancel: Some(self.watch()), ..self.world.run_options() };
            return self.on_manifest(manifest, options).run(registry, output);
        }
        let env = self.env.take()?;
        self.check_without_manifest()?;
        self.run_in(&env, registry, output)
    }

    /// Refuses what only an evaluation on a manifest heeds. (The parser requires the manifest only where no environment excludes it.)
    fn check_without_manifest(&self) -> Result<(), Failure> {
        let needs = |option: &str, instead: &str| {
            Err(usage(format!("{option} is for evaluations on a manifest; give --manifest, {instead}")))
        };
        if self.policy_seed != 0 {
            return needs("--policy-seed", "or seed starts, goals and policy by --seed");
        }
        if self.oracle.is_some() {
            return needs("--oracle", "or evaluate the oracle by --policy");
        }
        match self.reference.as_slice() {
            [ReferenceArg::All] => Ok(()),
            _ => needs("--reference", "or evaluate each policy by --policy"),
        }
    }

    fn run_in(self, env: &EnvArgs, registry: &Registry, output: &Output) -> Result<(), Failure> {
        if self.episodes == 0 {
            return Err(usage("0 episodes asked for; use 1 or more"));
        }
        if self.budget == Some(0) {
            return Err(usage("--budget 0: allow 1 action or more"));
        }
        if self.goal_offset == 0 {
            return Err(usage("--goal-offset 0: every start would be its goal; use 1 or more"));
        }
        let entry = env.entry(registry)?;
        registry.policy_entry(entry, &policy_args(&self.policy)?.name)?;
        let recorded = self.out.as_ref().map(|_| ImageSize { height: 128, width: 128 });
        let of_model = model_image(registry, entry, &self.policy);
        let image = self.image_size.map_or(of_model.or(recorded), |size| size.0);
        note_images(&self.policy, of_model, image, output);
        let format = self.video_format(image)?;
        let mut dataset = self.dataset.as_deref().map(|path| inputs::open(registry, path)).transpose()?;
        if let Some(dataset) = &dataset {
            inputs::check_env(dataset.as_ref(), entry, self.world.frame_skip)?;
        }
        let recorded = dataset.as_ref().and_then(|dataset| dataset.metadata()).cloned().unwrap_or_default();
        let config = env.config_like(recorded.settings, image)?;
        let frame_skip = self.world.frame_skip.unwrap_or(recorded.frame_skip.max(1));
        let budget =
            self.budget.unwrap_or(if self.dataset.is_some() { BUDGET_DATASET } else { BUDGET_ONLINE });
        let mut world = World::new(
            entry,
            self.world.at_most(self.episodes).options(config, budget).frame_skip(frame_skip),
        )?;
        let ask = if dataset.is_some() { Ask::Dataset } else { Ask::Here };
        world.set_policy(policy(registry, &self.policy, &world, ask, output)?);
        let factors = &world.spec().factors;
        let reset = match &dataset {
            None => self.scenario.options(entry, factors, output)?,
            Some(_) => self.scenario.recorded_options(entry, factors, output)?,
        };
        let claimed = |dir: &PathBuf| create_folder(dir).and_then(|()| claim(&dir.join("result.json")));
        let _claim = self.out.as_ref().map(claimed).transpose()?;
        // What is mistyped is told first: a folder that holds a result is no reason to look for another mistake.
        if let Some(dir) = &self.out {
            // Found out now, a folder that cannot be written costs nothing.
            let probe = dir.join(".writable");
            create_folder(dir)?;
            std::fs::write(&probe, "")
                .and_then(|()| std::fs::remove_file(&probe))
                .map_err(|error| usage(format!("cannot write to the folder {}: {error}", dir.display())))?;
            for (file, what) in [
                ("result.json", "the result of an evaluation"),
                ("receipt.json", "the receipt of an evaluation on a manifest"),
            ] {
                if !self.again && dir.join(file).exists() {
                    return Err(held::refusal(dir, &format!("{what}, {file}")));
                }
            }
        }
        let bar = output.bar(self.episodes, "episodes");
        let mut video = Video::first(if self.out.is_some() { self.videos } else { 0 });
        let mut watch = (&mut video, Progress { bar: bar.clone(), successes: 0 });
        let cancel = interrupt::watch(|| "nothing is kept of this evaluation; run it again".to_owned());
        let evaluated = match &mut dataset {
            None => {
                let rollout = Rollout::new(0..self.episodes).seed(self.seed).cancel(&cancel);
                world.evaluate_with(&rollout.options(reset), &mut watch)
            }
            Some(dataset) => {
                let options = EvalOptions {
                    episodes: usize::try_from(self.episodes)?,
                    goal_offset: self.goal_offset,
                    budget,
                    seed: self.seed,
                    variation: reset.variation.unwrap_or_default(),
                    variation_values: reset.variation_values,
                    cancel: Some(cancel),
                };
                world.evaluate_from_dataset_with(dataset, &options, &mut watch)
            }
        };
        bar.finish_and_clear();
        let evaluation = evaluated?;
        let goals = evaluation.protocol.as_ref().and_then(|protocol| protocol.goal_images.as_ref());
        if let Some(note) = goals.and_then(GoalImages::note) {
            output.note(format_args!("note: {note}"));
        }
        let written = match &self.out {
            Some(dir) => write_report(dir, &evaluation, &video, format),
            None => Ok(Vec::new()),
        };
        // The figures first: they are printed even where a video fails.
        let files = written.as_deref().unwrap_or_default();
        output.result(&evaluation, || text(&evaluation, &self.policy, files))?;
        written.map(drop).map_err(Failure::from)
    }

    /// What ends an evaluation on a manifest when the command is interrupted.
    fn watch(&self) -> Cancel {
        match &self.out {
            Some(dir) => interrupt::watch_resumable(interrupt::episodes_are_in(dir), interrupt::REPEAT),
            None => interrupt::watch(|| {
                "nothing is kept of this evaluation; with --out DIR it can be continued".to_owned()
            }),
        }
    }

    /// The format of videos, checked before anything runs.
    fn video_format(&self, image: Option<ImageSize>) -> Result<Format, Failure> {
        let format = match self.video_format.as_deref() {
            Some("gif") => Format::Gif,
            Some(_) => Format::Mp4,
            None if Format::Mp4.is_built() => Format::Mp4,
            None => Format::Gif,
        };
        if self.out.is_none() || self.videos == 0 {
            return Ok(format);
        }
        if !format.is_built() {
            return Err(usage(
                "this build has no MP4 encoder; use --video-format gif, or build with the feature `mp4`",
            ));
        }
        if let Some(ImageSize { height, width }) = image
            && height.max(width) > MAX_VIDEO_SIDE
        {
            let reason = format!("videos hold images of up to {MAX_VIDEO_SIDE} pixels, not {height}x{width}");
            return Err(usage(format!("{reason}; use a smaller --image-size, or --videos 0")));
        }
        Ok(format)
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

struct Progress {
    bar: indicatif::ProgressBar,
    successes: u64,
}

impl Recorder for Progress {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.bar.inc(1);
        if let Some(success) = end.success {
            self.successes += u64::from(success);
            self.bar.set_message(format!("{} successful", self.successes));
        }
        Ok(())
    }
}
