//! Trained models by name: the lines of the tables of policies and of world models.
//!
//! | file | duty |
//! |---|---|
//! | `table` | `mpc:RUN`, `policy:RUN` and their arguments |
//! | `models` | world models for `swm quality` |
//! | `arguments` | arguments that all of them share |
//! | `foreign` | published checkpoints in the place of runs |
//! | `canonical` | the setting `canonical` |
//! | `zoo` | `zoo:NAME`: models that are shipped |

mod arguments;
mod canonical;
mod foreign;
mod models;
mod table;
mod zoo;

pub use models::{MODELS, latent_model};
pub use table::POLICIES;
