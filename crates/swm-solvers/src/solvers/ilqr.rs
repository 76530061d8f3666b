//! Iterative LQR: the problem is approximated around the current plan by linear dynamics and a quadratic cost, whose
//! optimum has a closed form; a line search toward it gives the next plan. Needs a [`crate::models::ControlModel`].
//!
//! Source: Tassa, Erez & Todorov, *Synthesis and stabilization of complex behaviors through online trajectory
//! optimization* (2012), for regularization and line search, with first derivatives of the dynamics only; bounds by holding
//! actions that push against theirs (after Tassa, Mansard & Todorov, *Control-limited differential dynamic programming*,
//! 2014).

use rayon::prelude::*;

use crate::bounds::{box_bounds, fill_bounds};
use crate::cost::{Cost, Outputs};
use crate::descent::scatter;
use crate::error::PlanError;
use crate::models::steps_of;
use crate::problem::{Plan, Problem};
use crate::ranges::{check_counts, check_not_negative, check_positive};
use crate::riccati::{Regularization, Trajectory};
use crate::sampling::Noise;
use crate::settings::Validate;
use crate::solver::SolverConfig;
use crate::trace::{Iteration, Trace};
use crate::workspace::{Workspace, is_past};

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

impl Validate for Ilqr {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_not_negative("sigma", self.sigma)?;
        check_positive("regularization", self.regularization)?;
        check_not_negative("tolerance", self.tolerance)
    }
}

impl SolverConfig for Ilqr {
    const NAME: &'static str = "ilqr";
    const SUMMARY: &'static str = "iterative LQR: second-order planning on a model of states and steps";
    const NEEDS_CONTROL_MODEL: bool = true;

    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let bounds = box_bounds(Self::NAME, problem.action)?;
        problem.check_samples(self.samples)?;
        let deadline = workspace.deadline;
        let (episodes, size, samples) = (problem.keys.len(), problem.plan_size(), self.samples);
        let count = episodes * samples;
        let model = cost.control().ok_or(PlanError::NoControlModel { solver: Self::NAME })?;
        let steps = steps_of(model, &problem.candidates(&[], samples))?;
        let (w, a) = (model.state_dim(), model.action_dim());
        if a > Trajectory::MOST_ACTIONS {
            let reason = format!("actions of {a} values are more than {}", Trajectory::MOST_ACTIONS);
            return Err(PlanError::Space { solver: Self::NAME, reason });
        }
        let parts = count.min(4 * rayon::current_num_threads()).max(1);
        let scratch_size = Trajectory::scratch_size(steps, w, a);
        let [points, low, high] = workspace.floats.cut([count * size, size, size]);
        let [costs, weights, actions, scratch] =
            workspace.doubles.cut([count, count, count * size, parts * scratch_size]);
        let [done] = workspace.indices.cut([count]);
        fill_bounds(bounds, self.clip, low, high);
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        scatter(problem, (noise, self.sigma, samples), [low, high], points);
        actions.iter_mut().zip(&*points).for_each(|(action, &point)| *action = point.into());
        weights.fill(self.regularization);
        costs.fill(f64::NAN);
        plan.begin(problem, 0.0);
        trace.begin(Self::NAME, problem);

        let share = count.div_ceil(parts).max(1);
        for iteration in 0..self.iterations {
            let model = cost.control().ok_or(PlanError::NoControlModel { solver: Self::NAME })?;
            let sequences = (
                scratch.par_chunks_exact_mut(scratch_size),
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
                        let episode = (part * share + offset) / samples;
                        let trajectory = Trajectory::new(scratch, (model, episode), (steps, w, a), bounds);
                        if *done == 0 {
                            *done = u32::from(!self.improve(trajectory, cost, weight, actions));
                            points.iter_mut().zip(&*actions).for_each(|(out, &value)| *out = value as f32);
                        }
                    }
                },
            );
            for (iterations, done) in plan.iterations.iter_mut().zip(done.chunks_exact(samples)) {
                *iterations += u32::from(done.contains(&0));
            }
            let candidates = problem.candidates(points, samples);
            trace.iteration(&Iteration::new(iteration, problem.keys, candidates, costs));
            if !done.contains(&0) || is_past(deadline) {
                break;
            }
        }
        cost.evaluate(&problem.candidates(points, samples), &mut Outputs::new(costs))?;
        plan.take_cheapest(problem, points, costs, [samples, self.iterations])?;
        trace.end(problem, plan);
        Ok(())
    }
}

impl Ilqr {
    /// Improves one plan, `[T, A]`, once; whether to go on.
    fn improve(
        &self,
        mut trajectory: Trajectory<'_>,
        cost: &mut f64,
        weight: &mut f64,
        actions: &mut [f64],
    ) -> bool {
        *cost = trajectory.roll_out(actions);
        if !cost.is_finite() {
            *cost = f64::INFINITY;
            return false;
        }
        trajectory.expand(actions);
        loop {
            if trajectory.solve_backward(actions, *weight)
                && let Some(better) = trajectory.search(actions, *cost)
            {
                let gain = *cost - better;
                *weight = (*weight / Regularization::FACTOR).max(self.regularization);
                let enough = gain > self.tolerance * cost.abs();
                *cost = better;
                return enough;
            }
            *weight *= Regularization::FACTOR;
            if *weight > Regularization::LARGEST {
                return false;
            }
        }
    }
}
