//! What the domains of the DeepMind Control Suite share: episodes, control steps, rewards, random starts, factors, saved
//! states. No domain is known here.
//!
//! A domain is one file with one [`Domain`] table and its [`Task`]s; [`SuiteEnv`] is the environment over it.

mod domain;
mod effect;
mod env;
pub mod factors;
mod image;
pub(crate) mod learned;
mod models;
mod settings;
mod stage;
mod start;
mod sums;
mod tolerance;

pub use domain::{Domain, MakeEnv, MakeTask, START_COLUMNS, Task, TaskEntry, entry, make, unchanged};
pub(crate) use domain::{listed, planner};
pub use effect::{Control, Effect, set_color};
pub use env::SuiteEnv;
pub use models::{Origin, description, edit_in_place};
pub(crate) use stage::recall_touch;
pub use stage::{Place, Stage, Target};
pub use start::{direction, normal, randomize_joints, uniform, until_free_of_contacts};
pub use sums::{distance, mean};
pub use tolerance::{Falloff, GAUSSIAN, tolerance};
