//! Registries: explicit tables of environments, policies, solvers, dataset formats and whatever else has a name. A
//! downstream crate adds its own with one line.
//!
//! | file | duty |
//! |---|---|
//! | `entry` | what every entry is; environments and settings |
//! | `absent` | what a build lacks, and which feature brings it |
//! | `policy` | policies, and what is asked of the models behind them |
//! | `arguments` | `name:key=value,…` |
//! | `context` | what a policy is made for |
//! | `described` | a policy whose description leaves out its settings |
//! | `store` | tables of several crates, merged |
//! | `trained` | the environment that a model was trained in, compared with another |
//! | `basic` | policies that fit every environment |

mod absent;
mod arguments;
mod basic;
mod context;
mod described;
mod entry;
mod policy;
mod store;
mod trained;

pub use crate::settings::Setting;
pub use absent::Absent;
pub(crate) use arguments::literal;
pub use arguments::{NoArgs, PolicyArgs};
pub use basic::BASIC_POLICIES;
pub use context::PolicyContext;
pub use entry::{Entry, EnvEntry, EnvTask, MakeEnv};
pub use policy::{FilesOf, ImageOf, MakePolicy, OnDataset, OracleOf, PolicyEntry, TrainedOf};
pub use store::Registry;
pub use trained::{FRAME_SKIP, TrainedIn, TrainedOn, TrainingDifference};
