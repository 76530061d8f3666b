//! A planner is traced: its plans on the true simulator or a model, carried out, and the search behind them.

mod folder;
mod problem;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use serde_json::{Map, Value as Json};
use swm_core::error::{BoxError, did_you_mean, nearest};
use swm_core::settings::Settings as _;
use swm_core::{
    EnvConfig, EnvEntry, EpisodeEnd, ImageSize, LiveStep, Policy, PolicyArgs, Recorder, Registry, World,
    WorldOptions,
};
use swm_solvers::{ActionMap, Detail, JsonLines, NoTrace, SolverEntry, Trace, stops_at_success};

use super::evaluate::check_fixed;
use super::policy::{model_image, note_images, policy_args};
use super::source::{check_built, video_format_of};
use super::{
    Fix, ImageChoice, List, ManifestSource, Message, Progress, Report, Request, Scenario, Stage, TaskError,
    apart,
};
use crate::plan::{self, EpisodeSummary, PlanFigures, PlanSummary, Watched, planner_of, write_report};
use crate::threads::{self, within};
use crate::video::Video;
use problem::Problem;

swm_core::settings! {
    /// Plan with a solver on the true simulator or a model, and carry the plans out.
    pub struct Plan {
        /// The environment's id.
        env: String = String::new() => "that of the manifest",
        /// Settings of the environment, by name.
        env_option: Map<String, Json> = Map::new() => "none",
        /// Plan for a pair of this manifest, as it is evaluated.
        manifest: Option<ManifestSource> = None => "none",
        /// With a manifest: the pair, counted from 0.
        pair: Option<u64> = None => "0",
        /// A policy that plans: a solver with its settings, or a model: NAME, NAME:KEY=VALUE,… or NAME:@FILE.
        policy: String = String::new() => "must be given",
        /// Episodes to plan for, one after the other.
        episodes: u64 = 1,
        /// Seed of starts, goals and noise.
        seed: u64 = 42,
        /// Actions allowed per episode.
        budget: u64 = 100,
        /// Only make the first plan of each episode, and take its first action.
        plan_only: bool = false,
        /// A new folder for the trace, figures, videos and a page that shows them.
        trace: Option<PathBuf> = None => "none",
        /// With a folder: replace an earlier trace in it.
        overwrite: bool = false,
        /// With a folder: what trace.jsonl holds of each iteration: `figures`, `elites` or `candidates`.
        details: String = "figures".to_owned() => "figures",
        /// With a folder: how many plans get figures, from the first on.
        drawn: usize = 6,
        /// With a folder: kind of video, mp4 or gif.
        video_format: Option<String> = None => "mp4 where this build can make it",
        /// With a folder: image size.
        image_size: Option<ImageChoice> = None => "that of the policy's model, else 224x224",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// How often each action is applied per step.
        frame_skip: u32 = 1,
        /// Factors to sample per episode: names, groups, `*.color`, `default`, `all` or `none`; `+NAME` adds to the default ones.
        vary: Option<Vec<String>> = None => "the default factors",
        /// Factors to set, by name: numbers, or names of colors and choices.
        set: Map<String, Json> = Map::new() => "none",
    }
}

/// What came out of planning.
#[derive(Debug)]
#[non_exhaustive]
pub struct Planned {
    /// Episodes and plans.
    pub summary: PlanSummary,
    /// The files that were written, the page first, or why one of them could not be.
    pub written: Result<Vec<PathBuf>, TaskError>,
}

/// What a manifest fixes.
const OF_MANIFEST: &[&str] =
    &["env", "env_option", "episodes", "seed", "budget", "frame_skip", "image_size", "vary", "set"];
/// How much of each iteration is written, by name.
const DETAILS: [(&str, Detail); 3] =
    [("figures", Detail::Figures), ("elites", Detail::Elites), ("candidates", Detail::Candidates)];
/// Size of images that no model asks for.
const IMAGE: ImageSize = ImageSize { height: 224, width: 224 };
/// Elites of an iteration that are drawn.
const DRAWN_ELITES: usize = 16;

impl Request for Plan {
    const NAME: &'static str = "plan";
    type Outcome = Planned;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        if self.policy.is_empty() {
            return Err(Message::about_setting("policy", "must be given").into());
        }
        let changed = self.changed();
        match (&self.manifest, self.pair) {
            (Some(_), _) => check_fixed(&changed, OF_MANIFEST)?,
            (None, Some(pair)) => {
                let message = Message::about("pair", pair, "is a pair of a manifest");
                return Err(message.fix(Fix::give("manifest")).into());
            }
            (None, None) if self.env.is_empty() => {
                let fix = Fix::Any(vec![Fix::give("env"), Fix::give("manifest")]);
                return Err(Message::new("nothing names the environment").fix(fix).into());
            }
            (None, None) => {
                registry.env(&self.env)?;
            }
        }
        for (name, is_zero, text) in [
            ("episodes", self.episodes == 0, "nothing is planned for; use 1 or more"),
            ("budget", self.budget == 0, "no action is allowed; use 1 or more"),
        ] {
            if is_zero {
                return Err(Message::about(name, 0, text).into());
            }
        }
        if self.plan_only && changed.contains_key("budget") {
            let message = Message::about("budget", self.budget, "a first plan takes one action");
            return Err(message.fix(Fix::Any(vec![Fix::Leave("budget"), Fix::Leave("plan_only")])).into());
        }
        for name in ["overwrite", "details"] {
            if let (Some(value), None) = (changed.get(name), &self.trace) {
                let message = Message::about(name, value.clone(), "is about a folder, and none is named");
                return Err(message.fix(Fix::give("trace")).into());
            }
        }
        self.detail()?;
        threads::check(self.threads)?;
        check_built(video_format_of(self.video_format.as_deref())?)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Planned, TaskError> {
        self.check(registry)?;
        let problem = Problem::of(self, registry)?;
        let entry = problem.entry;
        let of_model = model_image(registry, entry, &self.policy);
        let traced = || problem.image.or(Some(IMAGE));
        let image = self.trace.as_ref().and_then(|_| self.image_size.map_or_else(traced, |size| size.0));
        let seen = image.or(problem.image);
        note_images(&self.policy, of_model, seen, report);
        let format = video_format_of(self.video_format.as_deref())?;
        let config = EnvConfig { image: seen, settings: problem.settings.clone() };
        let options = WorldOptions::new(1).env(config.clone()).max_episode_steps(problem.budget);
        let options = options.frame_skip(problem.frame_skip).threads(self.threads);
        let mut world = World::new(entry, options)?;
        let asked = problem.policy(registry, policy_args(registry, &self.policy)?);
        let mut policy = planner(registry, &asked, &world)?;
        problem.note_training(registry, &asked, &world, report);
        let planner = planner_of(policy.as_mut()).ok_or_else(|| makes_no_plans(registry, &asked.name))?;
        let actions = planner.actions(&world.spec().action)?;
        // A scenario that cannot be is found out before the folder is made.
        let scenario = Scenario { vary: self.vary.as_deref(), set: &self.set };
        let rollout = problem.rollout(&mut world, scenario, report)?.cancel(report.cancel());
        let _claim = self.trace.as_deref().map(folder::claim).transpose()?;
        let lines = self.open_trace()?.map(|lines| Arc::new(Mutex::new(lines)));
        let trace: Box<dyn Trace> = match &lines {
            Some(lines) => Box::new(Arc::clone(lines)),
            None => Box::new(NoTrace),
        };
        let watched = Watched::new(policy, DRAWN_ELITES, trace);
        let (policy, session) = watched.map_err(|_| makes_no_plans(registry, &asked.name))?;
        world.set_policy(policy)?;
        let episodes = problem.episodes.end - problem.episodes.start;
        let stage = Stage { name: &asked.name, role: None, unit: "steps", total: episodes * problem.budget };
        let mut video = Video::first(if image.is_some() { episodes } else { 0 });
        let mut watch = (&mut video, Episodes { progress: report.begin(&stage)?, list: Vec::new() });
        let started = Instant::now();
        let ran = apart(report, || within(self.threads, || problem.run(&mut world, &rollout, &mut watch)))??;
        let Episodes { list, progress } = watch.1;
        drop(progress);
        let finished = lines.map(|lines| lines.lock().unwrap_or_else(PoisonError::into_inner).finish());
        ran?;
        if let (Some(Err(error)), Some(dir)) = (finished, &self.trace) {
            return Err(format!("cannot write to the folder {}: {error}", dir.display()).into());
        }
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
                let page = plan::Report {
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
                write_report(dir, &page)
            }
            None => Ok(Vec::new()),
        };
        if let Some(note) = worse_than_best(registry, entry, &asked.name, &summary.plans) {
            report.note(&note);
        }
        drop(session);
        Ok(Planned { summary, written })
    }
}

impl Plan {
    fn detail(&self) -> Result<Detail, TaskError> {
        let known = DETAILS.into_iter().find(|(name, _)| *name == self.details);
        known.map(|(_, detail)| detail).ok_or_else(|| {
            let message = Message::about("details", self.details.as_str(), "no part of an iteration");
            message.fix(Fix::Choose(DETAILS.map(|(name, _)| name.to_owned()).to_vec())).into()
        })
    }

    /// Where the lines of the trace go; nowhere without a folder, which is made.
    fn open_trace(&self) -> Result<Option<JsonLines<BufWriter<File>>>, TaskError> {
        let Some(dir) = &self.trace else { return Ok(None) };
        folder::prepare(dir, self.overwrite)?;
        let file = File::create(dir.join("trace.jsonl")).map_err(|error| folder::unwritable(dir, &error))?;
        Ok(Some(JsonLines::new(BufWriter::new(file), self.detail()?)))
    }
}

/// The solvers that plan on the true simulator.
fn planners(registry: &Registry) -> Vec<&'static str> {
    let solvers = registry.all::<SolverEntry>().filter(|solver| solver.plans_on_simulator);
    solvers.map(|solver| solver.name).collect()
}

/// The policy, or why there is none that plans.
fn planner(registry: &Registry, args: &PolicyArgs, world: &World) -> Result<Box<dyn Policy>, TaskError> {
    let name = args.name.as_str();
    if registry.policy_entry(world.entry(), name).is_ok() {
        return Ok(registry.policy_from(args, world)?);
    }
    let known = planners(registry);
    if registry.find::<SolverEntry>(name).is_ok() {
        let text = format!(
            "the solver `{name}` cannot plan on the true simulator, it needs a model of the dynamics"
        );
        return Err(Message::new(text).fix(choose(&known)).into());
    }
    let meant = did_you_mean(nearest(name, known).as_deref());
    Err(Message::new(format!("unknown solver `{name}`{meant}")).fix(Fix::List(List::Solvers)).into())
}

/// One of these.
fn choose(names: &[&str]) -> Fix {
    Fix::Choose(names.iter().map(|&name| name.to_owned()).collect())
}

fn makes_no_plans(registry: &Registry, name: &str) -> TaskError {
    Message::new(format!("the policy `{name}` makes no plans")).fix(choose(&planners(registry))).into()
}

/// A note where plans cost more than candidates that were known: solvers return a mean of samples unless told otherwise.
fn worse_than_best(
    registry: &Registry,
    entry: &EnvEntry,
    name: &str,
    plans: &[PlanFigures],
) -> Option<Message> {
    let is_worse = |plan: &&PlanFigures| {
        plan.cost.zip(plan.last_best).is_some_and(|(cost, best)| cost > best + 1e-9 * best.abs())
    };
    let worse = plans.iter().filter(is_worse).count();
    let policy = registry.policy_entry(entry, name).ok()?;
    let fix = match policy.settings.iter().any(|setting| setting.name == "return_best") {
        true => "; return_best=true takes the best candidate",
        false => "",
    };
    (worse > 0).then(|| {
        let (of, s) = (plans.len(), if plans.len() == 1 { "" } else { "s" });
        Message::new(format!(
            "{worse} of {of} plan{s} cost more than their best candidate: `{name}` returns a mean of its samples{fix}"
        ))
    })
}

/// Remembers how episodes end, and counts steps.
struct Episodes {
    progress: Box<dyn Progress>,
    list: Vec<EpisodeSummary>,
}

impl Recorder for Episodes {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        // The first row is that of the reset.
        if row.episode.step > 0 {
            self.progress.done(None);
        }
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.list.push(EpisodeSummary { episode: end.index, steps: end.steps, success: end.success });
        Ok(())
    }
}
