//! The result of a planner's run, as `result.json` holds it.

use serde::Serialize;
use swm_solvers::{TracedIteration, TracedPlan};

use super::watched::{PlanStart, Session};

/// The result of a planner's run.
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

/// The result of an episode.
#[derive(Clone, Debug, Serialize)]
pub struct EpisodeSummary {
    /// Its index in the run.
    pub episode: u64,
    /// Actions taken.
    pub steps: u64,
    /// Whether the goal was reached; `None` where the task has no success.
    pub success: Option<bool>,
}

/// The figures of one plan.
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
        let figures = |(start, traced): (&PlanStart, &TracedPlan)| {
            let best = |iteration: Option<&TracedIteration>| iteration.and_then(|i| i.record.best);
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
