//! What plans lead to, and what that costs. No solver is known here.
//!
//! Two ways to write a problem down:
//!
//! * a [`ControlModel`] is known step by step: state, action, next state, cost. [`ControlCost`] makes a cost of it, with
//!   gradients and constraints, and iLQR plans on it. [`LinearQuadratic`], [`Navigation`] and [`DiscreteChain`] are
//!   such models, to test with and to learn from;
//! * [`Dynamics`] roll out whole batches of plans, as learned models do. [`ShootingCost`] joins them with an
//!   [`Objective`] (how far from the goal) and [`Constraint`]s (what must not happen).

mod control;
mod control_cost;
mod differences;
mod discrete_chain;
mod dynamics;
mod linear_quadratic;
mod navigation;
mod objective;
mod outputs;
mod shooting;

pub use control::{ControlModel, Stage};
pub use control_cost::ControlCost;
pub(crate) use control_cost::check_width;
pub(crate) use differences::Differentiator;
pub use discrete_chain::DiscreteChain;
pub use dynamics::{Dynamics, Part, Stepwise};
pub use linear_quadratic::LinearQuadratic;
pub use navigation::{Navigation, Obstacle, Obstacles};
pub use objective::{
    Constraint, ControlPenalty, GoalMse, KeepAway, Objective, Path, Reduction, Steps, WeightedSum,
};
pub use shooting::ShootingCost;
