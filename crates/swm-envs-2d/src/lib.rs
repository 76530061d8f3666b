//! Two-dimensional environments.
//!
//! Each environment is one module and one line in [`ENVS`]. It brings its physics, its drawing, its factors of
//! variation, its policies; rendering comes from `swm-render`. No solver, dataset or model is known here.

pub mod pusht;
mod settings;
pub mod tworoom_v1;

use swm_core::EnvEntry;

/// All environments of this crate.
pub const ENVS: &[EnvEntry] = &[pusht::PUSHT, pusht::PUSHT_DISCRETE, tworoom_v1::TWO_ROOM];
