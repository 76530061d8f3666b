//! Model-predictive control: plan, execute the first part of the plan, plan again.

mod config;
mod policy;
mod report;

pub use config::PlanConfig;
pub use policy::{MpcPolicy, planner_of};
pub use report::Report;
