//! The loop that all sampling solvers share: sample candidates, evaluate them, update from the cheapest, repeat. How
//! candidates are sampled and what is updated is the part of each solver ([`Sampler`]).

use std::mem::MaybeUninit;

use rayon::prelude::*;
use swm_core::Space;

use crate::bounds::{box_bounds, clamp, fill_bounds};
use crate::cost::{Cost, Outputs};
use crate::error::PlanError;
use crate::problem::{Plan, PlanKey, Problem};
use crate::sampling::{Noise, cheapest, count_non_finite, fill_normal};
use crate::settings::Validate;
use crate::solver::SolverConfig;
use crate::trace::{Iteration, Trace};
use crate::workspace::{Workspace, is_past};

/// What differs between sampling solvers. Episodes do not interact: all methods get one at a time, on any thread.
pub(crate) trait Sampler: Validate + Send + Sync + 'static {
    /// As [`SolverConfig::NAME`].
    const NAME: &'static str;
    /// As [`SolverConfig::SUMMARY`].
    const SUMMARY: &'static str;

    /// The bounds of one action; an error for action spaces that the solver does not support.
    fn bounds<'a>(&self, space: &'a Space) -> Result<(&'a [f64], &'a [f64]), PlanError> {
        box_bounds(<Self as Sampler>::NAME, space)
    }

    /// Sizes and options of the search.
    fn search(&self) -> Search;

    /// Whether it can plan for `problem`, whose sizes are sound.
    fn check_problem(&self, _problem: &Problem<'_>) -> Result<(), PlanError> {
        Ok(())
    }

    /// The state that an episode keeps from one iteration to the next, for plans of `problem`'s size.
    fn state_sizes(&self, _problem: &Problem<'_>) -> StateSizes {
        StateSizes::default()
    }

    /// How many candidates iteration `iteration` has: at most [`Search::samples`].
    fn samples_in(&self, _iteration: usize) -> usize {
        self.search().samples
    }

    /// Before the first iteration. `mean` is the initial plan, `std` is [`Search::sigma`], the kept state is 0.
    fn begin(&self, _episode: &mut Episode<'_>) {}

    /// Fills `candidates`, `[S, H, D]`. They are clipped afterwards, if the solver clips.
    fn sample(&self, episode: &mut Episode<'_>, candidates: &mut [f32]);

    /// Updates the search distribution from `candidates`, `[S, H, D]`: `elites` are the cheapest of them, 1 or more, in
    /// ascending order of their `costs`, `[S]`, all finite.
    fn update(&self, episode: &mut Episode<'_>, candidates: &[f32], costs: &[f64], elites: &[u32]);

    /// After the last iteration: makes `mean` the plan to return, and fills `memory` for the episode's next plan.
    fn end(&self, _episode: &mut Episode<'_>, _memory: &mut Vec<f64>) {}
}

/// Sizes and options of a search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    /// S: candidates per iteration, at most.
    pub(crate) samples: usize,
    /// How many iterations to make.
    pub(crate) iterations: usize,
    /// K: how many of the cheapest candidates the update uses.
    pub(crate) elites: usize,
    /// Standard deviation at the start.
    pub(crate) sigma: f32,
    /// Whether candidates are clipped to the bounds of the actions.
    pub(crate) clip: bool,
    /// Whether the cheapest plan ever evaluated is returned if the final one costs more.
    pub(crate) return_best: bool,
}

/// Lengths of the state that an episode keeps from iteration to iteration.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StateSizes {
    pub(crate) floats: usize,
    pub(crate) doubles: usize,
    /// Scratch for the factorization of matrices; not kept.
    pub(crate) stack: usize,
}

impl StateSizes {
    /// At least 1 each, because slices are cut into chunks of these lengths.
    fn or_one(self) -> Self {
        let Self { floats, doubles, stack } = self;
        Self { floats: floats.max(1), doubles: doubles.max(1), stack: stack.max(1) }
    }
}

/// One episode in the search.
pub(crate) struct Episode<'a> {
    pub(crate) problem: &'a Problem<'a>,
    /// Its index in the problem.
    pub(crate) index: usize,
    /// Iteration, from 0.
    pub(crate) iteration: u32,
    /// `[H, D]`: mean of the search distribution; the plan to return in the end.
    pub(crate) mean: &'a mut [f32],
    /// `[H, D]`: its standard deviation.
    pub(crate) std: &'a mut [f32],
    /// State that the solver keeps from iteration to iteration.
    pub(crate) floats: &'a mut [f32],
    /// State that the solver keeps from iteration to iteration.
    pub(crate) doubles: &'a mut [f64],
    /// Scratch.
    pub(crate) stack: &'a mut [MaybeUninit<f64>],
}

impl Episode<'_> {
    pub(crate) fn key(&self) -> &PlanKey {
        &self.problem.keys[self.index]
    }

    /// Fills `candidates`, `[S, H, D]`: the mean itself, then mean + std × noise.
    pub(crate) fn sample_around_mean(&self, candidates: &mut [f32], noise: &Noise) {
        let (first, others) = candidates.split_at_mut(self.mean.len());
        first.copy_from_slice(self.mean);
        let mut stream = noise.stream(self.key(), self.iteration);
        for candidate in others.chunks_exact_mut(self.mean.len()) {
            fill_normal(&mut stream, candidate);
            scale(candidate, self.mean, self.std);
        }
    }
}

/// Turns `noise`, `[H, D]`, into mean + std × noise.
pub(crate) fn scale(noise: &mut [f32], mean: &[f32], std: &[f32]) {
    for ((value, mean), std) in noise.iter_mut().zip(mean).zip(std) {
        *value = mean + std * *value;
    }
}

impl<S: Sampler> SolverConfig for S {
    const NAME: &'static str = <S as Sampler>::NAME;
    const SUMMARY: &'static str = <S as Sampler>::SUMMARY;

    fn check_space(&self, space: &Space) -> Result<(), PlanError> {
        self.bounds(space).map(|_| ())
    }

    fn solve_checked(
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
    let bounds = sampler.bounds(problem.action)?;
    let search = sampler.search();
    let deadline = workspace.deadline;
    problem.check_samples(search.samples)?;
    sampler.check_problem(problem)?;
    let (count, size) = (problem.keys.len(), problem.plan_size());
    let sizes = sampler.state_sizes(problem).or_one();
    let [candidates, low, high, best, floats] = workspace.floats.cut([
        count * search.samples * size,
        size,
        size,
        if search.return_best { count * size } else { 0 },
        count * sizes.floats,
    ]);
    let [costs, best_costs, doubles] =
        workspace.doubles.cut([count * search.samples, count, count * sizes.doubles]);
    let [order] = workspace.indices.cut([count * search.samples]);
    let stack = workspace.stack.spare(count * sizes.stack);
    fill_bounds(bounds, search.clip, low, high);
    best_costs.fill(f64::INFINITY);
    plan.begin(problem, search.sigma);
    trace.begin(<S as Sampler>::NAME, problem);
    let Plan { actions, std, elite_mean_last, non_finite, memory, .. } = plan;
    let mut episodes = Episodes { problem, means: actions, stds: std, sizes, floats, doubles, stack };

    episodes.at(0).for_each(|mut episode| {
        clamp(episode.mean, low, high);
        sampler.begin(&mut episode);
    });
    let mut made = 0;
    for iteration in 0..search.iterations {
        let samples = sampler.samples_in(iteration);
        let candidates = &mut candidates[..count * samples * size];
        let costs = &mut costs[..count * samples];
        let sampled = episodes.at(iteration as u32).zip(candidates.par_chunks_exact_mut(samples * size));
        sampled.for_each(|(mut episode, candidates)| {
            sampler.sample(&mut episode, candidates);
            if search.clip {
                candidates.chunks_exact_mut(size).for_each(|candidate| clamp(candidate, low, high));
            }
        });
        cost.evaluate(&problem.candidates(candidates, samples), &mut Outputs::new(costs))?;
        screen(problem.keys, iteration, costs, non_finite)?;
        let evaluated = (
            episodes.at(iteration as u32),
            candidates.par_chunks_exact(samples * size),
            costs.par_chunks_exact(samples),
            order.par_chunks_exact_mut(search.samples),
            &mut *elite_mean_last,
        );
        evaluated.into_par_iter().for_each(|(mut episode, candidates, costs, order, elite_mean)| {
            let elites = finite(costs, cheapest(costs, search.elites.min(samples), &mut order[..samples]));
            let sum: f64 = elites.iter().map(|&elite| costs[elite as usize]).sum();
            *elite_mean = sum / elites.len() as f64;
            sampler.update(&mut episode, candidates, costs, elites);
        });
        if search.return_best {
            keep_best(candidates, costs, best, best_costs);
        }
        let candidates = problem.candidates(candidates, samples);
        let done = Iteration::new(iteration, problem.keys, candidates, costs);
        trace.iteration(&done.with_distribution(search.elites, episodes.means, episodes.stds));
        made = iteration + 1;
        if is_past(deadline) {
            break;
        }
    }

    plan.iterations.fill(made as u32);
    let ended = episodes.at(made as u32).zip(memory);
    ended.for_each(|(mut episode, memory)| {
        sampler.end(&mut episode, memory);
        clamp(episode.mean, low, high);
    });
    plan.evaluate(problem, cost)?;
    if search.return_best {
        plan.replace_by_cheaper(best, best_costs);
    }
    trace.end(problem, plan);
    Ok(())
}

/// All episodes of a search.
struct Episodes<'a> {
    problem: &'a Problem<'a>,
    means: &'a mut [f32],
    stds: &'a mut [f32],
    sizes: StateSizes,
    floats: &'a mut [f32],
    doubles: &'a mut [f64],
    stack: &'a mut [MaybeUninit<f64>],
}

impl Episodes<'_> {
    fn at(&mut self, iteration: u32) -> impl IndexedParallelIterator<Item = Episode<'_>> {
        let (problem, size) = (self.problem, self.problem.plan_size());
        let parts = (
            self.means.par_chunks_exact_mut(size),
            self.stds.par_chunks_exact_mut(size),
            self.floats.par_chunks_exact_mut(self.sizes.floats),
            self.doubles.par_chunks_exact_mut(self.sizes.doubles),
            self.stack.par_chunks_exact_mut(self.sizes.stack),
        );
        parts.into_par_iter().enumerate().map(move |(index, (mean, std, floats, doubles, stack))| Episode {
            problem,
            index,
            iteration,
            mean,
            std,
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

/// Keeps each episode's cheapest candidate, `[B, H, D]`, if it is cheaper than all before.
fn keep_best(candidates: &[f32], costs: &[f64], best: &mut [f32], best_costs: &mut [f64]) {
    let episodes = best_costs.len().max(1);
    let (samples, size) = (costs.len() / episodes, best.len() / episodes);
    for (episode, best_cost) in best_costs.iter_mut().enumerate() {
        let costs = &costs[episode * samples..][..samples];
        for (sample, &cost) in costs.iter().enumerate() {
            if cost < *best_cost {
                *best_cost = cost;
                let candidate = &candidates[(episode * samples + sample) * size..][..size];
                best[episode * size..][..size].copy_from_slice(candidate);
            }
        }
    }
}
