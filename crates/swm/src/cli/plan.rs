//! `swm plan`: trace a planner.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clap::{Args, ValueEnum};
use swm_core::error::{BoxError, did_you_mean, nearest};
use swm_core::{
    EnvConfig, EnvEntry, EpisodeEnd, ImageSize, LiveStep, Policy, PolicyArgs, Recorder, Registry, World,
};
use swm_media::Format;
use swm_solvers::{ActionMap, Detail, JsonLines, NoTrace, SolverEntry, Trace, stops_at_success};
use swm_tasks::request::note_images;

use super::args::{ImageArg, OptionalEnvArgs, WorldArgs, model_image, policy_args};
use super::output::{claim, counted, table};
use super::plan_problem::Problem;
use super::scenario::ScenarioArgs;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};
use crate::plan::{EpisodeSummary, PlanFigures, PlanSummary, Report, Watched, planner_of, write_report};
use crate::video::Video;

/// Plan with a solver on the true simulator or a model, carry the plans out, and show the search.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm plan swm/PushT-v1 --policy cem:samples=300,iterations=30,elites=30 --trace out
  swm plan swm/PushT-v1 --policy cem:horizon=4,receding_horizon=2 --episodes 3 --budget 60 --trace out --details elites
  swm plan swm/PushT-v1 --policy cem --plan-only --json
  swm plan --manifest pusht-strict.toml --pair 7 --policy cem --trace out   (as `swm eval --manifest` runs it)

With --trace, the folder gets index.html (open it in a browser), the figures as SVG files, a video per episode, \
result.json, and trace.jsonl: a line per iteration of every plan. `swm solvers` lists the solvers.")]
pub(super) struct Plan {
    #[command(flatten)]
    env: OptionalEnvArgs,
    /// Plan for a pair of this manifest, as `swm eval --manifest` does.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["env", "env_options", "episodes", "seed", "budget", "frame_skip", "vary", "set", "image_size"])]
    manifest: Option<PathBuf>,
    /// With --manifest: the pair, counted from 0. Default: 0.
    #[arg(long, value_name = "N")]
    pair: Option<u64>,
    /// A policy that plans: a solver with its settings (NAME, NAME:KEY=VALUE,… or NAME:@FILE; `swm solvers NAME` lists them), or a model.
    #[arg(long)]
    policy: String,
    /// Episodes to plan for, one after the other.
    #[arg(long, default_value_t = 1)]
    episodes: u64,
    /// Seed of starts, goals and noise.
    #[arg(long, default_value_t = 42)]
    seed: u64,
    /// Actions allowed per episode.
    #[arg(long, default_value_t = 100)]
    budget: u64,
    /// Only make the first plan of each episode, and take its first action.
    #[arg(long, conflicts_with = "budget")]
    plan_only: bool,
    /// A new folder for the trace, figures, videos and a page that shows them.
    #[arg(long, value_name = "DIR")]
    trace: Option<PathBuf>,
    /// With --trace: replace an earlier trace in the folder.
    #[arg(long, requires = "trace")]
    overwrite: bool,
    /// With --trace: what trace.jsonl holds of each iteration.
    #[arg(long, value_enum, default_value_t, requires = "trace")]
    details: DetailArg,
    /// With --trace: how many plans get figures, from the first on.
    #[arg(long, default_value_t = 6)]
    drawn: usize,
    /// With --trace: kind of video. Default: mp4 where this build can make it.
    #[arg(long, alias = "film-format", value_parser = ["mp4", "gif"])]
    video_format: Option<String>,
    /// With --trace: image size, or `none`. Default: that of the policy's model, else 224x224.
    #[arg(long)]
    image_size: Option<ImageArg>,
    #[command(flatten)]
    pub(super) threads: ThreadsArg,
    /// How often each action is applied per step.
    #[arg(long, default_value_t = 1, value_name = "F")]
    frame_skip: u32,
    #[command(flatten)]
    scenario: ScenarioArgs,
}

/// How much of each iteration is written.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum DetailArg {
    /// Its figures.
    #[default]
    Figures,
    /// Also the elites and the search distribution.
    Elites,
    /// Also every candidate: megabytes per plan.
    Candidates,
}

/// Elites of an iteration that are drawn.
const DRAWN_ELITES: usize = 16;
/// Plans that the summary for people lists.
const LISTED: usize = 20;

impl Plan {
    pub(super) fn run(mut self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let problem = self.problem(registry)?;
        let entry = problem.entry;
        let of_model = model_image(registry, entry, &self.policy);
        let traced = || problem.image.or(Some(ImageSize { height: 224, width: 224 }));
        let image = self.trace.as_ref().and_then(|_| self.image_size.map_or_else(traced, |size| size.0));
        let seen = image.or(problem.image);
        note_images(&self.policy, of_model, seen, &mut &*output);
        let format = video_format(self.video_format.as_deref())?;
        let config = EnvConfig { image: seen, settings: problem.settings.clone() };
        let args = WorldArgs { num_envs: 1, threads: self.threads, frame_skip: Some(problem.frame_skip) };
        let mut world = World::new(entry, args.options(config.clone(), problem.budget))?;
        let asked = problem.policy(registry, policy_args(registry, &self.policy)?);
        let mut policy = self.planner(registry, &asked, &world)?;
        problem.note_training(registry, &asked, &world, output);
        let planner = planner_of(policy.as_mut()).ok_or_else(|| makes_no_plans(registry, &self.policy))?;
        let actions = planner.actions(&world.spec().action)?;
        // A scenario that cannot be is found out before the folder is made.
        let rollout = problem.rollout(&mut world, &self.scenario, output)?;
        let _claim = self.trace.as_deref().map(claim).transpose()?;
        let lines = self.open_trace()?.map(|lines| Arc::new(Mutex::new(lines)));
        let trace: Box<dyn Trace> = match &lines {
            Some(lines) => Box::new(Arc::clone(lines)),
            None => Box::new(NoTrace),
        };
        let watched = Watched::new(policy, DRAWN_ELITES, trace);
        let (policy, session) = watched.map_err(|_| makes_no_plans(registry, &self.policy))?;
        world.set_policy(policy)?;
        let episodes = problem.episodes.end - problem.episodes.start;
        let bar = output.bar(episodes * problem.budget, "steps");
        let mut video = Video::first(if image.is_some() { episodes } else { 0 });
        let mut watch = (&mut video, Episodes { bar: bar.clone(), list: Vec::new() });
        let started = Instant::now();
        let ran = problem.run(&mut world, &rollout, &mut watch);
        bar.finish_and_clear();
        let finished = lines.map(|lines| lines.lock().unwrap_or_else(PoisonError::into_inner).finish());
        ran?;
        if let (Some(Err(error)), Some(dir)) = (finished, &self.trace) {
            return Err(format!("cannot write to the folder {}: {error}", dir.display()).into());
        }
        let Episodes { list, .. } = watch.1;
        let session = session.lock().unwrap_or_else(PoisonError::into_inner);
        let summary = PlanSummary {
            env: entry.id.to_owned(),
            policy: world.policy_description().unwrap_or_default(),
            seed: problem.seed,
            frame_skip: problem.frame_skip,
            episodes: list,
            plans: PlanFigures::of(&session),
            wall_time_s: started.elapsed().as_secs_f64(),
        };
        let written = match &self.trace {
            Some(dir) => {
                let (video, session, summary) = (&video, &*session, &summary);
                let (config, actions, drawn): (_, &ActionMap, _) = (&config, &actions, self.drawn);
                let stops_at_success = stops_at_success(&asked);
                let report = Report {
                    entry,
                    config,
                    actions,
                    session,
                    summary,
                    video,
                    format,
                    drawn,
                    stops_at_success,
                };
                write_report(dir, &report)
            }
            None => Ok(Vec::new()),
        };
        if let Some(note) = self.worse_than_best(registry, entry, &summary.plans) {
            output.note(note);
        }
        let page = written.as_ref().ok().and_then(|files| files.first());
        output.result(&summary, || text(&summary, &self.policy, page.map(PathBuf::as_path)))?;
        written.map(drop).map_err(Failure::from)
    }

    /// What is planned for.
    fn problem(&mut self, registry: &Registry) -> Result<Problem, Failure> {
        if let Some(manifest) = &self.manifest {
            return Problem::pair(registry, manifest, self.pair.unwrap_or(0), self.plan_only);
        }
        if let Some(pair) = self.pair {
            return Err(usage(format!("--pair {pair} is a pair of a manifest; give --manifest FILE, too")));
        }
        let (env, budget) = (self.env.take()?, if self.plan_only { 1 } else { self.budget });
        let (policy, episodes, seed) = (&self.policy, self.episodes, self.seed);
        Problem::new_episodes(registry, &env, policy, episodes, seed, budget, self.frame_skip)
    }

    /// The policy, or why there is none that plans.
    fn planner(
        &self,
        registry: &Registry,
        args: &PolicyArgs,
        world: &World,
    ) -> Result<Box<dyn Policy>, Failure> {
        let name = &args.name;
        if registry.policy_entry(world.entry(), name).is_ok() {
            return Ok(registry.policy_from(args, world)?);
        }
        if registry.find::<SolverEntry>(name).is_ok() {
            let reason = format!(
                "the solver `{name}` cannot plan on the true simulator, it needs a model of the dynamics"
            );
            return Err(usage(format!("{reason}; solvers that can are {}", planners(registry).join(", "))));
        }
        let meant = did_you_mean(nearest(name, planners(registry)).as_deref());
        Err(usage(format!("unknown solver `{name}`{meant}; `swm solvers` lists them")))
    }

    /// A note where plans cost more than candidates that were known: solvers return a mean of samples unless told otherwise.
    fn worse_than_best(
        &self,
        registry: &Registry,
        entry: &EnvEntry,
        plans: &[PlanFigures],
    ) -> Option<String> {
        let is_worse = |plan: &&PlanFigures| {
            plan.cost.zip(plan.last_best).is_some_and(|(cost, best)| cost > best + 1e-9 * best.abs())
        };
        let worse = plans.iter().filter(is_worse).count();
        let name = policy_args(registry, &self.policy).ok()?.name;
        let policy = registry.policy_entry(entry, &name).ok()?;
        let fix = match policy.settings.iter().any(|setting| setting.name == "return_best") {
            true => "; return_best=true takes the best candidate",
            false => "",
        };
        (worse > 0).then(|| {
            format!(
                "note: {worse} of {} cost more than their best candidate: `{name}` returns a mean of its samples{fix}",
                counted(plans.len(), "plan")
            )
        })
    }

    /// Where the lines of the trace go; nowhere without `--trace`. Makes the folder.
    fn open_trace(&self) -> Result<Option<JsonLines<BufWriter<File>>>, Failure> {
        let detail = match self.details {
            DetailArg::Figures => Detail::Figures,
            DetailArg::Elites => Detail::Elites,
            DetailArg::Candidates => Detail::Candidates,
        };
        let Some(dir) = &self.trace else { return Ok(None) };
        let failed = |error| usage(format!("cannot write to the folder {}: {error}", dir.display()));
        prepare_folder(dir, self.overwrite)?;
        let file = File::create(dir.join("trace.jsonl")).map_err(failed)?;
        Ok(Some(JsonLines::new(BufWriter::new(file), detail)))
    }
}

/// The solvers that plan on the true simulator.
fn planners(registry: &Registry) -> Vec<&'static str> {
    registry
        .all::<SolverEntry>()
        .filter(|solver| solver.plans_on_simulator)
        .map(|solver| solver.name)
        .collect()
}

fn makes_no_plans(registry: &Registry, policy: &str) -> Failure {
    let name = policy.split(':').next().unwrap_or_default();
    usage(format!(
        "the policy `{name}` makes no plans; solvers that do are {}",
        planners(registry).join(", ")
    ))
}

/// Makes the folder, or empties it of an earlier report: of nothing else.
fn prepare_folder(dir: &Path, overwrite: bool) -> Result<(), Failure> {
    let failed = |error| usage(format!("cannot write to the folder {}: {error}", dir.display()));
    fs::create_dir_all(dir).map_err(failed)?;
    let files: Vec<PathBuf> = fs::read_dir(dir)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect())
        .map_err(failed)?;
    if files.is_empty() {
        return Ok(());
    }
    if !overwrite {
        let reason = "is not empty; give a new one, or --overwrite to replace an earlier trace in it";
        return Err(usage(format!("the folder {} {reason}", dir.display())));
    }
    if !dir.join("trace.jsonl").is_file() {
        let reason = "holds no earlier trace (trace.jsonl), so nothing in it is replaced; give a new one";
        return Err(usage(format!("the folder {} {reason}", dir.display())));
    }
    let ours = |path: &&PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        ["index.html", "costs.svg", "result.json", "trace.jsonl"].contains(&name.as_ref())
            || (name.starts_with("episode_")
                && [".svg", ".gif", ".mp4"].iter().any(|end| name.ends_with(end)))
    };
    files.iter().filter(ours).try_for_each(fs::remove_file).map_err(failed)
}

fn video_format(asked: Option<&str>) -> Result<Format, Failure> {
    match asked {
        Some("gif") => Ok(Format::Gif),
        None if !Format::Mp4.is_built() => Ok(Format::Gif),
        _ if Format::Mp4.is_built() => Ok(Format::Mp4),
        _ => Err(usage(
            "this build has no MP4 encoder; use --video-format gif, or build with the feature `mp4`",
        )),
    }
}

/// A short summary for people.
fn text(summary: &PlanSummary, policy: &str, page: Option<&Path>) -> String {
    let cost = |cost: Option<f64>| cost.map_or("–".to_owned(), |cost| format!("{cost:.3}"));
    let success = |episode: u64| {
        let episode = summary.episodes.iter().find(|known| known.episode == episode);
        episode.and_then(|episode| episode.success)
    };
    let last_of = |index: usize| {
        summary.plans.get(index + 1).is_none_or(|next| next.episode != summary.plans[index].episode)
    };
    let outcome = |index: usize| match success(summary.plans[index].episode) {
        _ if !last_of(index) => "",
        Some(true) => "success",
        Some(false) => "no success",
        None => "",
    };
    let row = |(index, plan): (usize, &PlanFigures)| {
        vec![
            plan.episode.to_string(),
            plan.plan.to_string(),
            plan.step.to_string(),
            cost(plan.first_best),
            cost(plan.last_best),
            cost(plan.cost),
            format!("{:.3}", plan.wall_time_s),
            outcome(index).to_owned(),
        ]
    };
    let rows: Vec<_> = summary.plans.iter().enumerate().take(LISTED).map(row).collect();
    let head =
        ["episode", "plan", "at step", "first best", "last best", "cost of plan", "seconds", "episode ends"];
    let more = match summary.plans.len().saturating_sub(LISTED) {
        0 => String::new(),
        more => format!("… and {more} more\n"),
    };
    let count = summary.plans.len();
    let time: f64 = summary.plans.iter().map(|plan| plan.wall_time_s).sum();
    let judged = summary.episodes.iter().filter(|episode| episode.success.is_some()).count();
    let won = summary.episodes.iter().filter(|episode| episode.success == Some(true)).count();
    let successes =
        if judged > 0 { format!(", {won} of {judged} episodes successful") } else { String::new() };
    let page = page.map(|page| format!("wrote {}\n", page.display())).unwrap_or_default();
    format!(
        "{}\n{}\n\n{}{more}\n{count} {}, {:.3} s each{successes}\n{page}",
        summary.env,
        policy,
        table(&head, &rows),
        if count == 1 { "plan" } else { "plans" },
        time / count.max(1) as f64,
    )
}

/// Remembers how episodes end, and counts steps.
struct Episodes {
    bar: indicatif::ProgressBar,
    list: Vec<EpisodeSummary>,
}

impl Recorder for Episodes {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        self.bar.inc(1);
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.list.push(EpisodeSummary { episode: end.index, steps: end.steps, success: end.success });
        Ok(())
    }
}
