//! Model-predictive control: plan, execute the first part of the plan, plan again.

mod config;
mod controller;
mod planner;
mod policy;
mod report;

pub use config::PlanConfig;
pub use controller::Mpc;
pub use policy::{MpcPolicy, planner_of};
pub use report::Report;
