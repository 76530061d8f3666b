//! The loop that all sampling solvers share: draw candidates, evaluate them, learn from the cheapest, repeat. How
//! candidates are drawn and what is learned from them is each solver's own ([`Sampler`]).

use std::mem::MaybeUninit;

use rayon::prelude::*;
use serde_json::{Map, Value as Json};
use swm_core::Space;

use crate::bounds::{box_bounds, clamp, fill_bounds};
use crate::cost::Cost;
use crate::error::PlanError;
use crate::sampling::{Noise, cheapest, count_non_finite, fill_normal};
use crate::solver::{Plan, PlanKey, Problem, Solver, SolverConfig};
use crate::trace::{Iteration, Trace};
use crate::workspace::Workspace;

/// What tells one sampling solver from another. Episodes never meet: all methods see one at a time, on any thread.
pub(crate) trait Sampler: SolverConfig {
    /// The bounds of one action; an error for actions of a kind that the solver does not know.
    fn bounds<'a>(&self, space: &'a Space) -> Result<(&'a [f64], &'a [f64]), PlanError> {
        box_bounds(Self::NAME, space)
    }

    /// The course of the search.
    fn search(&self) -> Search;

    /// Whether it can plan for `problem`, whose sizes are sound.
    fn check_problem(&self, _problem: &Problem<'_>) -> Result<(), PlanError> {
        Ok(())
    }

    /// What an episode carries from one iteration to the next, for plans of `problem`'s size.
    fn carried(&self, _problem: &Problem<'_>) -> Carried {
        Carried::default()
    }

    /// How many candidates iteration `iteration` has: at most [`Search::samples`].
    fn samples_in(&self, _iteration: usize) -> usize {
        self.search().samples
    }

    /// Before the first iteration. `mean` is the initial plan, `spread` is [`Search::sigma`], all carried numbers are 0.
    fn begin(&self, _episode: &mut Episode<'_>) {}

    /// Fills `candidates`, `[S, H, D]`. They are clipped afterwards, if the solver clips.
    fn draw(&self, episode: &mut Episode<'_>, candidates: &mut [f32]);

    /// Learns from `candidates`, `[S, H, D]`: `elites` are the cheapest of them, 1 or more, in ascending order of
    /// their `costs`, `[S]`, all finite.
    fn learn(&self, episode: &mut Episode<'_>, candidates: &[f32], costs: &[f64], elites: &[u32]);

    /// After the last iteration: makes `mean` the plan to return, and fills `memory` for the episode's next plan.
    fn end(&self, _episode: &mut Episode<'_>, _memory: &mut Vec<f64>) {}
}

/// The course of a search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    /// S: candidates per iteration, at most.
    pub(crate) samples: usize,
    /// How many iterations to make.
    pub(crate) iterations: usize,
    /// K: how many of the cheapest candidates to learn from.
    pub(crate) elites: usize,
    /// Spread at the start.
    pub(crate) sigma: f32,
    /// Whether candidates are clipped to the bounds of the actions.
    pub(crate) clip: bool,
    /// Whether the cheapest plan ever evaluated is returned if the final one costs more.
    pub(crate) return_best: bool,
}

/// How many numbers an episode carries from iteration to iteration.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Carried {
    pub(crate) floats: usize,
    pub(crate) doubles: usize,
    /// Numbers that hold nothing from call to call: room for matrices to be factorized in.
    pub(crate) stack: usize,
}

impl Carried {
    /// Not nothing, because slices are cut into chunks by these lengths.
    fn or_one(self) -> Self {
        let Self { floats, doubles, stack } = self;
        Self { floats: floats.max(1), doubles: doubles.max(1), stack: stack.max(1) }
    }
}

/// One episode in the search.
pub(crate) struct Episode<'a> {
    pub(crate) problem: &'a Problem<'a>,
    /// Its row in the problem.
    pub(crate) row: usize,
    /// Iteration, from 0.
    pub(crate) iteration: u32,
    /// `[H, D]`: where the search is; the plan to return in the end.
    pub(crate) mean: &'a mut [f32],
    /// `[H, D]`: how wide it is.
    pub(crate) spread: &'a mut [f32],
    /// What the solver carries from iteration to iteration.
    pub(crate) floats: &'a mut [f32],
    /// What the solver carries from iteration to iteration.
    pub(crate) doubles: &'a mut [f64],
    /// Scratch.
    pub(crate) stack: &'a mut [MaybeUninit<f64>],
}

impl Episode<'_> {
    pub(crate) fn key(&self) -> &PlanKey {
        &self.problem.keys[self.row]
    }

    /// Fills `candidates`, `[S, H, D]`: the mean itself, then mean + spread × noise.
    pub(crate) fn draw_around_mean(&self, candidates: &mut [f32], noise: &Noise) {
        let (first, others) = candidates.split_at_mut(self.mean.len());
        first.copy_from_slice(self.mean);
        let mut stream = noise.stream(self.key(), self.iteration);
        for candidate in others.chunks_exact_mut(self.mean.len()) {
            fill_normal(&mut stream, candidate);
            scale(candidate, self.mean, self.spread);
        }
    }
}

/// Turns `noise`, `[H, D]`, into mean + spread × noise.
pub(crate) fn scale(noise: &mut [f32], mean: &[f32], spread: &[f32]) {
    for ((value, mean), spread) in noise.iter_mut().zip(mean).zip(spread) {
        *value = mean + spread * *value;
    }
}

impl<S: Sampler> Solver for S {
    fn name(&self) -> &'static str {
        S::NAME
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.changed()
    }

    fn check(&self, space: &Space) -> Result<(), PlanError> {
        self.validate()?;
        self.bounds(space).map(|_| ())
    }

    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        run(self, problem, cost, workspace, trace, plan)
    }
}

fn run<S: Sampler>(
    sampler: &S,
    problem: &Problem<'_>,
    cost: &mut dyn Cost,
    workspace: &mut Workspace,
    trace: &mut dyn Trace,
    plan: &mut Plan,
) -> Result<(), PlanError> {
    sampler.validate()?;
    problem.check()?;
    let bounds = sampler.bounds(problem.action)?;
    let search = sampler.search();
    problem.check_samples(search.samples)?;
    sampler.check_problem(problem)?;
    let (rows, size) = (problem.keys.len(), problem.plan_size());
    let carried = sampler.carried(problem).or_one();
    let [candidates, low, high, best, floats] = workspace.floats.cut([
        rows * search.samples * size,
        size,
        size,
        if search.return_best { rows * size } else { 0 },
        rows * carried.floats,
    ]);
    let [costs, best_costs, doubles] =
        workspace.doubles.cut([rows * search.samples, rows, rows * carried.doubles]);
    let [order] = workspace.indices.cut([rows * search.samples]);
    let stack = workspace.stack.spare(rows * carried.stack);
    fill_bounds(bounds, search.clip, low, high);
    best_costs.fill(f64::INFINITY);
    plan.begin(problem, search.sigma);
    plan.iterations.fill(search.iterations as u32);
    trace.begin(S::NAME, problem);
    let Plan { actions, spread, elite_mean_last, non_finite, memory, .. } = plan;
    let mut rows = Rows { problem, means: actions, spreads: spread, carried, floats, doubles, stack };

    rows.episodes(0).for_each(|mut episode| {
        clamp(episode.mean, low, high);
        sampler.begin(&mut episode);
    });
    for iteration in 0..search.iterations {
        let samples = sampler.samples_in(iteration);
        let candidates = &mut candidates[..rows.count() * samples * size];
        let costs = &mut costs[..rows.count() * samples];
        let drawn = rows.episodes(iteration as u32).zip(candidates.par_chunks_exact_mut(samples * size));
        drawn.for_each(|(mut episode, candidates)| {
            sampler.draw(&mut episode, candidates);
            if search.clip {
                candidates.chunks_exact_mut(size).for_each(|candidate| clamp(candidate, low, high));
            }
        });
        cost.evaluate(&problem.candidates(candidates, samples), costs)?;
        screen(problem.keys, iteration, costs, non_finite)?;
        let evaluated = (
            rows.episodes(iteration as u32),
            candidates.par_chunks_exact(samples * size),
            costs.par_chunks_exact(samples),
            order.par_chunks_exact_mut(search.samples),
            &mut *elite_mean_last,
        );
        evaluated.into_par_iter().for_each(|(mut episode, candidates, costs, order, elite_mean)| {
            let elites = finite(costs, cheapest(costs, search.elites.min(samples), &mut order[..samples]));
            let sum: f64 = elites.iter().map(|&elite| costs[elite as usize]).sum();
            *elite_mean = sum / elites.len() as f64;
            sampler.learn(&mut episode, candidates, costs, elites);
        });
        if search.return_best {
            keep_best(candidates, costs, best, best_costs);
        }
        trace.iteration(&Iteration {
            number: iteration,
            keys: problem.keys,
            candidates: problem.candidates(candidates, samples),
            costs,
            elites: search.elites,
            mean: rows.means,
            spread: rows.spreads,
            gradient: &[],
        });
    }

    let ended = rows.episodes(search.iterations as u32).zip(memory);
    ended.for_each(|(mut episode, memory)| {
        sampler.end(&mut episode, memory);
        clamp(episode.mean, low, high);
    });
    cost.evaluate(&problem.candidates(&plan.actions, 1), &mut plan.cost_of_returned)?;
    for (cost, count) in plan.cost_of_returned.chunks_exact_mut(1).zip(&mut plan.non_finite) {
        *count += count_non_finite(cost);
    }
    if search.return_best {
        plan.replace_by_cheaper(best, best_costs);
    }
    trace.end(problem, plan);
    Ok(())
}

/// All episodes of a search.
struct Rows<'a> {
    problem: &'a Problem<'a>,
    means: &'a mut [f32],
    spreads: &'a mut [f32],
    carried: Carried,
    floats: &'a mut [f32],
    doubles: &'a mut [f64],
    stack: &'a mut [MaybeUninit<f64>],
}

impl Rows<'_> {
    fn count(&self) -> usize {
        self.problem.keys.len()
    }

    fn episodes(&mut self, iteration: u32) -> impl IndexedParallelIterator<Item = Episode<'_>> {
        let (problem, size) = (self.problem, self.problem.plan_size());
        let parts = (
            self.means.par_chunks_exact_mut(size),
            self.spreads.par_chunks_exact_mut(size),
            self.floats.par_chunks_exact_mut(self.carried.floats),
            self.doubles.par_chunks_exact_mut(self.carried.doubles),
            self.stack.par_chunks_exact_mut(self.carried.stack),
        );
        parts.into_par_iter().enumerate().map(move |(row, (mean, spread, floats, doubles, stack))| Episode {
            problem,
            row,
            iteration,
            mean,
            spread,
            floats,
            doubles,
            stack,
        })
    }
}

/// Counts costs that are not finite; an episode that has no other is an error.
fn screen(
    keys: &[PlanKey],
    iteration: usize,
    costs: &mut [f64],
    non_finite: &mut [u64],
) -> Result<(), PlanError> {
    let samples = costs.len() / keys.len().max(1);
    for ((costs, total), key) in costs.chunks_exact_mut(samples.max(1)).zip(non_finite).zip(keys) {
        let count = count_non_finite(costs);
        *total += count;
        if count == samples as u64 {
            let &PlanKey { episode, plan, .. } = key;
            return Err(PlanError::NoFiniteCost { episode, plan, iteration, samples });
        }
    }
    Ok(())
}

/// The elites (in ascending order of cost) whose cost is finite; there is at least one.
fn finite<'a>(costs: &[f64], elites: &'a [u32]) -> &'a [u32] {
    let count = elites.partition_point(|&elite| costs[elite as usize].is_finite());
    &elites[..count]
}

/// Remembers each episode's cheapest candidate, `[B, H, D]`, if it is cheaper than all before.
fn keep_best(candidates: &[f32], costs: &[f64], best: &mut [f32], best_costs: &mut [f64]) {
    let rows = best_costs.len().max(1);
    let (samples, size) = (costs.len() / rows, best.len() / rows);
    for (row, best_cost) in best_costs.iter_mut().enumerate() {
        let costs = &costs[row * samples..][..samples];
        for (sample, &cost) in costs.iter().enumerate() {
            if cost < *best_cost {
                *best_cost = cost;
                let candidate = &candidates[(row * samples + sample) * size..][..size];
                best[row * size..][..size].copy_from_slice(candidate);
            }
        }
    }
}
