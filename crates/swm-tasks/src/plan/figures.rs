//! Every figure of a report on plans, as SVG.

use swm_core::{EnvConfig, EnvEntry};
use swm_media::Format;
use swm_solvers::{ActionMap, PlanPaths};

use super::summary::{PlanFigures, PlanSummary};
use super::watched::Session;
use super::{costs, elites, paths};
use crate::error::TaskError;
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
    /// Whether the planner's roll-outs end at the environment's success: [`swm_solvers::stops_at_success`].
    pub stops_at_success: bool,
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
pub(crate) fn render_figures(report: &Report<'_>) -> Result<Figures, TaskError> {
    let plans = report.session.memory.plans();
    let (frame_skip, stops) = (report.summary.frame_skip, report.stops_at_success);
    let actions = report.actions.clone();
    let mut simulator = PlanPaths::new(report.entry, report.config, actions, frame_skip, stops)?;
    let names = match simulator.action_dim() {
        1 => vec!["action".to_owned()],
        dim => (0..dim).map(|index| format!("action[{index}]")).collect(),
    };
    let size = report.config.image.map(|image| [image.height, image.width]);
    let mut figures = Vec::new();
    for (start, plan) in report.session.starts.iter().zip(plans).take(report.drawn) {
        let (episode, index) = (plan.key.episode, plan.key.plan);
        figures.push(PlanFigure {
            name: format!("episode_{episode:03}_plan_{index:03}"),
            title: format!("Episode {episode}, plan {index}, made at step {}", start.step),
            elites: elites::render(plan, report.actions, &names),
            paths: paths::render(start, plan, size, &mut simulator)?,
        });
    }
    let table = report.summary.plans.iter().take(report.drawn).cloned().collect();
    Ok(Figures { costs: costs::render(&plans[..plans.len().min(report.drawn)]), plans: figures, table })
}
