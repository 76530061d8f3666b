//! `swm plan`: trace a planner.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use swm_core::{Cancel, Registry};
use swm_tasks::request::{self, ImageChoice, ManifestSource, Planned, Request as _};

use super::args::{ImageArg, OptionalEnvArgs};
use super::output::table;
use super::reporter::Reporter;
use super::scenario::ScenarioArgs;
use super::threads::ThreadsArg;
use super::{Failure, Output};
use crate::plan::{PlanFigures, PlanSummary};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<request::Plan> = LazyLock::new(request::Plan::default);

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
    #[arg(long, default_value_t = DEFAULT.episodes)]
    episodes: u64,
    /// Seed of starts, goals and noise.
    #[arg(long, default_value_t = DEFAULT.seed)]
    seed: u64,
    /// Actions allowed per episode.
    #[arg(long, default_value_t = DEFAULT.budget)]
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
    #[arg(long, value_parser = details(), default_value_t = DEFAULT.details.clone(), requires = "trace")]
    details: String,
    /// With --trace: how many plans get figures, from the first on.
    #[arg(long, default_value_t = DEFAULT.drawn)]
    drawn: usize,
    /// With --trace: kind of video. Default: mp4 where this build can make it.
    #[arg(long, value_parser = ["mp4", "gif"])]
    video_format: Option<String>,
    /// With --trace: image size, or `none`. Default: that of the policy's model, else 224x224.
    #[arg(long)]
    image_size: Option<ImageArg>,
    #[command(flatten)]
    threads: ThreadsArg,
    /// How often each action is applied per step.
    #[arg(long, default_value_t = DEFAULT.frame_skip, value_name = "F")]
    frame_skip: u32,
    #[command(flatten)]
    scenario: ScenarioArgs,
}

/// How much of each iteration is written, by name.
fn details() -> PossibleValuesParser {
    [
        PossibleValue::new("figures").help("Its figures"),
        PossibleValue::new("elites").help("Also the elites and the search distribution"),
        PossibleValue::new("candidates").help("Also every candidate: megabytes per plan"),
    ]
    .into()
}

/// Plans that the summary for people lists.
const LISTED: usize = 20;

impl Plan {
    /// What is asked for.
    fn request(&self, registry: &Registry, output: &Output) -> Result<request::Plan, Failure> {
        let (env, env_option) = self.env.named(registry)?;
        Ok(request::Plan {
            env,
            env_option,
            manifest: self.manifest.clone().map(ManifestSource::File),
            pair: self.pair,
            policy: self.policy.clone(),
            episodes: self.episodes,
            seed: self.seed,
            budget: self.budget,
            plan_only: self.plan_only,
            trace: self.trace.clone(),
            overwrite: self.overwrite,
            details: self.details.clone(),
            drawn: self.drawn,
            video_format: self.video_format.clone(),
            image_size: self.image_size.map(|size| ImageChoice(size.0)),
            threads: self.threads.count(),
            frame_skip: self.frame_skip,
            vary: self.scenario.vary.clone(),
            set: self.scenario.set(output)?,
        })
    }

    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = self.request(registry, output)?;
        let planned = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        let Planned { summary, written, .. } = planned;
        let page = written.as_ref().ok().and_then(|files| files.first());
        output.result(&summary, || text(&summary, &self.policy, page.map(PathBuf::as_path)))?;
        written.map(drop).map_err(Failure::from)
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
    let rows = summary.plans.iter().enumerate().take(LISTED).map(row);
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
        table(&head, rows),
        if count == 1 { "plan" } else { "plans" },
        time / count.max(1) as f64,
    )
}
