//! Adam on the plan itself: steps of about one length, whatever the scale of the cost.
//!
//! Source: Kingma & Ba, *Adam: A Method for Stochastic Optimization* (2015).

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Space;
use swm_core::registry::Setting;

use crate::bounds::box_bounds;
use crate::cost::Cost;
use crate::descent::{Descent, Limits, Rule, Search, WeightDecay};
use crate::error::PlanError;
use crate::settings::{Joined, Settings, join};
use crate::solver::{Plan, Problem, Solver, SolverConfig};
use crate::trace::Trace;
use crate::workspace::Workspace;

/// Settings of Adam. The learning rate is that of the reference's published runs, the rest are the usual ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Adam {
    /// Starts, steps, noise, limits.
    #[serde(flatten)]
    pub descent: Descent,
    /// Whether plans are kept within the bounds of the actions. The reference does not.
    pub clip: bool,
    /// Length of a step, about.
    pub lr: f64,
    /// Memory of the mean of the gradients, from 0 to below 1.
    pub beta1: f64,
    /// Memory of the mean of their squares, from 0 to below 1.
    pub beta2: f64,
    /// Added to the root of that, against division by zero.
    pub eps: f64,
    /// Pull toward zero, part of the gradient.
    pub weight_decay: f64,
}

impl Default for Adam {
    fn default() -> Self {
        Self {
            descent: Descent::default(),
            clip: false,
            lr: 0.1,
            beta1: 0.9,
            beta2: 0.999,
            eps: 1e-8,
            weight_decay: 0.0,
        }
    }
}

impl Adam {
    fn rule(&self) -> Rule {
        Rule::Adam {
            lr: self.lr,
            betas: [self.beta1, self.beta2],
            eps: self.eps,
            weight_decay: WeightDecay::InGradient(self.weight_decay),
        }
    }
}

const OWN: &[Setting] = &[
    Setting { name: "clip", doc: "keep plans within the action bounds", default: "false" },
    Setting { name: "lr", doc: "length of a step, about", default: "0.1" },
    Setting { name: "beta1", doc: "memory of the mean of gradients", default: "0.9" },
    Setting { name: "beta2", doc: "memory of the mean of their squares", default: "0.999" },
    Setting { name: "eps", doc: "added to the root of that", default: "1e-8" },
    Setting { name: "weight_decay", doc: "pull toward zero", default: "0" },
];
const ALL: &Joined = &join(&[Descent::SETTINGS, OWN]);

impl Settings for Adam {
    const SETTINGS: &'static [Setting] = ALL.as_slice();

    fn validate(&self) -> Result<(), PlanError> {
        self.descent.validate()?;
        self.rule().validate()
    }
}

impl SolverConfig for Adam {
    const NAME: &'static str = "adam";
    const SUMMARY: &'static str = "Adam with restarts";
}

impl Solver for Adam {
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
