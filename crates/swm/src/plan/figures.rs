//! Every figure of a report on plans, as SVG.

use swm_core::error::BoxError;
use swm_core::{EnvConfig, EnvEntry, PolicyArgs};
use swm_media::Format;
use swm_solvers::ActionMap;

use super::future::Future;
use super::summary::{PlanFigures, PlanSummary};
use super::watched::Session;
use super::{costs, elites, paths};
use crate::video::Video;

/// What a report is made from.
pub struct Report<'a> {
    /// The environment.
    pub entry: &'a EnvEntry,
    /// How it is made, images included.
    pub config: &'a EnvConfig,
    /// Maps values of plans to actions.
    pub actions: &'a ActionMap,
    /// What the planner did.
    pub session: &'a Session,
    /// Its result.
    pub summary: &'a PlanSummary,
    /// The images.
    pub video: &'a Video,
    /// The format of videos.
    pub format: Format,
    /// How many plans get figures: the first ones.
    pub drawn: usize,
    /// Whether the planner's roll-outs end at the environment's success: [`stops_at_success`].
    pub stops_at_success: bool,
}

/// Whether roll-outs of a planner with these arguments end at the environment's own success.
pub fn stops_at_success(args: &PolicyArgs) -> bool {
    args.named.get("stop_at_success").and_then(serde_json::Value::as_bool).unwrap_or(true)
}

/// The figures of a report.
pub(crate) struct Figures {
    pub(crate) costs: String,
    pub(crate) plans: Vec<PlanFigure>,
    /// The values behind `costs`.
    pub(crate) table: Vec<PlanFigures>,
}

/// The figures of one plan.
pub(crate) struct PlanFigure {
    /// How its files begin.
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) elites: String,
    pub(crate) paths: Option<String>,
}

impl PlanFigure {
    /// For templates.
    pub(crate) fn context(&self) -> minijinja::Value {
        let svg = |text: &String| minijinja::Value::from_safe_string(text.clone());
        minijinja::context! { title => &self.title, elites => svg(&self.elites), paths => self.paths.as_ref().map(svg) }
    }
}

/// Renders every figure of the report.
pub(crate) fn render_figures(report: &Report<'_>) -> Result<Figures, BoxError> {
    let plans = report.session.memory.plans();
    let (frame_skip, stops) = (report.summary.frame_skip, report.stops_at_success);
    let mut future = Future::new(report.entry, report.config, report.actions, frame_skip, stops)?;
    let names = future.action_names();
    let mut figures = Vec::new();
    for (start, plan) in report.session.starts.iter().zip(plans).take(report.drawn) {
        let (episode, index) = (plan.key.episode, plan.key.plan);
        figures.push(PlanFigure {
            name: format!("episode_{episode:03}_plan_{index:03}"),
            title: format!("Episode {episode}, plan {index}, made at step {}", start.step),
            elites: elites::render(plan, report.actions, &names),
            paths: paths::render(start, plan, &mut future)?,
        });
    }
    let table = report.summary.plans.iter().take(report.drawn).cloned().collect();
    Ok(Figures { costs: costs::render(&plans[..plans.len().min(report.drawn)]), plans: figures, table })
}
