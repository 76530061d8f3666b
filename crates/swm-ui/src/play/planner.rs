//! What a planner thought: candidates and elites of its latest plan as paths over the image, their costs by iteration, and the
//! cost that the plan was given beside the true one.

use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;
use swm_core::error::BoxError;
use swm_core::{EnvConfig, EnvEntry, EnvState, Policy, PolicyArgs, PolicyError, Space, View};
use swm_solvers::{
    Iteration, Memory, Plan, PlanPaths, Problem, Trace, TracedPlan, planner_of, stops_at_success,
};

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
    /// Of the first iteration, `[H, D]` each, evenly chosen.
    candidates: Vec<Vec<f32>>,
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
    /// Candidates and elites first, the plan last.
    paths: Vec<Path>,
}

/// Where a plan leads: points of each object, as fractions of the image's width and height.
#[derive(Debug, Serialize)]
struct Path {
    of: &'static str,
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
    ) -> Result<Option<Self>, BoxError> {
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

    fn shown(&mut self, step: u64, state: &EnvState, plan: &TracedPlan, candidates: &[Vec<f32>]) -> Shown {
        let expected = self.path("plan", state, &plan.actions);
        let true_cost = self.paths.task_cost();
        let mut objects = self.paths.places(state, &[]).unwrap_or_default();
        let objects = objects.pop().unwrap_or_default().into_iter().map(|place| place.name.to_string());
        let first = plan.iterations.first().map_or(&[][..], |iteration| &iteration.elites);
        let last = plan.iterations.last().map_or(&[][..], |iteration| &iteration.elites);
        let plans = candidates.iter().map(|actions| ("candidate", actions));
        let plans = plans.chain(first.iter().map(|elite| ("first elite", &elite.actions)));
        let plans = plans.chain(last.iter().map(|elite| ("last elite", &elite.actions)));
        let started = Instant::now();
        let mut paths: Vec<Path> = Vec::new();
        for (of, actions) in plans.take_while(|_| started.elapsed() < MAX_SIMULATED) {
            paths.extend(self.path(of, state, actions));
        }
        paths.extend(expected);
        let records = plan.iterations.iter().map(|iteration| &iteration.record);
        Shown {
            kind: "plan",
            step,
            objects: objects.collect(),
            costs: records.map(|record| [record.best, record.elite_mean, record.sample_mean]).collect(),
            cost: plan.result.as_ref().and_then(|result| result.cost),
            true_cost,
            paths,
        }
    }

    /// `None` where the simulation fails, or nothing moves in the image.
    fn path(&mut self, of: &'static str, state: &EnvState, actions: &[f32]) -> Option<Path> {
        let places = self.paths.places(state, actions).ok()?;
        let count = places.iter().map(Vec::len).min()?;
        let points = |object: usize| places.iter().map(|places| places[object].at).collect();
        (count > 0).then(|| Path { of, objects: (0..count).map(points).collect() })
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
            latest.candidates = iteration.candidates_of(0).step_by(stride).map(<[f32]>::to_vec).collect();
        }
        latest.memory.iteration(iteration);
    }

    fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
        let mut latest = lock(&self.0);
        latest.memory.end(problem, plan);
        latest.is_new = true;
    }
}
