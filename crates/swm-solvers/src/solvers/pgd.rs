//! Projected gradient descent: after every step a plan is projected onto the feasible set. Real actions are
//! clipped to their bounds; the categories of integer actions are relaxed to probabilities, and rounded at the end.
//!
//! Source: the reference's `PGDSolver`, which supports single integers only and returns the rounding of the best relaxed
//! plan; here the rounded plans themselves are compared.

use serde::{Deserialize, Serialize};
use swm_core::Space;

use crate::cost::{Cost, Outputs};
use crate::descent::{Descent, Limits, Rule, Search};
use crate::error::PlanError;
use crate::problem::{Plan, Problem};
use crate::settings::Validate;
use crate::solver::SolverConfig;
use crate::space::{check_categories, round};
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

/// How relaxed plans of integers are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Select {
    /// By their cost after rounding.
    #[default]
    Rounded,
    /// By their cost before rounding, as in the reference: the best mixture may round to a bad plan.
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

    fn check_space(&self, space: &Space) -> Result<(), PlanError> {
        limits(space).map(|_| ())
    }

    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let limits = limits(problem.action)?;
        let how = (&self.descent, self.rule(), limits);
        let mut search = Search::begin(Self::NAME, how, problem, workspace, 0)?;
        search.run(cost, trace, plan)?;
        if let Limits::Simplex(space) = limits {
            match self.select {
                Select::Relaxed => {
                    round(space, &mut plan.actions);
                    plan.evaluate(problem, cost)?;
                }
                Select::Rounded => {
                    if self.descent.track_best {
                        // The best of all steps takes part as one more plan.
                        round(space, &mut plan.actions);
                        plan.evaluate(problem, cost)?;
                        search.best.copy_from_slice(&plan.actions);
                        search.best_costs.copy_from_slice(&plan.cost_of_returned);
                    }
                    round(space, search.points);
                    let candidates = problem.candidates(search.points, self.descent.samples);
                    cost.evaluate(&candidates, &mut Outputs::new(search.costs))?;
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
            check_categories(Pgd::NAME, space)?;
            Ok(Limits::Simplex(space))
        }
        space => Limits::of_box(Pgd::NAME, space, true),
    }
}
