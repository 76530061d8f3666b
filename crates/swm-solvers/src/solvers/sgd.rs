//! Gradient descent on the plan itself, with optional momentum.
//!
//! Source: the reference's `GradientSolver` with its SGD; momentum as in Sutskever et al., *On the importance of
//! initialization and momentum in deep learning* (2013), in PyTorch's form.

use crate::cost::Cost;
use crate::descent::{Descent, Limits, Rule, Search};
use crate::error::PlanError;
use crate::problem::{Plan, Problem};
use crate::settings::Validate;
use crate::solver::SolverConfig;
use crate::trace::Trace;
use crate::workspace::Workspace;

swm_core::settings! {
    /// Settings of gradient descent.
    pub struct Sgd {
        ..descent: Descent,
        /// Clip plans to the action bounds. The reference does not.
        clip: bool = false,
        /// Learning rate.
        ///
        /// The reference's 1 makes most problems diverge; what is small enough depends on the curvature of the cost.
        lr: f64 = 0.01,
        /// Fraction of the last step that is added to the next.
        momentum: f64 = 0.0,
        /// Nesterov momentum.
        nesterov: bool = false,
    }
}

impl Sgd {
    fn rule(&self) -> Rule {
        Rule::Sgd { lr: self.lr, momentum: self.momentum, nesterov: self.nesterov }
    }
}

impl Validate for Sgd {
    fn validate(&self) -> Result<(), PlanError> {
        self.descent.validate()?;
        self.rule().validate()
    }
}

impl SolverConfig for Sgd {
    const NAME: &'static str = "sgd";
    const SUMMARY: &'static str = "gradient descent with restarts and momentum";

    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        workspace: &mut Workspace,
        trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        let how = (&self.descent, self.rule(), Limits::of_box(Self::NAME, problem.action, self.clip)?);
        Search::begin(Self::NAME, how, problem, workspace, 0)?.run(cost, trace, plan)?;
        trace.end(problem, plan);
        Ok(())
    }
}
