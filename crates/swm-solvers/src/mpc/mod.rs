//! Model-predictive control: plan, carry out the first part of the plan, plan again. Which solver and which cost
//! is not known here.

mod actions;
mod config;
mod history;
mod moment;
mod policy;
mod report;
mod scale;

pub use actions::ActionMap;
pub use config::PlanConfig;
pub use history::HistoryView;
pub use moment::Moment;
pub use policy::MpcPolicy;
pub use report::Report;
pub use scale::ActionScale;
