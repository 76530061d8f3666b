//! Gradient descent on many plans at once: what its solvers share. Which rule, and what else a step does, is theirs.

mod rules;
mod search;
mod settings;
mod simplex;

pub(crate) use rules::{Rule, WeightDecay};
pub(crate) use search::{Limits, Search, scatter};
pub use settings::{Descent, GradClip};

/// Makes a solver of settings that have a `descent`, a `clip` and a `rule()`: all sequences follow the rule, within the action
/// bounds if they are clipped.
macro_rules! one_rule {
    ($Solver:ident, $name:literal, $summary:literal) => {
        impl $crate::settings::Validate for $Solver {
            fn validate(&self) -> Result<(), $crate::error::PlanError> {
                self.descent.validate()?;
                self.rule().validate()
            }
        }

        impl $crate::solver::SolverConfig for $Solver {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = $summary;

            fn solve_checked(
                &self,
                problem: &$crate::problem::Problem<'_>,
                cost: &mut dyn $crate::cost::Cost,
                workspace: &mut $crate::workspace::Workspace,
                trace: &mut dyn $crate::trace::Trace,
                plan: &mut $crate::problem::Plan,
            ) -> Result<(), $crate::error::PlanError> {
                use $crate::descent::{Limits, Search};

                let limits = Limits::of_box(Self::NAME, problem.action, self.clip)?;
                let how = (&self.descent, self.rule(), limits);
                Search::begin(Self::NAME, how, problem, workspace, 0)?.run(cost, trace, plan)?;
                trace.end(problem, plan);
                Ok(())
            }
        }
    };
}

pub(crate) use one_rule;
