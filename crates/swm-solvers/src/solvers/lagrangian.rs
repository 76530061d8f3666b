//! Augmented Lagrangian: gradient descent on the cost plus a penalty for violated constraints that grows every round.
//! Without constraints it is gradient descent whose optimizer restarts every round.
//!
//! Source: Nocedal & Wright, *Numerical Optimization* (2006), section 17.4; and the reference's `LagrangianSolver`, whose
//! form of the penalty is an option.

use serde::{Deserialize, Serialize};

use crate::cost::{Cost, Outputs, check_gradients};
use crate::descent::{Descent, Limits, Rule, Search, WeightDecay};
use crate::error::PlanError;
use crate::problem::{Plan, Problem};
use crate::ranges::{at_least_one, check_at_most, check_not_negative, check_positive};
use crate::settings::Validate;
use crate::solver::SolverConfig;
use crate::trace::Trace;
use crate::workspace::Workspace;

swm_core::settings! {
    /// Settings of the augmented Lagrangian method.
    pub struct Lagrangian {
        ..descent: Descent,
        /// Clip plans to the action bounds.
        clip: bool = false,
        /// Rounds of descent, after each of which multipliers and penalty grow.
        rounds: usize = 5,
        /// Optimizer of the descent: sgd, adam or adamw.
        optimizer: Optimizer = Optimizer::Adam => "adam",
        /// Learning rate.
        ///
        /// The reference's 1 is too long a step for most problems.
        lr: f64 = 0.1,
        /// Penalty of the first round.
        rho_init: f64 = 1.0,
        /// Factor of the penalty after a round.
        rho_scale: f64 = 2.0,
        /// Largest penalty.
        rho_max: f64 = 10000.0,
        /// Penalty of the penalty: standard, or the reference's.
        form: Penalty = Penalty::Standard => "standard",
        /// Keep multipliers for the episode's next plan.
        persist: bool = true,
        /// Largest constraint value with which a plan counts as feasible.
        tolerance: f64 = 0.001,
    }
}

/// Optimizer of the descent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Optimizer {
    /// As [`crate::Sgd`].
    Sgd,
    /// As [`crate::Adam`].
    #[default]
    Adam,
    /// As [`crate::AdamW`].
    Adamw,
}

/// Penalty of violations, given multipliers λ and ρ. Either way λ becomes max(0, λ + ρ g) after a round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Penalty {
    /// Σ (max(0, λ + ρ g)² - λ²) / 2ρ, with separate multipliers for every candidate.
    #[default]
    Standard,
    /// Σ λ g + ρ max(0, g)², with multipliers that the candidates of an episode share, by their mean g: the reference's.
    /// Slack still has a cost, and the multipliers grow more slowly than the penalty.
    Reference,
}

/// More rounds are a typing error.
const MAX_ROUNDS: usize = 10_000;

impl Validate for Lagrangian {
    fn validate(&self) -> Result<(), PlanError> {
        self.descent.validate()?;
        self.rule().validate()?;
        at_least_one("iterations", self.descent.iterations)?;
        at_least_one("rounds", self.rounds)?;
        check_at_most("rounds", self.rounds, MAX_ROUNDS)?;
        for (name, value) in
            [("rho_init", self.rho_init), ("rho_scale", self.rho_scale), ("rho_max", self.rho_max)]
        {
            check_positive(name, value)?;
        }
        check_not_negative("tolerance", self.tolerance)
    }
}

impl SolverConfig for Lagrangian {
    const NAME: &'static str = "lagrangian";
    const SUMMARY: &'static str = "augmented Lagrangian: gradient descent under constraints";

    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let limits = Limits::of_box(Self::NAME, problem.action, self.clip)?;
        check_gradients(cost, Self::NAME)?;
        let constraints = cost.constraints(problem.horizon, problem.dim());
        let (episodes, samples) = (problem.keys.len(), self.descent.samples);
        let all = (episodes * samples).checked_mul(constraints).filter(|&all| all <= MAX_VALUES);
        let all = all.ok_or_else(|| {
            let reason =
                format!("{constraints} constraints of {samples} plans of {episodes} episodes are too many");
            PlanError::setting("samples", reason)
        })?;
        let how = (&self.descent, self.rule(), limits);
        let mut search = Search::begin(Self::NAME, how, problem, workspace, 2 * all + episodes)?;
        let (multipliers, extra) = std::mem::take(&mut search.extra).split_at_mut(all);
        let (values, best_violations) = extra.split_at_mut(all);
        for episode in 0..episodes {
            let remembered = problem.remembered(episode);
            if self.persist && remembered.len() == constraints {
                let own = multipliers[episode * samples * constraints..][..samples * constraints]
                    .chunks_exact_mut(constraints.max(1));
                own.for_each(|multipliers| multipliers.copy_from_slice(remembered));
            }
        }
        let rho = self.rho_init;
        Run { settings: self, search, multipliers, values, best_violations, constraints, rho }
            .solve(problem, cost, trace, plan)
    }
}

/// Constraints and multipliers may take 1 GiB each.
const MAX_VALUES: usize = 1 << 27;

impl Lagrangian {
    fn rule(&self) -> Rule {
        let adam = |weight_decay| Rule::Adam { lr: self.lr, betas: [0.9, 0.999], eps: 1e-8, weight_decay };
        match self.optimizer {
            Optimizer::Sgd => Rule::Sgd { lr: self.lr, momentum: 0.0, nesterov: false },
            Optimizer::Adam => adam(WeightDecay::InGradient(0.0)),
            Optimizer::Adamw => adam(WeightDecay::Decoupled(0.01)),
        }
    }
}

/// A solve in progress.
struct Run<'a, 'w> {
    settings: &'a Lagrangian,
    search: Search<'a, 'w>,
    /// `[B, S, C]`: λ.
    multipliers: &'w mut [f64],
    /// `[B, S, C]`: g, where the sequences are.
    values: &'w mut [f64],
    /// `[B]`: the largest g of the best plans so far.
    best_violations: &'w mut [f64],
    /// C.
    constraints: usize,
    /// ρ.
    rho: f64,
}

impl Run<'_, '_> {
    fn solve(
        mut self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let Lagrangian { descent, rounds, rho_scale, rho_max, persist, .. } = self.settings;
        self.search.open(trace, plan);
        let mut made = 0;
        for round in 0..*rounds {
            self.search.restart();
            for step in 0..descent.iterations {
                let iteration = round * descent.iterations + step;
                self.evaluate(problem, cost, true)?;
                self.screen(iteration, true, plan)?;
                if descent.track_best {
                    self.remember(problem);
                }
                self.search.show(iteration, trace);
                self.search.step(step + 1, iteration);
                made = iteration + 1;
                if self.search.is_out_of_time() {
                    break;
                }
            }
            self.evaluate(problem, cost, false)?;
            self.screen(made, false, plan)?;
            self.raise_multipliers();
            self.rho = (self.rho * rho_scale).min(*rho_max);
            if self.search.is_out_of_time() {
                break;
            }
        }
        plan.iterations.fill(made as u32);
        let (size, count) = (problem.plan_size(), self.constraints);
        for (episode, actions) in plan.actions.chunks_exact_mut(size).enumerate() {
            let index = episode * descent.samples + self.cheapest_feasible(episode);
            let found = (self.search.costs[index], self.violation(index));
            let best = (self.search.best_costs[episode], self.best_violations[episode]);
            let (point, (cost, violation)) = if descent.track_best && self.is_better(best, found) {
                (&self.search.best[episode * size..][..size], best)
            } else {
                (&self.search.points[index * size..][..size], found)
            };
            actions.copy_from_slice(point);
            plan.cost_of_returned[episode] = cost;
            plan.elite_mean_last[episode] = cost;
            plan.violation[episode] = violation;
            if *persist {
                plan.memory[episode].extend_from_slice(&self.multipliers[index * count..][..count]);
            }
        }
        trace.end(problem, plan);
        Ok(())
    }

    /// Costs and constraints where the sequences are and, if wanted, the gradient of what is minimized.
    fn evaluate(
        &mut self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        with_gradient: bool,
    ) -> Result<(), PlanError> {
        let Self { settings, search, multipliers, values, constraints, rho, .. } = self;
        let (count, rho, form) = (*constraints, *rho, settings.form);
        let candidates = problem.candidates(search.points, settings.descent.samples);
        let multipliers = &**multipliers;
        let weights_of = |index: usize, values: &[f64], weights: &mut [f64]| {
            let multipliers = &multipliers[index * count..][..count];
            for ((weight, value), multiplier) in weights.iter_mut().zip(values).zip(multipliers) {
                *weight = match form {
                    Penalty::Standard => (multiplier + rho * value).max(0.0),
                    Penalty::Reference => multiplier + 2.0 * rho * value.max(0.0),
                };
            }
        };
        let outputs = &mut Outputs {
            gradient: with_gradient.then_some(&mut *search.gradient),
            constraints: (count > 0).then_some(&mut **values),
            weights: Some(&weights_of),
            ..Outputs::new(search.costs)
        };
        cost.evaluate(&candidates, outputs)
    }

    /// Stops sequences with a cost, constraint or gradient that is not finite.
    fn screen(&mut self, iteration: usize, with_gradient: bool, plan: &mut Plan) -> Result<(), PlanError> {
        let values = self.values.chunks_exact(self.constraints.max(1));
        for (cost, values) in self.search.costs.iter_mut().zip(values) {
            if values.iter().any(|value| !value.is_finite()) {
                *cost = f64::NAN;
            }
        }
        self.search.screen(iteration, with_gradient, &mut plan.non_finite)
    }

    /// λ becomes max(0, λ + ρ g); in the reference's form with the mean g of an episode's sequences.
    fn raise_multipliers(&mut self) {
        let (count, samples, rho) = (self.constraints, self.settings.descent.samples, self.rho);
        let size = (samples * count).max(1);
        let episodes = self.multipliers.chunks_exact_mut(size).zip(self.values.chunks_exact(size));
        for ((multipliers, values), costs) in episodes.zip(self.search.costs.chunks_exact(samples)) {
            for (index, multiplier) in multipliers.iter_mut().enumerate() {
                let value = match self.settings.form {
                    Penalty::Standard => values[index],
                    Penalty::Reference => mean_of(values, index % count, costs),
                };
                *multiplier = (*multiplier + rho * value).max(0.0);
            }
        }
    }

    /// The largest constraint of sequence `index`; negative infinity without any.
    fn violation(&self, index: usize) -> f64 {
        let values = &self.values[index * self.constraints..][..self.constraints];
        values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Of two plans with cost and violation, whether the first is better: of feasible ones the cheaper; a feasible one
    /// before others; of others the less violating.
    fn is_better(&self, (cost, violation): (f64, f64), (other_cost, other_violation): (f64, f64)) -> bool {
        let feasible = |violation: f64| violation <= self.settings.tolerance;
        match (cost.is_finite(), other_cost.is_finite()) {
            (true, true) => {}
            (usable, _) => return usable,
        }
        match (feasible(violation), feasible(other_violation)) {
            (true, true) => cost < other_cost,
            (false, false) => violation < other_violation,
            (feasible, _) => feasible,
        }
    }

    /// The best sequence of episode `episode`, the first of equals.
    fn cheapest_feasible(&self, episode: usize) -> usize {
        let samples = self.settings.descent.samples;
        let of = |sample: usize| {
            let index = episode * samples + sample;
            (self.search.costs[index], self.violation(index))
        };
        (0..samples).fold(0, |best, sample| if self.is_better(of(sample), of(best)) { sample } else { best })
    }

    /// Keeps the best plans so far.
    fn remember(&mut self, problem: &Problem<'_>) {
        let (size, samples) = (problem.plan_size(), self.settings.descent.samples);
        for episode in 0..problem.keys.len() {
            let index = episode * samples + self.cheapest_feasible(episode);
            let found = (self.search.costs[index], self.violation(index));
            if self.is_better(found, (self.search.best_costs[episode], self.best_violations[episode])) {
                (self.search.best_costs[episode], self.best_violations[episode]) = found;
                self.search.best[episode * size..][..size]
                    .copy_from_slice(&self.search.points[index * size..][..size]);
            }
        }
    }
}

/// The mean of constraint `constraint` of `values`, `[S, C]`, over the candidates of finite cost.
fn mean_of(values: &[f64], constraint: usize, costs: &[f64]) -> f64 {
    let candidates = values.chunks_exact(values.len() / costs.len()).zip(costs);
    let (mut sum, mut count) = (0.0, 0);
    for (values, _) in candidates.filter(|(_, cost)| cost.is_finite()) {
        sum += values[constraint];
        count += 1;
    }
    sum / f64::from(count)
}
