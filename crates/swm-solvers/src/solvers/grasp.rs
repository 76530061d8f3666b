//! GRASP, the gradient relaxed stochastic planner: states between start and goal are variables beside the actions, so that all steps
//! of the model are taken at once, each from a state that may not be reached. Noise on the states explores, and every few iterations a
//! search over whole rollouts brings the actions back to what the model predicts.
//!
//! Source: Psenka, Rabbat, Krishnapriyan, LeCun & Bar, *Parallel Stochastic Gradient-Based Planning for World Models* (2026),
//! arXiv:2602.00475. Settings, schedules and both kinds of synchronization are those of pull request 183 of stable-worldmodel, the
//! defaults those of its `grasp.yaml`; starts beside the initial plan are not in it.
//!
//! With the states s₁ … s_{H-1}, the start s₀, the goal g = s_H, the blocks a and the model F, each iteration takes a step of Adam along
//!
//! ```text
//! L = Σₜ ‖F(sₜ, aₜ) − sₜ₊₁‖² + w Σₜ ‖F(sₜ, aₜ) − g‖²,   sₜ in F held fixed
//! ```
//!
//! The two terms in F are one: (1 + w) ‖F − m‖² with m = (sₜ₊₁ + w g) / (1 + w), up to what does not depend on F. The derivative by
//! sₜ₊₁ is that of the first term, 2 (sₜ₊₁ − F(sₜ, aₜ)).

use serde::{Deserialize, Serialize};

use crate::bounds::{box_bounds, clamp, fill_bounds};
use crate::cost::Cost;
use crate::descent::{Rule, WeightDecay, scatter};
use crate::error::PlanError;
use crate::lifted::Lifted;
use crate::problem::{Plan, Problem};
use crate::ranges::{at_least_one, check_counts, check_not_negative, check_positive};
use crate::sampling::{Noise, cheapest, count_non_finite};
use crate::settings::Validate;
use crate::solver::SolverConfig;
use crate::steps::StateSteps;
use crate::trace::{Iteration, Trace};
use crate::workspace::{Workspace, is_past};

/// How actions are brought back to what whole rollouts lead to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Sync {
    /// The cross-entropy method around the actions.
    Cem,
    /// Steps of Adam along the gradient of the cost.
    Gradient,
}

swm_core::settings! {
    /// Settings of GRASP; the defaults are those of its published configuration.
    pub struct Grasp {
        /// Starts: the initial plan and random ones around it.
        samples: usize = 1,
        /// Gradient steps on states and actions.
        iterations: usize = 300,
        /// Standard deviation of the other starts around the initial plan.
        sigma: f64 = 1.0,
        /// Learning rate of the states.
        lr_states: f64 = 0.1,
        /// Learning rate of the actions.
        lr: f64 = 0.001,
        /// Standard deviation of the noise on the states, right after a synchronization.
        noise: f64 = 0.1,
        /// The same right before the next one; in between it changes evenly.
        noise_last: f64 = 0.0,
        /// Weight of the distance of every predicted state from the goal, right after a synchronization.
        goal_weight: f64 = 2.0,
        /// The same right before the next one.
        goal_weight_last: f64 = 1.0,
        /// Iterations between synchronizations with whole rollouts; 0: none.
        sync_interval: usize = 30,
        /// How a synchronization searches: cem or gradient.
        sync: Sync = Sync::Cem => "cem",
        /// Iterations of a synchronization.
        sync_iterations: usize = 10,
        /// With sync=cem: candidate plans of each start.
        sync_samples: usize = 256,
        /// With sync=cem: how many of the cheapest candidates a refit uses (2 or more).
        sync_elites: usize = 25,
        /// With sync=cem: factor from the mean square by which a state left the line from start to goal to the variance of a block's actions.
        sync_scale: f64 = 1.0,
        /// With sync=cem: added to that variance.
        sync_variance: f64 = 0.01,
        /// With sync=gradient: learning rate.
        sync_lr: f64 = 0.01,
        /// Clip plans to the action bounds. The reference does not.
        clip: bool = false,
        /// Seed of starts and noise, in addition to the episode's.
        seed: u32 = 0,
    }
}

impl Validate for Grasp {
    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        for (name, value) in [
            ("sigma", self.sigma),
            ("noise", self.noise),
            ("noise_last", self.noise_last),
            ("goal_weight", self.goal_weight),
            ("goal_weight_last", self.goal_weight_last),
            ("sync_scale", self.sync_scale),
            ("sync_variance", self.sync_variance),
        ] {
            check_not_negative(name, value)?;
        }
        for (name, value) in [("lr", self.lr), ("lr_states", self.lr_states), ("sync_lr", self.sync_lr)] {
            check_positive(name, value)?;
        }
        at_least_one("sync_samples", self.sync_samples)?;
        if self.sync_elites < 2 || self.sync_elites > self.sync_samples {
            let reason = format!(
                "{} of {} samples; use 2 or more, and no more than there are",
                self.sync_elites, self.sync_samples
            );
            return Err(PlanError::setting("sync_elites", reason));
        }
        Ok(())
    }
}

/// Scratch of a synchronization by the cross-entropy method: `[M × samples]` plans and what they cost, `[H]` variances, an order.
struct Scratch<'w> {
    plans: &'w mut [f32],
    variances: &'w mut [f32],
    costs: &'w mut [f64],
    order: &'w mut [u32],
}

impl SolverConfig for Grasp {
    const NAME: &'static str = "grasp";
    const SUMMARY: &'static str = "gradient descent on states and actions together, with noise on the states";
    const NEEDS_STATES: bool = true;

    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let bounds = box_bounds(Self::NAME, problem.action)?;
        let in_sync = if self.syncs_by(Sync::Cem) { self.sync_samples } else { 0 };
        problem.check_samples(self.samples.saturating_mul(in_sync.max(1)))?;
        let deadline = workspace.deadline;
        let (episodes, samples, size) = (problem.keys.len(), self.samples, problem.plan_size());
        let width = steps_of(cost)?.state_dim();
        let (count, horizon) = (episodes * samples, problem.horizon);
        let (all, values, ends) = (count * size, count * horizon * width, episodes * width);
        let [of_blocks, of_states, of_ends, low, high, plans, variances] =
            workspace.floats.cut([4 * all, 6 * values, 2 * ends, size, size, all * in_sync, horizon]);
        let [losses, costs] = workspace.doubles.cut([count, count * in_sync]);
        let [stopped, order] = workspace.indices.cut([count, in_sync]);
        fill_bounds(bounds, self.clip, low, high);
        let shape = [samples, horizon, problem.dim(), width];
        let mut lifted = Lifted::new(shape, [of_blocks, of_states, of_ends], [low, high], losses, stopped);
        let noise = self.noise_of("grasp");
        scatter(problem, (noise, self.sigma, samples), [lifted.low, lifted.high], lifted.blocks);
        steps_of(cost)?.ends(lifted.starts, lifted.goals)?;
        let mut scratch = Scratch { plans, variances, costs, order };
        lifted.draw_lines();
        plan.begin(problem, 0.0);
        trace.begin(Self::NAME, problem);
        let (mut made, mut since_sync) = (0, 0);
        for iteration in 0..self.iterations {
            let [noise, goal_weight] = self.schedule(iteration);
            lifted.aim(goal_weight as f32);
            lifted.differentiate(steps_of(cost)?, problem, goal_weight)?;
            lifted.screen(problem, iteration, &mut plan.non_finite)?;
            let shown = Iteration::new(
                iteration,
                problem.keys,
                problem.candidates(lifted.blocks, samples),
                lifted.losses,
            );
            trace.iteration(&shown.with_gradient(lifted.gradient));
            since_sync += 1;
            lifted.step([adam(self.lr), adam(self.lr_states)], since_sync);
            if noise > 0.0 {
                lifted.shake(problem.keys, self.noise_of("grasp states"), iteration, noise as f32);
            }
            made = iteration + 1;
            if self.sync_interval > 0 && iteration > 0 && made.is_multiple_of(self.sync_interval) {
                match self.sync {
                    Sync::Cem => self.sync_by_cem(problem, cost, &mut lifted, &mut scratch, iteration)?,
                    Sync::Gradient => self.sync_by_gradient(problem, cost, &mut lifted)?,
                }
                lifted.forget();
                since_sync = 0;
            }
            if is_past(deadline) {
                break;
            }
        }
        plan.iterations.fill(made as u32);
        cost.evaluate(&problem.candidates(lifted.blocks, samples), lifted.losses)?;
        lifted.choose(problem, plan)?;
        trace.end(problem, plan);
        Ok(())
    }
}

/// The model's single steps; an error where the cost has none.
fn steps_of(cost: &mut dyn Cost) -> Result<&mut dyn StateSteps, PlanError> {
    cost.steps().ok_or(PlanError::NoSteps { solver: Grasp::NAME })
}

fn adam(lr: f64) -> Rule {
    Rule::Adam { lr, betas: [0.9, 0.999], eps: 1e-8, weight_decay: WeightDecay::InGradient(0.0) }
}

impl Grasp {
    fn noise_of(&self, purpose: &'static str) -> Noise {
        Noise { purpose, seed: self.seed }
    }

    fn syncs_by(&self, how: Sync) -> bool {
        self.sync_interval > 0 && self.sync == how
    }

    /// The noise and the goal's weight of an iteration.
    fn schedule(&self, iteration: usize) -> [f64; 2] {
        let phase = if self.sync_interval > 0 { self.sync_interval } else { self.iterations };
        let done = (iteration % phase) as f64 / phase.saturating_sub(1).max(1) as f64;
        let between = |first: f64, last: f64| first + (last - first) * done;
        [between(self.noise, self.noise_last), between(self.goal_weight, self.goal_weight_last)]
    }

    /// Refits each sequence's blocks to the cheapest of plans around them.
    fn sync_by_cem(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        lifted: &mut Lifted<'_>,
        scratch: &mut Scratch<'_>,
        iteration: usize,
    ) -> Result<(), PlanError> {
        let [samples, horizon, dim, _] = lifted.shape;
        let (size, tries) = (horizon * dim, self.sync_samples);
        let Scratch { plans, variances, costs, order } = scratch;
        let (noise, least) = (self.noise_of("grasp sync"), self.sync_variance as f32);
        // Variances of the first round are those of the states, of later ones those of the elites, which the plans still hold.
        for round in 0..self.sync_iterations {
            for index in 0..problem.keys.len() * samples {
                let own = &mut plans[index * tries * size..][..tries * size];
                if round == 0 {
                    lifted.states_off(index, [self.sync_scale as f32, least], variances);
                } else {
                    let elites = cheapest(&costs[index * tries..][..tries], self.sync_elites, order);
                    refit(own, elites, lifted.block_of(index), dim, least, variances);
                }
                let mean = &lifted.blocks[index * size..][..size];
                let (key, number) =
                    (&problem.keys[index / samples], iteration * self.sync_iterations + round);
                for (at, candidate) in own.chunks_exact_mut(size).enumerate() {
                    noise.fill(key, number as u32, (index % samples * tries + at) as u32, candidate);
                    for (at, (value, mean)) in candidate.iter_mut().zip(mean).enumerate() {
                        *value = mean + variances[at / dim].sqrt() * *value;
                    }
                    clamp(candidate, lifted.low, lifted.high);
                }
            }
            cost.evaluate(&problem.candidates(plans, samples * tries), costs)?;
            count_non_finite(costs);
        }
        for index in 0..problem.keys.len() * samples {
            let own = &plans[index * tries * size..][..tries * size];
            let costs = &costs[index * tries..][..tries];
            let elites = cheapest(costs, self.sync_elites, order);
            // Where the model fails on all of them, the blocks stay.
            if self.sync_iterations > 0 && costs[elites[elites.len() - 1] as usize].is_finite() {
                refit(own, elites, lifted.block_of(index), dim, least, variances);
            }
        }
        Ok(())
    }

    /// Steps of Adam along the gradient of whole rollouts.
    fn sync_by_gradient(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        lifted: &mut Lifted<'_>,
    ) -> Result<(), PlanError> {
        let cost = cost.differentiable().ok_or(PlanError::NoGradient { solver: Self::NAME })?;
        lifted.forget();
        for round in 0..self.sync_iterations {
            let candidates = problem.candidates(lifted.blocks, self.samples);
            cost.evaluate_with_gradient(&candidates, lifted.losses, lifted.gradient)?;
            lifted.step_blocks(adam(self.sync_lr), round + 1);
        }
        Ok(())
    }
}

/// The mean of the elites, `[H, D]`, and for each block the mean of their unbiased variances, plus `least`.
fn refit(plans: &[f32], elites: &[u32], mean: &mut [f32], dim: usize, least: f32, variances: &mut [f32]) {
    let (size, count) = (mean.len(), elites.len() as f32);
    let plans = || elites.iter().map(|&elite| &plans[elite as usize * size..][..size]);
    mean.fill(0.0);
    plans().for_each(|plan| mean.iter_mut().zip(plan).for_each(|(sum, value)| *sum += value / count));
    variances.fill(0.0);
    for plan in plans() {
        for (at, (value, mean)) in plan.iter().zip(&*mean).enumerate() {
            variances[at / dim] += (value - mean) * (value - mean);
        }
    }
    variances.iter_mut().for_each(|sum| *sum = *sum / ((count - 1.0) * dim as f32) + least);
}
