//! What a planner thought: candidates and elites of its latest plan as paths over the image, their costs by iteration, and the
//! cost that the plan was given beside the true one.

use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;
use swm_core::evaluate::stats::rank_correlation;
use swm_core::{EnvConfig, EnvEntry, EnvState, Policy, PolicyArgs, PolicyError, Space, View};
use swm_solvers::{
    Iteration, Memory, Plan, PlanPaths, Problem, Trace, TracedPlan, planner_of, stops_at_success,
};
use swm_tasks::request::TaskError;

/// Elites of an iteration that are shown.
const ELITES: usize = 12;
/// Candidates of the first iteration that are shown.
const CANDIDATES: usize = 24;
/// Where a simulation is slow, fewer paths are shown: the image goes on.
const MAX_SIMULATED: Duration = Duration::from_millis(60);

/// A planner at work.
pub(super) struct Planner {
    latest: Arc<Mutex<Latest>>,
    paths: PlanPaths,
}

/// The plan that was made last.
#[derive(Default)]
struct Latest {
    memory: Memory,
    /// Of the first iteration, evenly chosen: what each cost, and its actions `[H, D]`.
    candidates: Vec<(f64, Vec<f32>)>,
    /// The step of the episode and the state that it begins in.
    start: Option<(u64, EnvState)>,
    is_new: bool,
}

/// A plan, for the page.
#[derive(Debug, Serialize)]
pub(super) struct Shown {
    kind: &'static str,
    step: u64,
    /// What moves in the image.
    objects: Vec<String>,
    /// Best, mean of the elites and mean of all candidates, by iteration.
    costs: Vec<[Option<f64>; 3]>,
    /// What the planner's model says that the plan costs.
    cost: Option<f64>,
    /// The task cost where the plan ends in the environment.
    true_cost: Option<f64>,
    /// Spearman's rank correlation of both costs over all paths but the plan.
    agreement: Option<f64>,
    /// Candidates and elites first, the plan last.
    paths: Vec<Path>,
}

/// Where a plan leads.
#[derive(Debug, Serialize)]
struct Path {
    of: &'static str,
    /// What the planner's model says that it costs.
    cost: Option<f64>,
    /// The task cost where it ends in the environment.
    true_cost: Option<f64>,
    /// Points of each object, as fractions of the image's width and height; empty where nothing is said of objects.
    objects: Vec<Vec<[f64; 2]>>,
}

fn lock(latest: &Mutex<Latest>) -> MutexGuard<'_, Latest> {
    latest.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Planner {
    /// Follows the planner of `policy`; `None` if it does not plan.
    ///
    /// # Errors
    ///
    /// Those of making a second environment.
    pub(super) fn of(
        policy: &mut dyn Policy,
        args: &PolicyArgs,
        entry: &EnvEntry,
        config: &EnvConfig,
        space: &Space,
        frame_skip: u32,
    ) -> Result<Option<Self>, TaskError> {
        let Some(planner) = planner_of(policy) else { return Ok(None) };
        let paths =
            PlanPaths::new(entry, config, planner.actions(space)?, frame_skip, stops_at_success(args))?;
        let latest = Arc::default();
        planner.set_trace(Tracer(Arc::clone(&latest)));
        Ok(Some(Self { latest, paths }))
    }

    /// Keeps the state in which a plan was just made.
    pub(super) fn starts(&self) -> Starts {
        Starts(Arc::clone(&self.latest))
    }

    /// The plan that was made since the last call.
    pub(super) fn take(&mut self) -> Option<Shown> {
        let Latest { memory, candidates, start, .. } = {
            let mut latest = lock(&self.latest);
            if !latest.is_new || latest.start.is_none() {
                return None;
            }
            mem::take(&mut *latest)
        };
        let (plan, (step, state)) = (memory.plans().first()?, start?);
        Some(self.shown(step, &state, plan, &candidates))
    }

    fn shown(
        &mut self,
        step: u64,
        state: &EnvState,
        plan: &TracedPlan,
        candidates: &[(f64, Vec<f32>)],
    ) -> Shown {
        let cost = plan.result.as_ref().and_then(|result| result.cost);
        let expected = self.path("plan", cost, state, &plan.actions);
        let true_cost = expected.as_ref().and_then(|path| path.true_cost);
        let mut objects = self.paths.keypoints(state, &[]).unwrap_or_default();
        let objects = objects.pop().unwrap_or_default().into_iter().map(|keypoint| keypoint.name.to_string());
        let first = plan.iterations.first().map_or(&[][..], |iteration| &iteration.elites);
        let last = plan.iterations.last().map_or(&[][..], |iteration| &iteration.elites);
        let plans = candidates.iter().map(|(cost, actions)| ("candidate", *cost, actions));
        let plans = plans.chain(first.iter().map(|elite| ("first elite", elite.cost, &elite.actions)));
        let plans = plans.chain(last.iter().map(|elite| ("last elite", elite.cost, &elite.actions)));
        let started = Instant::now();
        let mut paths: Vec<Path> = Vec::new();
        for (of, cost, actions) in plans.take_while(|_| started.elapsed() < MAX_SIMULATED) {
            paths.extend(self.path(of, Some(cost), state, actions));
        }
        let costs = paths.iter().filter_map(|path| Some((path.cost?, path.true_cost?)));
        let (predicted, found): (Vec<f64>, Vec<f64>) = costs.unzip();
        paths.extend(expected);
        let records = plan.iterations.iter().map(|iteration| &iteration.record);
        Shown {
            kind: "plan",
            step,
            objects: objects.collect(),
            costs: records.map(|record| [record.best, record.elite_mean, record.sample_mean]).collect(),
            cost,
            true_cost,
            agreement: rank_correlation(&predicted, &found),
            paths,
        }
    }

    /// `None` where the simulation fails.
    fn path(
        &mut self,
        of: &'static str,
        cost: Option<f64>,
        state: &EnvState,
        actions: &[f32],
    ) -> Option<Path> {
        let keypoints = self.paths.keypoints(state, actions).ok()?;
        let count = keypoints.iter().map(Vec::len).min()?;
        let points = |object: usize| keypoints.iter().map(|keypoints| keypoints[object].at).collect();
        let objects = (0..count).map(points).collect();
        Some(Path {
            of,
            cost: cost.filter(|cost| cost.is_finite()),
            true_cost: self.paths.task_cost(),
            objects,
        })
    }
}

/// Tells a planner's state at the start of its plans.
pub(super) struct Starts(Arc<Mutex<Latest>>);

impl Starts {
    /// After the policy has acted.
    pub(super) fn note(&self, view: &View<'_>) -> Result<(), PolicyError> {
        let mut latest = lock(&self.0);
        if latest.is_new
            && latest.start.is_none()
            && let Some(row) = view.live().next().and_then(|row| view.row(row))
        {
            let mut state = EnvState::new();
            row.snapshot(&mut state)?;
            latest.start = Some((row.episode.step, state));
        }
        Ok(())
    }
}

struct Tracer(Arc<Mutex<Latest>>);

impl Trace for Tracer {
    fn begin(&mut self, solver: &'static str, problem: &Problem<'_>) {
        let mut latest = lock(&self.0);
        *latest = Latest { memory: Memory::new(ELITES), ..Latest::default() };
        latest.memory.begin(solver, problem);
    }

    fn iteration(&mut self, iteration: &Iteration<'_>) {
        let mut latest = lock(&self.0);
        if iteration.number == 0 {
            let stride = iteration.candidates.samples.div_ceil(CANDIDATES).max(1);
            let all = iteration.costs_of(0).iter().copied().zip(iteration.candidates_of(0));
            latest.candidates = all.step_by(stride).map(|(cost, plan)| (cost, plan.to_vec())).collect();
        }
        latest.memory.iteration(iteration);
    }

    fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
        let mut latest = lock(&self.0);
        latest.memory.end(problem, plan);
        latest.is_new = true;
    }
}
