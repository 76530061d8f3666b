//! Models of the dynamics, and their costs.
//!
//! There are two kinds of model:
//!
//! * a [`ControlModel`] is known step by step: state, action, next state, cost. [`ControlCost`] makes it a cost with
//!   gradients and constraints, and iLQR plans on it. [`LinearQuadratic`], [`Navigation`] and [`DiscreteChain`] are
//!   such models, to test with and to learn from;
//! * [`Dynamics`] roll out whole batches of plans, as learned models do. [`ShootingCost`] joins them with an
//!   [`Objective`] (how far from the goal) and [`Constraint`]s (what must not happen).

mod control_cost;
mod differences;
mod discrete_chain;
mod dynamics;
mod linear_quadratic;
mod navigation;
mod objective;
mod outputs;
mod shooting;
mod single_steps;

pub use crate::control::{ControlModel, Stage};
pub use control_cost::ControlCost;
pub(crate) use control_cost::steps_of;
pub(crate) use differences::{Differentiator, symmetrize};
pub use discrete_chain::DiscreteChain;
pub use dynamics::{Dynamics, Part, Stepwise};
pub use linear_quadratic::LinearQuadratic;
pub use navigation::{Navigation, Obstacle, Obstacles};
pub use objective::{
    Constraint, ControlPenalty, GoalMse, KeepAway, Objective, Path, Reduction, Steps, WeightedSum,
};
pub use shooting::ShootingCost;
