//! SimplePointMaze: a disc moves through a square room past rectangular walls to a goal; an action moves it, a wall stops it.
//!
//! Positions and images are those of the *reference*, the Python package `stable-worldmodel`, which draws with Matplotlib.
//!
//! | file | duty |
//! |---|---|
//! | `env`, `settings`, `factors` | the environment and its tables |
//! | `walls` | where walls stand, and how a disc moves between them |
//! | `rendering`, `circle` | images |
//! | `policies` | the expert |

mod circle;
mod env;
mod factors;
mod policies;
mod rendering;
mod settings;
#[cfg(test)]
mod tests;
mod walls;

use swm_core::policies::{expert, noisy_expert};
use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use env::SimplePointMaze;
use policies::Expert;

/// `swm/SimplePointMaze-v0`.
pub const SIMPLE_POINT_MAZE: EnvEntry = EnvEntry::new(
    SimplePointMaze::ID,
    "move a disc past rectangular walls to a goal",
    FactorEnv::<SimplePointMaze>::boxed,
)
.family(crate::FAMILY)
.success("within `goal.radius` of the goal")
.settings(settings::Settings::SETTINGS)
.policies(&[expert::<Expert, 2>(), noisy_expert::<Expert, 2>()])
.planner(policies::PLANNER);
