//! A planner that keeps the simulator state at the start of each plan, so that plans can be simulated again.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use swm_core::env::PIXELS;
use swm_core::{Actions, EnvState, Field, Policy, PolicyError, View};
use swm_solvers::{Memory, Trace, planner_of};

/// A planner whose plans are kept with the simulator states they were made in. For a world of one environment.
pub struct Watched {
    policy: Box<dyn Policy>,
    session: Arc<Mutex<Session>>,
}

/// Everything that a watched planner has planned.
#[derive(Debug, Default)]
#[non_exhaustive]
pub struct Session {
    /// The plans.
    pub memory: Memory,
    /// The start of each plan.
    pub starts: Vec<PlanStart>,
}

/// The state in which a plan was made.
#[derive(Debug)]
#[non_exhaustive]
pub struct PlanStart {
    /// The step of the episode.
    pub step: u64,
    /// The state of the environment.
    pub state: EnvState,
    /// Its image, `[H, W, 3]`, if there are images.
    pub image: Option<Vec<u8>>,
    /// Seconds that planning took.
    pub wall_time_s: f64,
}

/// Lets the planner write into the session.
struct IntoSession(Arc<Mutex<Session>>);

impl Trace for IntoSession {
    fn begin(&mut self, solver: &'static str, problem: &swm_solvers::Problem<'_>) {
        lock(&self.0).memory.begin(solver, problem);
    }

    fn iteration(&mut self, iteration: &swm_solvers::Iteration<'_>) {
        lock(&self.0).memory.iteration(iteration);
    }

    fn end(&mut self, problem: &swm_solvers::Problem<'_>, plan: &swm_solvers::Plan) {
        lock(&self.0).memory.end(problem, plan);
    }
}

fn lock(session: &Mutex<Session>) -> MutexGuard<'_, Session> {
    session.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A session that the policy goes on writing while its owner reads.
pub type SharedSession = Arc<Mutex<Session>>;

impl Watched {
    /// Watches the planner of `policy`; of every iteration up to `elites` elites are kept. `trace` sees everything too.
    ///
    /// # Errors
    ///
    /// The policy, unchanged, if it does not plan.
    pub fn new(
        mut policy: Box<dyn Policy>,
        elites: usize,
        trace: impl Trace + 'static,
    ) -> Result<(Self, SharedSession), Box<dyn Policy>> {
        let Some(planner) = planner_of(policy.as_mut()) else { return Err(policy) };
        let session = Session { memory: Memory::new(elites), starts: Vec::new() };
        let session = Arc::new(Mutex::new(session));
        planner.set_trace((IntoSession(Arc::clone(&session)), trace));
        Ok((Self { policy, session: Arc::clone(&session) }, session))
    }
}

impl Policy for Watched {
    fn describe(&self) -> String {
        self.policy.describe()
    }

    fn fields(&self) -> Vec<Field> {
        self.policy.fields()
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        let started = Instant::now();
        self.policy.act(view, actions)?;
        let wall_time_s = started.elapsed().as_secs_f64();
        let mut session = lock(&self.session);
        if session.memory.plans().len() > session.starts.len()
            && let Some(row) = view.live().next().and_then(|row| view.row(row))
        {
            let mut state = EnvState::new();
            row.snapshot(&mut state)?;
            let image = row.row.get::<u8>(PIXELS).ok().map(<[u8]>::to_vec);
            session.starts.push(PlanStart { step: row.episode.step, state, image, wall_time_s });
        }
        Ok(())
    }
}
