//! What is planned: the problem, its candidates, and the plans.

use swm_core::{EpisodeSeed, LiveEpisode, Space};

use crate::cost::Cost;
use crate::error::PlanError;
use crate::ranges::check_length;
use crate::sampling::count_non_finite;
use crate::space::plan_dim;

/// What to plan: for each of B episodes H blocks of D = k × A values.
///
/// A is the number of plan values of one action: its elements, if they are real; one per category
/// (one-hot, or probabilities while a solver relaxes them) if they are integers.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// `[B]`: the episodes; without any, the plan is empty.
    pub keys: &'a [PlanKey],
    /// H.
    pub horizon: usize,
    /// k: actions per block.
    pub action_block: usize,
    /// The action space, in the units of the plan.
    pub action: &'a Space,
    /// `[B, H, D]`: where the search begins; zeros where there is no warm start.
    pub initial: &'a [f32],
    /// `[B]`: what the solver left in [`Plan::memory`] at each episode's last plan; empty if there is none.
    pub memory: &'a [Vec<f64>],
}

impl Problem<'_> {
    /// D: values per block.
    pub fn dim(&self) -> usize {
        self.action_block * plan_dim(self.action)
    }

    /// H × D: values per plan.
    pub fn plan_size(&self) -> usize {
        self.horizon * self.dim()
    }

    /// What the solver stored at the last plan of `episode`: empty at its first.
    pub fn remembered(&self, episode: usize) -> &[f64] {
        self.memory.get(episode).map_or(&[], Vec::as_slice)
    }

    /// Candidates of this problem: `[B, samples, H, D]`.
    pub fn candidates<'c>(&self, actions: &'c [f32], samples: usize) -> Candidates<'c> {
        Candidates { actions, episodes: self.keys.len(), samples, horizon: self.horizon, dim: self.dim() }
    }

    /// Refuses more candidates than can be intended.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`], with the most that there may be.
    pub fn check_samples(&self, samples: usize) -> Result<(), PlanError> {
        let values = self.initial.len().checked_mul(samples);
        if values.is_none_or(|values| values > MAX_VALUES) {
            let reason = format!(
                "{samples} plans of {} values for {} episodes are too many (at most {MAX_VALUES} values); use fewer \
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
    /// [`PlanError::Setting`]: a horizon or block of 0, or more of them than can be intended; [`PlanError::Size`]: `initial` or `memory` has another
    /// length; [`PlanError::NotFinite`]: a value of `initial` is not finite.
    pub fn check(&self) -> Result<(), PlanError> {
        check_length("horizon", self.horizon)?;
        check_length("action_block", self.action_block)?;
        let sizes = [self.action_block, plan_dim(self.action), self.keys.len().max(1)];
        let all = sizes.iter().try_fold(self.horizon, |product, &size| product.checked_mul(size));
        if all.is_none_or(|all| all > MAX_VALUES) {
            let reason = format!(
                "{} plans of {} blocks of {} actions are too many (at most {MAX_VALUES} values); use fewer episodes, or a shorter horizon",
                self.keys.len(),
                self.horizon,
                self.action_block
            );
            return Err(PlanError::setting("horizon", reason));
        }
        let expected = self.keys.len() * self.plan_size();
        if self.initial.len() != expected {
            return Err(PlanError::Size { name: "initial", expected, found: self.initial.len() });
        }
        let (expected, found) = (self.keys.len(), self.memory.len());
        if found != 0 && found != expected {
            return Err(PlanError::Size { name: "memory", expected, found });
        }
        if let Some(index) = self.initial.iter().position(|value| !value.is_finite()) {
            let (episode, block) = (index / self.plan_size(), index % self.plan_size() / self.dim());
            let value = self.initial[index];
            return Err(PlanError::NotFinite { name: "initial", value, index, episode, block });
        }
        Ok(())
    }
}

/// A batch of candidate plans: `[B, S, H, D]`, row-major.
#[derive(Clone, Copy, Debug)]
pub struct Candidates<'a> {
    /// The values.
    pub actions: &'a [f32],
    /// B.
    pub episodes: usize,
    /// S: candidates of each episode.
    pub samples: usize,
    /// H: blocks of each candidate.
    pub horizon: usize,
    /// D: values of each block.
    pub dim: usize,
}

impl<'a> Candidates<'a> {
    /// `[B, S, H, D]`.
    pub fn shape(&self) -> [usize; 4] {
        [self.episodes, self.samples, self.horizon, self.dim]
    }

    /// All plans, `[H, D]` each, in the order of the costs.
    pub fn plans(&self) -> std::slice::ChunksExact<'a, f32> {
        self.actions.chunks_exact(self.horizon * self.dim)
    }

    /// Plan `index` of `0..B × S`: `[H, D]`.
    pub fn plan(&self, index: usize) -> &'a [f32] {
        let size = self.horizon * self.dim;
        &self.actions[index * size..][..size]
    }
}

/// Candidates of one iteration may take 1 GiB.
const MAX_VALUES: usize = 1 << 28;

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
#[non_exhaustive]
pub struct Plan {
    /// `[B, H, D]`: the plans.
    pub actions: Vec<f32>,
    /// `[B, H, D]`: standard deviation of the final search distribution, for solvers that have one.
    pub std: Vec<f32>,
    /// `[B]`: the cost of `actions` themselves, evaluated after the search (infinite if it was not finite).
    pub cost_of_returned: Vec<f64>,
    /// `[B]`: mean cost of the last iteration's elites, which were sampled around the previous mean: what the
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
    /// `[B]`: the solver's state for the episode's next plan. The caller keeps it for the duration of the episode.
    pub memory: Vec<Vec<f64>>,
}

impl Plan {
    /// An empty plan, to be filled by [`Solver::solve`](crate::Solver::solve).
    pub fn new() -> Self {
        Self::default()
    }

    /// The plan of `episode`: `[H, D]`.
    pub fn of(&self, episode: usize) -> &[f32] {
        let size = self.actions.len() / self.cost_of_returned.len().max(1);
        &self.actions[episode * size..][..size]
    }

    /// Takes the plans `others`, `[B, H, D]`, that cost less.
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

    /// Evaluates the plans themselves.
    pub(crate) fn evaluate(&mut self, problem: &Problem<'_>, cost: &mut dyn Cost) -> Result<(), PlanError> {
        cost.evaluate(&problem.candidates(&self.actions, 1), &mut self.cost_of_returned)?;
        for (cost, count) in self.cost_of_returned.chunks_exact_mut(1).zip(&mut self.non_finite) {
            *count += count_non_finite(cost);
        }
        Ok(())
    }

    /// Sizes everything for `problem`. For solvers: plans start at the initial ones, costs are unknown.
    pub fn begin(&mut self, problem: &Problem<'_>, std: f32) {
        let episodes = problem.keys.len();
        refill(&mut self.std, problem.initial.len(), std);
        refill(&mut self.cost_of_returned, episodes, f64::INFINITY);
        refill(&mut self.elite_mean_last, episodes, f64::NAN);
        refill(&mut self.non_finite, episodes, 0);
        refill(&mut self.iterations, episodes, 0);
        refill(&mut self.violation, episodes, f64::NEG_INFINITY);
        self.memory.resize_with(episodes, Vec::new);
        self.memory.iter_mut().for_each(Vec::clear);
        self.actions.clear();
        self.actions.extend_from_slice(problem.initial);
    }
}

fn refill<T: Clone>(values: &mut Vec<T>, len: usize, value: T) {
    values.clear();
    values.resize(len, value);
}
