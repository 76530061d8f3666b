//! SimpleNavigation: an agent on a grid turns and walks through a maze to a goal.
//!
//! Steps and images are those of the *reference*, the Python package `stable-worldmodel` (January 2026) on MiniGrid 3.0.0. Its
//! mazes are Eller's.
//!
//! | file | duty |
//! |---|---|
//! | `env`, `factors` | the environment and its tables |
//! | `maze` | walls, how they are made, ways between them |
//! | `view` | what the agent sees |
//! | `rendering`, `tiles` | images |
//! | `policies` | the expert |

mod env;
mod factors;
mod maze;
mod policies;
mod rendering;
#[cfg(test)]
mod tests;
mod tiles;
mod view;

use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use crate::settings::FactorDefaults;
use env::SimpleNavigation;

/// `swm/SimpleNavigation-v0`.
pub const SIMPLE_NAVIGATION: EnvEntry = EnvEntry::new(
    SimpleNavigation::ID,
    "turn and walk through a maze on a grid to a goal",
    FactorEnv::<SimpleNavigation>::boxed,
)
.family(crate::FAMILY)
.success("the agent stands on the goal")
.settings(FactorDefaults::SETTINGS)
.policies(&[policies::EXPERT, policies::NOISY_EXPERT])
.planner(policies::PLANNER);
