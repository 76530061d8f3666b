//! What can go wrong when planning.

use swm_core::settings::WrongSetting;
use swm_core::{BatchError, BoxError, EnvError, PolicyError};
use thiserror::Error;

/// A plan cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A setting is unknown, has a wrong type or a value out of range.
    #[error("setting `{name}`: {reason}")]
    Setting {
        /// Its name.
        name: String,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// The solver does not support this action space.
    #[error("{solver} cannot plan these actions: {reason}")]
    Space {
        /// Name of the solver.
        solver: &'static str,
        /// What it needs, and what it found.
        reason: String,
    },
    /// Part of the problem has the wrong size.
    #[error("planning problem: `{name}` must hold {expected} values, found {found}")]
    Size {
        /// Which part.
        name: &'static str,
        /// How many it must hold.
        expected: usize,
        /// How many it holds.
        found: usize,
    },
    /// Part of the problem has a value that is not finite.
    #[error(
        "planning problem: `{name}` has the value {value} at {index} (episode {episode}, block {block}); a search starts from finite \
         values, such as zeros"
    )]
    NotFinite {
        /// Which part.
        name: &'static str,
        /// The value.
        value: f32,
        /// Its position among all values.
        index: usize,
        /// The episode that it belongs to, counted from 0 in the problem.
        episode: usize,
        /// The block of the plan that it belongs to, counted from 0.
        block: usize,
    },
    /// Actions of another size than the model's.
    #[error(
        "actions of {found} values of a plan, where the model takes actions of {expected} (its `action_dim`); plan in an action space of \
         {expected}, and ask for several actions per block by `action_block`"
    )]
    ActionDim {
        /// A of the model.
        expected: usize,
        /// A of the action space.
        found: usize,
    },
    /// Blocks that are no actions of the model.
    #[error(
        "blocks of {block} values of a plan are no whole number of the model's actions, of {action} values each (its `action_dim`); plan \
         in an action space of {action}"
    )]
    BlockSize {
        /// D: values of a block.
        block: usize,
        /// A of the model.
        action: usize,
    },
    /// No candidate has a finite cost.
    #[error(
        "episode {episode}, plan {plan}, iteration {iteration}: all {samples} candidates have a cost that is not \
         finite; check the model, or search in a smaller range (sigma, clip)"
    )]
    NoFiniteCost {
        /// Index of the episode in its run.
        episode: u64,
        /// How many plans the episode had before.
        plan: u64,
        /// Iteration, from 0.
        iteration: usize,
        /// How many candidates there were.
        samples: usize,
    },
    /// The solver needs gradients and the cost has none.
    #[error(
        "{solver} needs a gradient of the cost, and this cost has none; use a cost with gradients, or a sampling \
         solver"
    )]
    NoGradient {
        /// Name of the solver.
        solver: &'static str,
    },
    /// The solver needs to see the problem step by step.
    #[error(
        "{solver} needs a model of states and steps (`ControlModel`), and this cost has none; use such a model, or \
         another solver"
    )]
    NoControlModel {
        /// Name of the solver.
        solver: &'static str,
    },
    /// The solver needs to step the model from any state.
    #[error(
        "{solver} needs a model that steps from any state to the next (`StateSteps`), and this cost has none; plan on a trained world \
         model, or use another solver"
    )]
    NoSteps {
        /// Name of the solver.
        solver: &'static str,
    },
    /// Planning on the true simulator needs a task cost.
    #[error(
        "`{env}` has no task cost, so there is nothing to plan for on its simulator; plan with a learned model"
    )]
    NoTaskCost {
        /// Environment id.
        env: String,
    },
    /// A planner made for one environment was asked to act in another.
    #[error("the planner simulates `{planner}` and cannot act in `{world}`; make one for that environment")]
    OtherEnv {
        /// The environment that the planner simulates.
        planner: String,
        /// The environment that asks for an action.
        world: String,
    },
    /// Planning on the true simulator where there is none.
    #[error(
        "the planner simulates `{planner}`, and these observations come from elsewhere than its environment; plan on a model"
    )]
    NoSimulator {
        /// The environment that the planner simulates.
        planner: String,
    },
    /// The run was asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// An environment failed while it was simulated.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// An observation has other columns than the cost reads.
    #[error(transparent)]
    Batch(#[from] BatchError),
    /// A cost failed in its own way: a model that cannot run.
    #[error("the cost of a plan cannot be computed: {0}")]
    Cost(BoxError),
}

impl PlanError {
    /// An error about setting `name`.
    pub fn setting(name: &str, reason: impl Into<String>) -> Self {
        PlanError::Setting { name: name.to_owned(), reason: reason.into() }
    }
}

impl From<WrongSetting> for PlanError {
    fn from(WrongSetting { name, reason }: WrongSetting) -> Self {
        PlanError::Setting { name, reason }
    }
}

impl PlanError {
    /// The error of a cost, whole, so that a driver finds its own error again by `downcast_ref`.
    pub fn foreign(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Cost(error) => Some(&**error),
            _ => None,
        }
    }
}

impl From<PlanError> for PolicyError {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Env(error) => PolicyError::Env(error),
            PlanError::Batch(error) => PolicyError::Batch(error),
            PlanError::Cancelled => PolicyError::Cancelled,
            error => PolicyError::Other(Box::new(error)),
        }
    }
}
