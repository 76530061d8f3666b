//! A trace kept in memory, for plots and tests.

use super::records::{IterationRecord, PlanRecord, Records};
use super::{Iteration, Trace};
use crate::problem::{Plan, PlanKey, Problem};

/// Keeps every figure, and of each iteration the cheapest elites.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    keep: usize,
    records: Records,
    solver: &'static str,
    /// Index in `plans` of the first plan of the current solve.
    first: usize,
    plans: Vec<TracedPlan>,
}

/// One plan of one episode, with its iterations.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TracedPlan {
    /// Which plan of which episode.
    pub key: PlanKey,
    /// The solver's name.
    pub solver: &'static str,
    /// H and D.
    pub shape: [usize; 2],
    /// Its iterations, in order.
    pub iterations: Vec<TracedIteration>,
    /// Its result; `None` if the solve failed.
    pub result: Option<PlanRecord>,
    /// `[H, D]`: the plan; empty if the solve failed.
    pub actions: Vec<f32>,
}

/// One iteration of one plan.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TracedIteration {
    /// Its figures.
    pub record: IterationRecord,
    /// The cheapest elites, cheapest first; of solvers without elites, the cheapest candidates.
    pub elites: Vec<Elite>,
    /// `[H, D]`: the new mean; empty for solvers without one.
    pub mean: Vec<f32>,
}

/// One of the best candidates of an iteration.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Elite {
    /// What it cost.
    pub cost: f64,
    /// `[H, D]`.
    pub actions: Vec<f32>,
}

impl Memory {
    /// Keeps up to `elites` elites of every iteration.
    pub fn new(elites: usize) -> Self {
        Self { keep: elites, ..Self::default() }
    }

    /// Every plan seen so far, in the order in which they were made.
    pub fn plans(&self) -> &[TracedPlan] {
        &self.plans
    }
}

impl Trace for Memory {
    fn begin(&mut self, solver: &'static str, problem: &Problem<'_>) {
        self.records.begin(problem);
        self.solver = solver;
        self.first = self.plans.len();
        let shape = [problem.horizon, problem.dim()];
        self.plans.extend(problem.keys.iter().map(|&key| TracedPlan {
            key,
            solver,
            shape,
            iterations: Vec::new(),
            result: None,
            actions: Vec::new(),
        }));
    }

    fn iteration(&mut self, iteration: &Iteration<'_>) {
        let samples = iteration.candidates.samples;
        let size = iteration.candidates.horizon * iteration.candidates.dim;
        let records = self.records.of(iteration);
        for ((episode, record), plan) in records.into_iter().enumerate().zip(&mut self.plans[self.first..]) {
            let elites = if iteration.elites == 0 { self.keep } else { iteration.elites };
            let ranked = Iteration { elites, ..*iteration }.elites_of(episode);
            let elite = |&index: &u32| Elite {
                cost: iteration.costs_of(episode)[index as usize],
                actions: iteration.candidates.plan(episode * samples + index as usize).to_vec(),
            };
            plan.iterations.push(TracedIteration {
                record,
                elites: ranked.iter().take(self.keep).map(elite).collect(),
                mean: iteration.mean.chunks_exact(size.max(1)).nth(episode).unwrap_or_default().to_vec(),
            });
        }
    }

    fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
        let own = self.plans[self.first..].iter_mut().zip(problem.keys).enumerate();
        for (episode, (traced, key)) in own {
            traced.result = Some(PlanRecord::of(key, plan, episode));
            traced.actions = plan.of(episode).to_vec();
        }
    }
}
