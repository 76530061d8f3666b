//! Projected gradient descent: after every step a plan is put back where plans may be. Real actions are clipped to
//! their bounds; the categories of integer actions are relaxed to probabilities, and rounded at the end.
//!
//! Source: the reference's `PGDSolver`, which knows single integers only and returns the rounding of the best relaxed
//! plan; here the rounded plans themselves are compared.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::{Settings as _, Space};

use crate::bounds::box_bounds;
use crate::cost::Cost;
use crate::descent::{Descent, Limits, Rule, Search};
use crate::error::PlanError;
use crate::sampling::count_non_finite;
use crate::settings::Validate;
use crate::solver::{Plan, Problem, Solver, SolverConfig};
use crate::space::{categories, largest};
use crate::trace::Trace;
use crate::workspace::Workspace;

swm_core::settings! {
    /// Settings of projected gradient descent.
    pub struct Pgd {
        ..descent: Descent,
        /// Learning rate; real actions need less than 1.
        ///
        /// The reference's 1 suits categories.
        lr: f64 = 1.0,
        /// Plans of integers are compared by their cost rounded or relaxed.
        select: Select = Select::Rounded => "rounded",
    }
}

/// By what relaxed plans of integers are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Select {
    /// By what they cost once they are rounded.
    #[default]
    Rounded,
    /// By what they cost before, as in the reference: the best mixture may round to a bad plan.
    Relaxed,
}

impl Validate for Pgd {
    fn validate(&self) -> Result<(), PlanError> {
        self.descent.validate()?;
        self.rule().validate()
    }
}

impl SolverConfig for Pgd {
    const NAME: &'static str = "pgd";
    const SUMMARY: &'static str = "projected gradient descent, for bounded real actions and for integers";
}

impl Solver for Pgd {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.changed()
    }

    fn check(&self, space: &Space) -> Result<(), PlanError> {
        self.validate()?;
        limits(space).map(|_| ())
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
        let limits = limits(problem.action)?;
        problem.check()?;
        let how = (&self.descent, self.rule(), limits);
        let mut search = Search::begin(Self::NAME, how, problem, workspace, 0)?;
        search.open(trace, plan);
        search.descend(cost, trace, plan)?;
        search.take_cheapest(plan);
        if let Limits::Simplex(space) = limits {
            match self.select {
                Select::Relaxed => {
                    round(space, &mut plan.actions);
                    evaluate(cost, problem, plan)?;
                }
                Select::Rounded => {
                    if self.descent.track_best {
                        // The best of all steps takes part as one more plan.
                        round(space, &mut plan.actions);
                        evaluate(cost, problem, plan)?;
                        search.best.copy_from_slice(&plan.actions);
                        search.best_costs.copy_from_slice(&plan.cost_of_returned);
                    }
                    round(space, search.points);
                    cost.evaluate(&problem.candidates(search.points, self.descent.samples), search.costs)?;
                    search.screen(self.descent.iterations, false, &mut plan.non_finite)?;
                    search.write_cheapest(plan);
                }
            }
        }
        trace.end(problem, plan);
        Ok(())
    }
}

impl Pgd {
    fn rule(&self) -> Rule {
        Rule::Sgd { lr: self.lr, momentum: 0.0, nesterov: false }
    }
}

fn limits(space: &Space) -> Result<Limits<'_>, PlanError> {
    match space {
        Space::Discrete { .. } | Space::MultiDiscrete { .. } => {
            let count = categories(space).count();
            match categories(space).position(|count| count == 0) {
                None if count > 0 => Ok(Limits::Simplex(space)),
                None => refuse("the action has no elements".to_owned()),
                Some(index) => refuse(format!("element {index} of the action has no categories")),
            }
        }
        space => Ok(Limits::Box { bounds: box_bounds(Pgd::NAME, space)?, clip: true }),
    }
}

fn refuse<T>(reason: String) -> Result<T, PlanError> {
    Err(PlanError::Space { solver: Pgd::NAME, reason })
}

/// Makes every group of categories one-hot.
fn round(space: &Space, plans: &mut [f32]) {
    let mut rest = plans;
    while !rest.is_empty() {
        for count in categories(space) {
            let (group, others) = rest.split_at_mut(count);
            let chosen = largest(group);
            group.fill(0.0);
            group[chosen] = 1.0;
            rest = others;
        }
    }
}

/// Evaluates the plans themselves.
fn evaluate(cost: &mut dyn Cost, problem: &Problem<'_>, plan: &mut Plan) -> Result<(), PlanError> {
    cost.evaluate(&problem.candidates(&plan.actions, 1), &mut plan.cost_of_returned)?;
    for (cost, count) in plan.cost_of_returned.chunks_exact_mut(1).zip(&mut plan.non_finite) {
        *count += count_non_finite(cost);
    }
    Ok(())
}
