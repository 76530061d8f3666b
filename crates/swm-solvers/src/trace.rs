//! Watching a solver work. What is kept of it, and in which form, is up to whoever watches.

use crate::cost::Candidates;
use crate::sampling::cheapest;
use crate::solver::{Plan, PlanKey, Problem};

/// Sees every iteration of every solve. It can change nothing.
pub trait Trace: Send {
    /// Whether it wants to see anything; a solver makes nothing only for a trace that does not.
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
pub struct Iteration<'a> {
    /// Its number, from 0.
    pub number: usize,
    /// `[B]`: the episodes.
    pub keys: &'a [PlanKey],
    /// `[B, S, H, D]`: what was evaluated.
    pub candidates: Candidates<'a>,
    /// `[B, S]`: what it cost; infinite where the cost was not finite.
    pub costs: &'a [f64],
    /// K: how many of the cheapest candidates the solver went on with; 0 for solvers that have no elites.
    pub elites: usize,
    /// `[B, H, D]`: the mean of the search distribution after this iteration; empty for solvers without one.
    pub mean: &'a [f32],
    /// `[B, H, D]`: its standard deviation; empty for solvers without one.
    pub spread: &'a [f32],
    /// `[B, S, H, D]`: derivative of the costs; empty for solvers that use none.
    pub gradient: &'a [f32],
}

impl Iteration<'_> {
    /// The elites of episode `row`, cheapest first, as indices into its candidates.
    pub fn elites_of(&self, row: usize) -> Vec<u32> {
        let samples = self.candidates.samples;
        let costs = &self.costs[row * samples..][..samples];
        let mut order = vec![0; samples];
        let elites = cheapest(costs, self.elites.min(samples), &mut order);
        elites.iter().copied().filter(|&elite| costs[elite as usize].is_finite()).collect()
    }
}

/// Sees nothing.
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
