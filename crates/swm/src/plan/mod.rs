//! Watching a planner at work in one environment: what it tried, what it expected, what came of it; and a folder with
//! images of that.
//!
//! [`Watched`] is a planner that remembers where each plan began; [`write_report`] draws what it has seen. How plans
//! are made is not known here.

mod costs;
mod elites;
mod future;
mod page;
mod paths;
mod watched;

use std::path::{Path, PathBuf};

use serde::Serialize;
use swm_core::error::BoxError;
use swm_core::{EnvConfig, EnvEntry, PolicyArgs};
use swm_media::Format;
use swm_solvers::ActionMap;

use crate::report::save_video;
use crate::video::Video;
use future::Future;
pub(crate) use page::{Figures, PlanFigure};

pub use watched::{PlanStart, Session, Watched, planner_of};

/// What a run of a planner came to.
#[derive(Clone, Debug, Serialize)]
pub struct PlanSummary {
    /// Environment id.
    pub env: String,
    /// The planner with its settings.
    pub policy: String,
    /// Seed of the run.
    pub seed: u64,
    /// Environment steps per action.
    pub frame_skip: u32,
    /// Every episode, in order.
    pub episodes: Vec<EpisodeSummary>,
    /// Every plan, in order.
    pub plans: Vec<PlanFigures>,
    /// Seconds that the run took. Differs from run to run, as the plans' `wall_time_s` do.
    pub wall_time_s: f64,
}

/// How an episode went.
#[derive(Clone, Debug, Serialize)]
pub struct EpisodeSummary {
    /// Its index in the run.
    pub episode: u64,
    /// Actions taken.
    pub steps: u64,
    /// Whether the goal was reached; `None` where the task has no success.
    pub success: Option<bool>,
}

/// What a plan came to.
#[derive(Clone, Debug, Serialize)]
pub struct PlanFigures {
    /// Index of the episode.
    pub episode: u64,
    /// How many plans the episode had before.
    pub plan: u64,
    /// The step of the episode at which it was made.
    pub step: u64,
    /// Iterations made.
    pub iterations: u32,
    /// Cost of the cheapest candidate of the first iteration.
    pub first_best: Option<f64>,
    /// Cost of the cheapest candidate of the last iteration.
    pub last_best: Option<f64>,
    /// Cost of the plan.
    pub cost: Option<f64>,
    /// How many evaluated costs were not finite.
    pub non_finite: u64,
    /// Seconds that planning took.
    pub wall_time_s: f64,
}

impl PlanFigures {
    /// The figures of every plan of a session.
    pub fn of(session: &Session) -> Vec<Self> {
        let figures = |(start, traced): (&PlanStart, &swm_solvers::TracedPlan)| {
            let best =
                |iteration: Option<&swm_solvers::TracedIteration>| iteration.and_then(|i| i.record.best);
            let result = traced.result.as_ref();
            Self {
                episode: traced.key.episode,
                plan: traced.key.plan,
                step: start.step,
                iterations: result.map_or(0, |result| result.iterations),
                first_best: best(traced.iterations.first()),
                last_best: best(traced.iterations.last()),
                cost: result.and_then(|result| result.cost),
                non_finite: result.map_or(0, |result| result.non_finite),
                wall_time_s: start.wall_time_s,
            }
        };
        session.starts.iter().zip(session.memory.plans()).map(figures).collect()
    }
}

/// What a report is made from.
pub struct Report<'a> {
    /// The environment.
    pub entry: &'a EnvEntry,
    /// How it is made, images included.
    pub config: &'a EnvConfig,
    /// How numbers of plans become actions.
    pub actions: &'a ActionMap,
    /// What the planner did.
    pub session: &'a Session,
    /// What it came to.
    pub summary: &'a PlanSummary,
    /// The images.
    pub video: &'a Video,
    /// The format of videos.
    pub format: Format,
    /// How many plans get images of their own: the first ones.
    pub drawn: usize,
    /// Whether the planner's roll-outs end at the environment's success: [`stops_at_success`].
    pub stops_at_success: bool,
}

/// Whether roll-outs of a planner with these arguments end at the environment's own success.
pub fn stops_at_success(args: &PolicyArgs) -> bool {
    args.named.get("stop_at_success").and_then(serde_json::Value::as_bool).unwrap_or(true)
}

/// Writes `result.json`, the figures, the videos and `index.html` into `dir`, and returns their paths.
///
/// # Errors
///
/// A file cannot be written, or a video cannot be encoded.
pub fn write_report(dir: &Path, report: &Report<'_>) -> Result<Vec<PathBuf>, BoxError> {
    let mut written = Vec::new();
    let mut write = |name: &str, text: &str| -> Result<(), BoxError> {
        let path = dir.join(name);
        std::fs::write(&path, text).map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        written.push(path);
        Ok(())
    };
    write("result.json", &serde_json::to_string_pretty(report.summary)?)?;
    let figures = draw_figures(report)?;
    write("costs.svg", &figures.costs)?;
    for figure in &figures.plans {
        write(&format!("{}_elites.svg", figure.name), &figure.elites)?;
        if let Some(paths) = &figure.paths {
            write(&format!("{}_paths.svg", figure.name), paths)?;
        }
    }
    let mut videos = Vec::new();
    for (episode, scene) in report.video.scenes().filter(|(_, scene)| !scene.clip.is_empty()) {
        let path = save_video(dir, episode, scene, report.format)?;
        videos.extend(path.file_name().map(|name| name.to_string_lossy().into_owned()));
        written.push(path);
    }
    let path = dir.join("index.html");
    std::fs::write(&path, page::draw(report.summary, &figures, &videos))
        .map_err(|error| format!("cannot write {}: {error}", path.display()))?;
    written.insert(0, path);
    Ok(written)
}

/// Draws every figure of the report, as SVG.
pub(crate) fn draw_figures(report: &Report<'_>) -> Result<Figures, BoxError> {
    let plans = report.session.memory.plans();
    let cost = |cost: Option<f64>| cost.map_or("–".to_owned(), crate::svg::number);
    let row = |plan: &PlanFigures| {
        vec![
            plan.plan.to_string(),
            plan.step.to_string(),
            cost(plan.first_best),
            cost(plan.last_best),
            cost(plan.cost),
            plan.iterations.to_string(),
        ]
    };
    let rows = report.summary.plans.iter().take(report.drawn).map(row).collect();
    let mut figures = Figures { costs: costs::draw(plans, report.drawn), plans: Vec::new(), rows };
    let (frame_skip, stops) = (report.summary.frame_skip, report.stops_at_success);
    let mut future = Future::new(report.entry, report.config, report.actions, frame_skip, stops)?;
    for (start, plan) in report.session.starts.iter().zip(plans).take(report.drawn) {
        figures.plans.push(PlanFigure {
            name: format!("episode_{:03}_plan_{:03}", plan.key.episode, plan.key.plan),
            title: title(plan, start),
            elites: elites::draw(plan, report.actions, &future.action_names()),
            paths: paths::draw(start, plan, &mut future)?,
        });
    }
    Ok(figures)
}

fn title(plan: &swm_solvers::TracedPlan, start: &PlanStart) -> String {
    format!("Episode {}, plan {}, made at step {}", plan.key.episode, plan.key.plan, start.step)
}

/// Up to `count` of `0..len`: the first, the last, and evenly between.
fn spread_out(len: usize, count: usize) -> Vec<usize> {
    if len <= count {
        return (0..len).collect();
    }
    (0..count).map(|index| index * (len - 1) / (count - 1).max(1)).collect()
}
