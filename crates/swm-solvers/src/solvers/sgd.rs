//! Gradient descent on the plan itself, with momentum if wanted.
//!
//! Source: the reference's `GradientSolver` with its SGD; momentum as in Sutskever et al., *On the importance of
//! initialization and momentum in deep learning* (2013), in the form of the usual deep-learning libraries.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Space;
use swm_core::registry::Setting;

use crate::bounds::box_bounds;
use crate::cost::Cost;
use crate::descent::{Descent, Limits, Rule, Search};
use crate::error::PlanError;
use crate::settings::{Joined, Settings, join};
use crate::solver::{Plan, Problem, Solver, SolverConfig};
use crate::trace::Trace;
use crate::workspace::Workspace;

/// Settings of gradient descent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Sgd {
    /// Starts, steps, noise, limits.
    #[serde(flatten)]
    pub descent: Descent,
    /// Whether plans are kept within the bounds of the actions. The reference does not.
    pub clip: bool,
    /// Length of a step, in units of the gradient. The reference's 1 makes most problems diverge; what is small enough
    /// depends on the curvature of the cost.
    pub lr: f64,
    /// Share of the last step that is added to the next.
    pub momentum: f64,
    /// Whether momentum looks ahead (Nesterov).
    pub nesterov: bool,
}

impl Default for Sgd {
    fn default() -> Self {
        Self { descent: Descent::default(), clip: false, lr: 0.01, momentum: 0.0, nesterov: false }
    }
}

impl Sgd {
    fn rule(&self) -> Rule {
        Rule::Sgd { lr: self.lr, momentum: self.momentum, nesterov: self.nesterov }
    }
}

const OWN: &[Setting] = &[
    Setting { name: "clip", doc: "keep plans within the action bounds", default: "false" },
    Setting { name: "lr", doc: "step per unit of gradient", default: "0.01" },
    Setting { name: "momentum", doc: "share of the last step in the next", default: "0" },
    Setting { name: "nesterov", doc: "look ahead with momentum", default: "false" },
];
const ALL: &Joined = &join(&[Descent::SETTINGS, OWN]);

impl Settings for Sgd {
    const SETTINGS: &'static [Setting] = ALL.as_slice();

    fn validate(&self) -> Result<(), PlanError> {
        self.descent.validate()?;
        self.rule().validate()
    }
}

impl SolverConfig for Sgd {
    const NAME: &'static str = "sgd";
    const SUMMARY: &'static str = "gradient descent with restarts and momentum";
}

impl Solver for Sgd {
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
        let limits = Limits::of_box(Self::NAME, problem.action, self.clip)?;
        let mut search =
            Search::begin(Self::NAME, (&self.descent, self.rule(), limits), problem, workspace, 0)?;
        search.open(trace, plan);
        search.descend(cost, trace, plan)?;
        search.take_cheapest(plan);
        trace.end(problem, plan);
        Ok(())
    }
}
