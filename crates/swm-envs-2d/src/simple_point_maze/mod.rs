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

use swm_core::EnvEntry;

pub use env::SimplePointMaze;

/// `swm/SimplePointMaze-v0`.
pub const SIMPLE_POINT_MAZE: EnvEntry =
    EnvEntry::new("swm/SimplePointMaze-v0", "move a disc past rectangular walls to a goal", |config| {
        Ok(Box::new(SimplePointMaze::new(config)?))
    })
    .family(crate::FAMILY)
    .success("within `goal.radius` of the goal")
    .settings(settings::SETTINGS)
    .policies(&[policies::EXPERT, policies::NOISY_EXPERT])
    .planner(policies::PLANNER);
