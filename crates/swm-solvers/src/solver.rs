//! What every solver takes and gives. The solvers themselves are in `solvers/`.

use serde_json::{Map, Value as Json};
use swm_core::Space;

use crate::bounds::box_bounds;
use crate::cost::Cost;
use crate::error::PlanError;
use crate::problem::{Plan, Problem};
use crate::settings::Validate;
use crate::space::plan_dim;
use crate::trace::Trace;
use crate::workspace::Workspace;

/// Searches for cheap plans. A solver is configuration and nothing else: `solve` is a pure function of the
/// problem and the cost, and the workspace only saves allocations.
pub trait Solver: Send + Sync {
    /// Its name in [`crate::SOLVERS`].
    fn name(&self) -> &'static str;

    /// Settings that differ from their defaults, for reports.
    fn changed_settings(&self) -> Map<String, Json>;

    /// Whether it can plan actions of `space`; also says what is wrong with its own settings.
    ///
    /// # Errors
    ///
    /// [`PlanError::Space`] for the space, [`PlanError::Setting`] for the settings.
    fn check(&self, space: &Space) -> Result<(), PlanError>;

    /// Plans for all episodes of `problem` and writes the result to `plan`, whose memory is reused.
    ///
    /// Each episode's result has the same bits whatever other episodes are solved with it and on however many
    /// threads. `trace` is shown every iteration; [`crate::NoTrace`] costs nothing.
    ///
    /// # Errors
    ///
    /// The problem has other sizes than it says, the cost lacks what the solver needs (gradients, constraints, single
    /// steps) or fails, or all candidates have a cost that is not finite.
    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError>;
}

/// A solver as it is listed in tables: settings, and the search that they configure. It implements [`Solver`].
pub trait SolverConfig: Validate + Send + Sync + 'static {
    /// Its name: `cem`.
    const NAME: &'static str;
    /// What it does, in one line.
    const SUMMARY: &'static str;
    /// Whether it plans on a [`crate::models::ControlModel`] only: not on the true simulator, whose state it cannot see.
    const NEEDS_CONTROL_MODEL: bool = false;
    /// Whether it needs single steps of the model ([`crate::StateSteps`]): it does not plan on the true simulator, either.
    const NEEDS_STATES: bool = false;

    /// Whether it can plan actions of `space`: real ones, unless it says otherwise.
    ///
    /// # Errors
    ///
    /// [`PlanError::Space`].
    fn check_space(&self, space: &Space) -> Result<(), PlanError> {
        box_bounds(Self::NAME, space).map(|_| ())
    }

    /// As [`Solver::solve`], with settings, space and sizes of the problem already checked.
    ///
    /// # Errors
    ///
    /// As of [`Solver::solve`].
    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError>;
}

/// Refuses actions of another size than those of the model behind `cost`.
fn check_actions(problem: &Problem<'_>, cost: &dyn Cost) -> Result<(), PlanError> {
    let found = plan_dim(problem.action);
    match cost.action_dim() {
        Some(expected) if expected != found => Err(PlanError::ActionDim { expected, found }),
        _ => Ok(()),
    }
}

impl<S: SolverConfig> Solver for S {
    fn name(&self) -> &'static str {
        S::NAME
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.changed()
    }

    fn check(&self, space: &Space) -> Result<(), PlanError> {
        self.validate()?;
        self.check_space(space)
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
        self.check_space(problem.action)?;
        check_actions(problem, cost)?;
        self.solve_checked(problem, cost, workspace, trace, plan)
    }
}
