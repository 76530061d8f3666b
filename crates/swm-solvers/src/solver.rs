//! What every solver takes and gives. The solvers themselves stand in `solvers/`.

use serde_json::{Map, Value as Json};
use swm_core::{Entry, EpisodeSeed, LiveEpisode, PolicyEntry, Setting, Space};

use crate::cost::{Candidates, Cost};
use crate::error::PlanError;
use crate::planners;
use crate::settings::Validate;
use crate::space::plan_width;
use crate::trace::Trace;
use crate::workspace::Workspace;

/// Searches for cheap plans. A solver is configuration and nothing else: `solve` is a pure function of the
/// problem and the cost, and the workspace only saves allocations.
pub trait Solver: Send + Sync {
    /// Its name in [`crate::SOLVERS`].
    fn name(&self) -> &'static str;

    /// Settings that differ from their defaults, for reports.
    fn changed_settings(&self) -> Map<String, Json>;

    /// Whether it can plan actions of `space`; also says what is wrong with its own settings.
    ///
    /// # Errors
    ///
    /// [`PlanError::Space`] for the space, [`PlanError::Setting`] for the settings.
    fn check(&self, space: &Space) -> Result<(), PlanError>;

    /// Plans for all episodes of `problem` and writes the result to `plan`, whose memory is reused.
    ///
    /// Each episode's result has the same bits whatever other episodes are solved with it and on however many
    /// threads. `trace` is shown every iteration; [`crate::NoTrace`] costs nothing.
    ///
    /// # Errors
    ///
    /// The problem has other sizes than it says, the cost lacks what the solver needs (gradients, constraints, single
    /// steps) or fails, or all candidates have a cost that is not finite.
    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError>;
}

/// What to plan: for each of B episodes H blocks of D = k × A numbers.
///
/// A counts the numbers that stand for one action in a plan: its elements, if they are real; one per category
/// (one-hot, or probabilities while a solver relaxes them) if they are integers.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// `[B]`: the episodes.
    pub keys: &'a [PlanKey],
    /// H.
    pub horizon: usize,
    /// k: actions per block.
    pub action_block: usize,
    /// What one action may be, in the units of the plan.
    pub action: &'a Space,
    /// `[B, H, D]`: where the search begins; zeros where nothing is known.
    pub initial: &'a [f32],
    /// `[B]`: what the solver left in [`Plan::memory`] at each episode's last plan; empty if nothing is remembered.
    pub memory: &'a [Vec<f64>],
}

impl Problem<'_> {
    /// D: numbers per block.
    pub fn width(&self) -> usize {
        self.action_block * plan_width(self.action)
    }

    /// H × D: numbers per plan.
    pub fn plan_size(&self) -> usize {
        self.horizon * self.width()
    }

    /// What the solver remembers of episode `row`: empty at its first plan.
    pub fn remembered(&self, row: usize) -> &[f64] {
        self.memory.get(row).map_or(&[], Vec::as_slice)
    }

    /// Candidates of this problem: `[B, samples, H, D]`.
    pub fn candidates<'c>(&self, actions: &'c [f32], samples: usize) -> Candidates<'c> {
        let (rows, horizon, width) = (self.keys.len(), self.horizon, self.width());
        Candidates { actions, rows, samples, horizon, width }
    }

    /// Refuses more candidates than can be meant.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`], with the most that there may be.
    pub fn check_samples(&self, samples: usize) -> Result<(), PlanError> {
        let numbers = self.initial.len().checked_mul(samples);
        if numbers.is_none_or(|numbers| numbers > MAX_NUMBERS) {
            let reason = format!(
                "{samples} plans of {} numbers for {} episodes are too many (at most {MAX_NUMBERS} numbers); use fewer \
                 samples or environments, or a shorter horizon",
                self.plan_size(),
                self.keys.len(),
            );
            return Err(PlanError::setting("samples", reason));
        }
        Ok(())
    }

    /// Checks the sizes.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: a horizon or block of 0; [`PlanError::Size`]: `initial` or `memory` has another
    /// length.
    pub fn check(&self) -> Result<(), PlanError> {
        at_least_one("horizon", self.horizon)?;
        at_least_one("action_block", self.action_block)?;
        let expected = self.keys.len() * self.plan_size();
        if self.initial.len() != expected {
            return Err(PlanError::Size { name: "initial", expected, found: self.initial.len() });
        }
        let (expected, found) = (self.keys.len(), self.memory.len());
        if found != 0 && found != expected {
            return Err(PlanError::Size { name: "memory", expected, found });
        }
        Ok(())
    }
}

pub(crate) fn at_least_one(name: &str, value: usize) -> Result<(), PlanError> {
    if value == 0 { Err(PlanError::setting(name, "0 is too small; use 1 or more")) } else { Ok(()) }
}

/// Candidates of one iteration may take 1 GiB.
const MAX_NUMBERS: usize = 1 << 28;

/// Which plan of which episode: the key of all noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlanKey {
    /// Index of the episode in its run, for messages; noise does not depend on it.
    pub episode: u64,
    /// Seed of the episode.
    pub seed: EpisodeSeed,
    /// How many plans the episode had before.
    pub plan: u64,
}

impl PlanKey {
    /// Plan number `plan` of a live episode.
    pub fn of(episode: LiveEpisode, plan: u64) -> Self {
        Self { episode: episode.index, seed: episode.seed, plan }
    }
}

/// Plans of B episodes, and what is known of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// `[B, H, D]`: the plans.
    pub actions: Vec<f32>,
    /// `[B, H, D]`: standard deviation of the final search distribution, for solvers that have one.
    pub spread: Vec<f32>,
    /// `[B]`: the cost of `actions` themselves, evaluated after the search (infinite if it was not finite).
    pub cost_of_returned: Vec<f64>,
    /// `[B]`: mean cost of the last iteration's elites, which were drawn around the previous mean: what the
    /// reference reports as cost. NaN without iterations. Solvers that have no elites write what the reference reports
    /// there, too: the cost of the returned plan, for integers that of the mixture which was rounded to it.
    pub elite_mean_last: Vec<f64>,
    /// `[B]`: how many evaluated costs were not finite.
    pub non_finite: Vec<u64>,
    /// `[B]`: how many iterations were made.
    pub iterations: Vec<u32>,
    /// `[B]`: the largest constraint value of the returned plan; negative infinity without constraints. A plan is
    /// feasible at 0 or less.
    pub violation: Vec<f64>,
    /// `[B]`: what the solver wants to know when it plans for the episode again. Who calls it keeps this with the
    /// episode, and forgets it with the episode.
    pub memory: Vec<Vec<f64>>,
}

impl Plan {
    /// An empty plan, to be filled by [`Solver::solve`].
    pub fn new() -> Self {
        Self::default()
    }

    /// The plan of episode `row`: `[H, D]`.
    pub fn row(&self, row: usize) -> &[f32] {
        let size = self.actions.len() / self.cost_of_returned.len().max(1);
        &self.actions[row * size..][..size]
    }

    /// Takes the plans `others`, `[B, H, D]`, that cost less. For solvers that remember the best they saw.
    pub fn replace_by_cheaper(&mut self, others: &[f32], costs: &[f64]) {
        let size = (self.actions.len() / costs.len().max(1)).max(1);
        let own = self.actions.chunks_exact_mut(size).zip(&mut self.cost_of_returned);
        for ((plan, cost), (other, &other_cost)) in own.zip(others.chunks_exact(size).zip(costs)) {
            if other_cost < *cost {
                plan.copy_from_slice(other);
                *cost = other_cost;
            }
        }
    }

    /// Sizes everything for `problem`. For solvers: plans start at the initial ones, costs are unknown.
    pub fn begin(&mut self, problem: &Problem<'_>, spread: f32) {
        let rows = problem.keys.len();
        refill(&mut self.spread, problem.initial.len(), spread);
        refill(&mut self.cost_of_returned, rows, f64::INFINITY);
        refill(&mut self.elite_mean_last, rows, f64::NAN);
        refill(&mut self.non_finite, rows, 0);
        refill(&mut self.iterations, rows, 0);
        refill(&mut self.violation, rows, f64::NEG_INFINITY);
        self.memory.resize_with(rows, Vec::new);
        self.memory.iter_mut().for_each(Vec::clear);
        self.actions.clear();
        self.actions.extend_from_slice(problem.initial);
    }
}

fn refill<T: Clone>(values: &mut Vec<T>, len: usize, value: T) {
    values.clear();
    values.resize(len, value);
}

/// A solver that the tables can list.
pub trait SolverConfig: Solver + Validate + 'static {
    /// Its name: `cem`.
    const NAME: &'static str;
    /// What it does, in one line.
    const SUMMARY: &'static str;
    /// Whether it plans on a [`crate::models::ControlModel`] only: not on the true simulator, whose state it cannot see.
    const NEEDS_CONTROL_MODEL: bool = false;
}

/// One solver of a table, such as [`crate::SOLVERS`].
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct SolverEntry {
    /// Its name: `cem`.
    pub name: &'static str,
    /// What it does, in one line.
    pub summary: &'static str,
    /// Its settings.
    pub settings: &'static [Setting],
    /// Former names of settings: `(old, new)`.
    pub renamed: &'static [(&'static str, &'static str)],
    /// The policy that plans with it on the true simulator.
    pub on_simulator: PolicyEntry,
    /// Whether that policy is of use: not for solvers that need a [`crate::models::ControlModel`].
    pub plans_on_simulator: bool,
    make: MakeSolver,
}

/// Makes a solver from settings by name.
pub type MakeSolver = fn(Map<String, Json>) -> Result<Box<dyn Solver>, PlanError>;

impl SolverEntry {
    /// The entry of `S`.
    pub const fn of<S: SolverConfig>() -> Self {
        Self {
            name: S::NAME,
            summary: S::SUMMARY,
            settings: S::SETTINGS,
            renamed: S::RENAMED,
            on_simulator: planners::on_simulator::<S>(),
            plans_on_simulator: !S::NEEDS_CONTROL_MODEL,
            make: |given| Ok(Box::new(S::from_settings(given)?)),
        }
    }

    /// Makes one from settings by name.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: unknown, of another type, or out of range.
    pub fn make(&self, given: Map<String, Json>) -> Result<Box<dyn Solver>, PlanError> {
        (self.make)(given)
    }
}

impl Entry for SolverEntry {
    const KIND: &'static str = "solver";
    const COMMAND: &'static str = "solvers";

    fn name(&self) -> &'static str {
        self.name
    }
}
