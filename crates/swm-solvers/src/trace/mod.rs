//! Observing a solver. [`JsonLines`] writes its iterations to a file, [`Memory`] keeps them for plots and tests, and a
//! downstream crate can add its own [`Trace`].

mod json_lines;
mod memory;
mod paths;
mod records;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::problem::{Candidates, Plan, PlanKey, Problem};
use crate::sampling::cheapest;

pub use json_lines::{Detail, JsonLines};
pub use memory::{Elite, Memory, TracedIteration, TracedPlan};
pub use paths::{PlanPaths, stops_at_success};
pub use records::{IterationRecord, PlanRecord, Records};

/// Observes every iteration of every solve. It cannot change them.
pub trait Trace: Send {
    /// Whether it observes anything; where it does not, solvers compute nothing for it.
    fn is_on(&self) -> bool {
        true
    }

    /// A solve begins; the search starts at [`Problem::initial`].
    fn begin(&mut self, solver: &'static str, problem: &Problem<'_>);

    /// One iteration is over.
    fn iteration(&mut self, iteration: &Iteration<'_>);

    /// The solve is over.
    fn end(&mut self, problem: &Problem<'_>, plan: &Plan);
}

/// One iteration of one solve: all its episodes.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Iteration<'a> {
    /// Its number, from 0.
    pub number: usize,
    /// `[B]`: the episodes.
    pub keys: &'a [PlanKey],
    /// `[B, S, H, D]`: what was evaluated.
    pub candidates: Candidates<'a>,
    /// `[B, S]`: what it cost; infinite where the cost was not finite.
    pub costs: &'a [f64],
    /// K: how many of the cheapest candidates the solver used; 0 for solvers that have no elites.
    pub elites: usize,
    /// `[B, H, D]`: the mean of the search distribution after this iteration; empty for solvers without one.
    pub mean: &'a [f32],
    /// `[B, H, D]`: its standard deviation; empty for solvers without one.
    pub std: &'a [f32],
    /// `[B, S, H, D]`: derivative of the costs; empty for solvers that use none.
    pub gradient: &'a [f32],
}

impl<'a> Iteration<'a> {
    /// Iteration `number` of a solver without elites, distribution and gradient.
    pub fn new(number: usize, keys: &'a [PlanKey], candidates: Candidates<'a>, costs: &'a [f64]) -> Self {
        Self { number, keys, candidates, costs, elites: 0, mean: &[], std: &[], gradient: &[] }
    }

    /// The same, of a solver that samples from a distribution and uses the cheapest `elites` candidates; `mean` and `std`,
    /// `[B, H, D]`, are those after this iteration.
    #[must_use]
    pub fn with_distribution(self, elites: usize, mean: &'a [f32], std: &'a [f32]) -> Self {
        Self { elites, mean, std, ..self }
    }

    /// The same, of a solver that uses the derivative of the costs, `[B, S, H, D]`.
    #[must_use]
    pub fn with_gradient(self, gradient: &'a [f32]) -> Self {
        Self { gradient, ..self }
    }

    /// The costs of `episode`: `[S]`.
    pub fn costs_of(&self, episode: usize) -> &[f64] {
        let samples = self.candidates.samples;
        &self.costs[episode * samples..][..samples]
    }

    /// The candidates of `episode`, `[H, D]` each.
    pub fn candidates_of(&self, episode: usize) -> impl ExactSizeIterator<Item = &[f32]> {
        let samples = self.candidates.samples;
        (episode * samples..(episode + 1) * samples).map(|index| self.candidates.plan(index))
    }

    /// The elites of `episode`, cheapest first, as indices into its candidates.
    pub fn elites_of(&self, episode: usize) -> Vec<u32> {
        let samples = self.candidates.samples;
        let costs = self.costs_of(episode);
        let mut order = vec![0; samples];
        let elites = cheapest(costs, self.elites.min(samples), &mut order);
        elites.iter().copied().filter(|&elite| costs[elite as usize].is_finite()).collect()
    }
}

macro_rules! forward {
    () => {
        fn is_on(&self) -> bool {
            (**self).is_on()
        }
        fn begin(&mut self, solver: &'static str, problem: &Problem<'_>) {
            (**self).begin(solver, problem);
        }
        fn iteration(&mut self, iteration: &Iteration<'_>) {
            (**self).iteration(iteration);
        }
        fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
            (**self).end(problem, plan);
        }
    };
}

impl<T: Trace + ?Sized> Trace for &mut T {
    forward!();
}

impl<T: Trace + ?Sized> Trace for Box<T> {
    forward!();
}

/// Two traces of the same solves.
impl<A: Trace, B: Trace> Trace for (A, B) {
    fn is_on(&self) -> bool {
        self.0.is_on() || self.1.is_on()
    }

    fn begin(&mut self, solver: &'static str, problem: &Problem<'_>) {
        self.0.begin(solver, problem);
        self.1.begin(solver, problem);
    }

    fn iteration(&mut self, iteration: &Iteration<'_>) {
        self.0.iteration(iteration);
        self.1.iteration(iteration);
    }

    fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
        self.0.end(problem, plan);
        self.1.end(problem, plan);
    }
}

/// A trace that is read elsewhere while a policy owns it.
impl<T: Trace> Trace for Arc<Mutex<T>> {
    fn is_on(&self) -> bool {
        lock(self).is_on()
    }

    fn begin(&mut self, solver: &'static str, problem: &Problem<'_>) {
        lock(self).begin(solver, problem);
    }

    fn iteration(&mut self, iteration: &Iteration<'_>) {
        lock(self).iteration(iteration);
    }

    fn end(&mut self, problem: &Problem<'_>, plan: &Plan) {
        lock(self).end(problem, plan);
    }
}

/// A trace stays usable after a panic.
fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Observes nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoTrace;

impl Trace for NoTrace {
    fn is_on(&self) -> bool {
        false
    }

    fn begin(&mut self, _solver: &'static str, _problem: &Problem<'_>) {}

    fn iteration(&mut self, _iteration: &Iteration<'_>) {}

    fn end(&mut self, _problem: &Problem<'_>, _plan: &Plan) {}
}
