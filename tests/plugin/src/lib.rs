//! A puck on an ice rink: an environment that lives outside of stable-worldmodel.
//!
//! The environment, its factors and its expert need `swm-core`, `swm-fov` and, for images, `swm-render` only. The feature `cli` adds what needs the whole:
//! a solver, a world model, a data format, and the command line with all of them.

mod env;
mod expert;
mod factors;
#[cfg(feature = "cli")]
mod format;
#[cfg(feature = "cli")]
mod model;
#[cfg(feature = "cli")]
mod solver;

use swm_core::{EnvEntry, Registry};

pub use env::Rink;
pub use factors::factors;
#[cfg(feature = "cli")]
pub use {format::JSONL, model::FITTED_MODEL, solver::SHOTGUN};

/// `demo/IceRink-v0`.
pub const ICE_RINK: EnvEntry = EnvEntry::new(
    "demo/IceRink-v0",
    "push a puck over ice until it lies on a mark",
    |config| Ok(Box::new(Rink::new(config)?)),
)
.success("at rest on the mark")
.policies(&[expert::EXPERT]);

/// Everything of stable-worldmodel, and the environment, solver, model and format of this crate. The solver plans on the true
/// dynamics of any environment, too.
#[cfg(feature = "cli")]
pub fn registry() -> Registry {
    let registry = swm::registry().with(&[ICE_RINK]).with(&[JSONL]).with(&[SHOTGUN]);
    registry.with(&[SHOTGUN.on_simulator]).with(&[FITTED_MODEL])
}

/// The environment of this crate alone.
#[cfg(not(feature = "cli"))]
pub fn registry() -> Registry {
    Registry::new().with(&[ICE_RINK])
}
