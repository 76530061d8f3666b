//! A puck on an ice rink: an environment that lives outside of stable-worldmodel.
//!
//! The environment, its factors and its expert need `swm-core` and `swm-fov` only. The feature `cli` adds what needs the whole:
//! a solver, a world model, a data format, and the command line with all of them.

mod env;
mod expert;
mod factors;
#[cfg(feature = "cli")]
mod format;
#[cfg(feature = "cli")]
mod model;
mod image;
#[cfg(feature = "cli")]
mod solver;

use swm_core::{EnvEntry, Registry};

pub use env::Rink;
pub use factors::factors;
#[cfg(feature = "cli")]
pub use format::JSONL;
#[cfg(feature = "cli")]
pub use model::FITTED_MODEL;
#[cfg(feature = "cli")]
pub use solver::Shotgun;

/// `demo/IceRink-v0`.
pub const ICE_RINK: EnvEntry = EnvEntry {
    id: "demo/IceRink-v0",
    summary: "push a puck over ice until it lies on a mark; two-dimensional continuous actions",
    settings: &[],
    policies: &[expert::EXPERT],
    planner: None,
    make: |config| Ok(Box::new(Rink::new(config)?)),
};

/// Everything that this crate adds to others.
pub const ENVS: &[EnvEntry] = &[ICE_RINK];

/// The environments and policies of stable-worldmodel, and those of this crate.
#[cfg(feature = "cli")]
pub fn registry() -> Registry {
    swm::registry().with_envs(ENVS).with_policies(POLICIES)
}

/// The environments of this crate alone.
#[cfg(not(feature = "cli"))]
pub fn registry() -> Registry {
    Registry::new().with_envs(ENVS)
}

/// Policies that work on more than one environment: planning with our solver on the true dynamics of any, and planning with our
/// model, which is fitted to a dataset.
#[cfg(feature = "cli")]
pub const POLICIES: &[swm_core::PolicyEntry] =
    &[swm::solvers::SolverEntry::of::<Shotgun>().on_simulator, FITTED_MODEL];
