//! TwoRoom of August 2026: an agent walks from one room to another, or stays, until it stands at a target.
//!
//! Kinematic, at the scale of its 224-px image; the version that the published TwoRoom datasets come from. The paper's
//! version, with physics on a 512-px canvas, is another environment. Where the reference has faults, the page of the
//! environment says what is kept for parity and what is fixed.
//!
//! | file | duty |
//! |---|---|
//! | `env`, `settings`, `factors` | the environment and its tables |
//! | `room`, `route` | how an agent moves, and the way to a place |
//! | `rendering`, `dot` | images |
//! | `expert` | policies |

pub(crate) mod dot;
mod env;
mod expert;
mod factors;
pub(crate) mod rendering;
pub(crate) mod room;
mod route;
mod settings;

#[cfg(test)]
mod tests;

use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use env::TwoRoom;
pub use factors::factors;

/// `swm/TwoRoom-v2`.
pub const TWO_ROOM_V2: EnvEntry = EnvEntry::new(
    TwoRoom::ID,
    "walk to a target in one of two rooms, through a door if need be",
    FactorEnv::<TwoRoom>::boxed,
)
.family(crate::FAMILY)
.success("less than 16 px from the target")
.settings(settings::Settings::SETTINGS)
.policies(&[expert::EXPERT, expert::NOISY_EXPERT]);
