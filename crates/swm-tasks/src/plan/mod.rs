//! Tracing a planner in one environment: its candidates, their simulated paths, its episodes; and a folder with figures of
//! them.
//!
//! [`Watched`] is a planner that keeps the state at the start of each plan; [`write_report`] renders what it has recorded.

mod costs;
mod elites;
mod figures;
mod page;
mod paths;
mod summary;
mod watched;

pub use figures::Report;
pub(crate) use figures::{Figures, PlanFigure, render_figures};
pub use page::write_report;
pub use summary::{EpisodeSummary, PlanFigures, PlanSummary};
pub use swm_solvers::planner_of;
pub use watched::{PlanStart, Session, SharedSession, Watched};
