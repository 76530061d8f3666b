//! Iterative LQR: the problem is approximated around the present plan by linear dynamics and a quadratic cost, whose best
//! plan is known in closed form; a line search along it makes the next plan. Needs a [`crate::models::ControlModel`].
//!
//! Source: Tassa, Erez & Todorov, *Synthesis and stabilization of complex behaviors through online trajectory
//! optimization* (2012), for regularization and line search, with first derivatives of the dynamics only; bounds by holding
//! actions that push against theirs (after Tassa, Mansard & Todorov, *Control-limited differential dynamic programming*,
//! 2014).

use rayon::prelude::*;
use serde_json::{Map, Value as Json};
use swm_core::{Settings as _, Space};

use crate::bounds::{box_bounds, fill_bounds};
use crate::cost::Cost;
use crate::descent::{not_negative, positive, scatter};
use crate::error::PlanError;
use crate::models::check_width;
use crate::riccati::{Tile, Weights};
use crate::sampling::{Noise, count_non_finite};
use crate::settings::Validate;
use crate::solver::{Plan, PlanKey, Problem, Solver, SolverConfig, at_least_one};
use crate::trace::{Iteration, Trace};
use crate::workspace::Workspace;

swm_core::settings! {
    /// Settings of iterative LQR.
    pub struct Ilqr {
        /// Starts: the initial plan and random ones around it.
        ///
        /// More than one is for problems with several local minima.
        samples: usize = 1,
        /// Most improvements of each start.
        iterations: usize = 50,
        /// Standard deviation of the other starts around the initial plan.
        sigma: f64 = 1.0,
        /// Added to the curvature of the actions.
        ///
        /// It grows where a plan cannot be improved with it.
        regularization: f64 = 1e-6,
        /// A start ends when its cost improves by less than this fraction.
        tolerance: f64 = 1e-9,
        /// Clip plans to the action bounds.
        clip: bool = false,
        /// Seed of the starts, in addition to the episode's.
        seed: u32 = 0,
    }
}

/// More samples or iterations are a typing error.
const MAX_COUNT: usize = 10_000_000;

impl Validate for Ilqr {
    fn validate(&self) -> Result<(), PlanError> {
        at_least_one("samples", self.samples)?;
        for (name, value) in [("samples", self.samples), ("iterations", self.iterations)] {
            if value > MAX_COUNT {
                return Err(PlanError::setting(name, format!("{value} is more than {MAX_COUNT}")));
            }
        }
        not_negative("sigma", self.sigma)?;
        positive("regularization", self.regularization)?;
        not_negative("tolerance", self.tolerance)
    }
}

impl SolverConfig for Ilqr {
    const NAME: &'static str = "ilqr";
    const SUMMARY: &'static str = "iterative LQR: second-order planning on a model of states and steps";
    const NEEDS_CONTROL_MODEL: bool = true;
}

impl Solver for Ilqr {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.changed()
    }

    fn check(&self, space: &Space) -> Result<(), PlanError> {
        self.validate()?;
        box_bounds(Self::NAME, space).map(|_| ())
    }

    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        self.validate()?;
        problem.check()?;
        let bounds = box_bounds(Self::NAME, problem.action)?;
        problem.check_samples(self.samples)?;
        let (rows, size, samples) = (problem.keys.len(), problem.plan_size(), self.samples);
        let count = rows * samples;
        let model = cost.control().ok_or(PlanError::NoControlModel { solver: Self::NAME })?;
        let steps = check_width(model, &problem.candidates(&[], samples))?;
        let (w, a) = (model.state_width(), model.action_width());
        if a > Tile::MOST_ACTIONS {
            let reason = format!("actions of {a} numbers are more than {}", Tile::MOST_ACTIONS);
            return Err(PlanError::Space { solver: Self::NAME, reason });
        }
        let tiles = count.min(4 * rayon::current_num_threads()).max(1);
        let tile = Tile::scratch_size(steps, w, a);
        let [points, low, high] = workspace.floats.cut([count * size, size, size]);
        let [costs, weights, actions, scratch] =
            workspace.doubles.cut([count, count, count * size, tiles * tile]);
        let [done] = workspace.indices.cut([count]);
        fill_bounds(bounds, self.clip, low, high);
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        scatter(problem, (noise, self.sigma, samples), [low, high], points);
        actions.iter_mut().zip(&*points).for_each(|(action, &point)| *action = point.into());
        weights.fill(self.regularization);
        costs.fill(f64::NAN);
        plan.begin(problem, 0.0);
        trace.begin(Self::NAME, problem);

        let share = count.div_ceil(tiles).max(1);
        for iteration in 0..self.iterations {
            let model = cost.control().ok_or(PlanError::NoControlModel { solver: Self::NAME })?;
            let sequences = (
                scratch.par_chunks_exact_mut(tile),
                costs.par_chunks_mut(share),
                weights.par_chunks_mut(share),
                actions.par_chunks_mut(share * size),
                points.par_chunks_mut(share * size),
                done.par_chunks_mut(share),
            );
            let bounds = [&*low, &*high];
            sequences.into_par_iter().enumerate().for_each(
                |(part, (scratch, costs, weights, actions, points, done))| {
                    let sequences = costs.iter_mut().zip(weights).zip(actions.chunks_exact_mut(size));
                    let sequences = sequences.zip(points.chunks_exact_mut(size)).zip(done);
                    for (offset, ((((cost, weight), actions), points), done)) in sequences.enumerate() {
                        let row = (part * share + offset) / samples;
                        let tile = Tile::new(scratch, (model, row), (steps, w, a), bounds);
                        if *done == 0 {
                            *done = u32::from(!self.improve(tile, cost, weight, actions));
                            points.iter_mut().zip(&*actions).for_each(|(out, &value)| *out = value as f32);
                        }
                    }
                },
            );
            for (iterations, done) in plan.iterations.iter_mut().zip(done.chunks_exact(samples)) {
                *iterations += u32::from(done.contains(&0));
            }
            trace.iteration(&Iteration {
                number: iteration,
                keys: problem.keys,
                candidates: problem.candidates(points, samples),
                costs,
                elites: 0,
                mean: &[],
                spread: &[],
                gradient: &[],
            });
            if !done.contains(&0) {
                break;
            }
        }
        cost.evaluate(&problem.candidates(points, samples), costs)?;
        self.choose(problem, points, costs, plan)?;
        trace.end(problem, plan);
        Ok(())
    }
}

impl Ilqr {
    /// Improves one plan, `[T, A]`, once; whether to go on.
    fn improve(&self, mut tile: Tile<'_>, cost: &mut f64, weight: &mut f64, actions: &mut [f64]) -> bool {
        *cost = tile.roll_out(actions);
        if !cost.is_finite() {
            *cost = f64::INFINITY;
            return false;
        }
        tile.expand(actions);
        loop {
            if tile.solve_backward(actions, *weight)
                && let Some(better) = tile.search(actions, *cost)
            {
                let gain = *cost - better;
                *weight = (*weight / Weights::FACTOR).max(self.regularization);
                let enough = gain > self.tolerance * cost.abs();
                *cost = better;
                return enough;
            }
            *weight *= Weights::FACTOR;
            if *weight > Weights::LARGEST {
                return false;
            }
        }
    }

    /// Writes the cheapest plan of every episode to `plan`.
    fn choose(
        &self,
        problem: &Problem<'_>,
        points: &[f32],
        costs: &mut [f64],
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let (size, samples) = (problem.plan_size(), self.samples);
        for (row, costs) in costs.chunks_exact_mut(samples).enumerate() {
            plan.non_finite[row] += count_non_finite(costs);
            let best =
                (0..samples).fold(0, |best, index| if costs[index] < costs[best] { index } else { best });
            if costs[best].is_infinite() {
                let PlanKey { episode, plan, .. } = problem.keys[row];
                return Err(PlanError::NoFiniteCost { episode, plan, iteration: self.iterations, samples });
            }
            plan.actions[row * size..][..size]
                .copy_from_slice(&points[(row * samples + best) * size..][..size]);
            plan.cost_of_returned[row] = costs[best];
            plan.elite_mean_last[row] = costs[best];
        }
        Ok(())
    }
}
