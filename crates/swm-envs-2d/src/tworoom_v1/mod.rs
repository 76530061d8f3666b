//! TwoRoom, the paper's version: a disc goes through the door of a wall to a goal in the other room.
//!
//! Observation, factors, goal and reward are the reference's; where it has faults, the page of the environment says
//! what is kept for parity and what is fixed.

mod env;
mod expert;
mod factors;
mod goal;
mod physics;
mod rendering;
mod settings;

#[cfg(test)]
mod tests;

use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use env::TwoRoom;
pub use factors::factors;
pub use goal::Overlap;

/// `swm/TwoRoom-v1`.
pub const TWO_ROOM: EnvEntry = EnvEntry::new(
    TwoRoom::ID,
    "steer a disc through the door of a wall to a goal in the other room, before its energy is spent",
    FactorEnv::<TwoRoom>::boxed,
)
.family(crate::FAMILY)
.success("half of either disc covered by the other")
.settings(settings::Settings::SETTINGS)
.policies(&[expert::EXPERT, expert::NOISY_EXPERT]);
