//! Replaying trajectories recorded from the reference (`tests/golden/README.md` has the schema of the files).
//!
//! Nothing here knows an environment, except the table of [`rules`]: which ids are meant, how far each quantity may
//! be off, and where we differ on purpose.

mod classic_control;
mod doors;
mod fetch;
mod file;
mod mazes;
mod own;
mod piecewise;
mod replay;
mod rules;
mod simple;
mod suite;

pub use file::GoldenFile;
pub use replay::{Comparison, Report, check_file};
pub use rules::{ImageTolerance, Rules, Tolerance, Unit, rules};
