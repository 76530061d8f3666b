//! PointMaze: a force drives a disc through a maze to a goal.
//!
//! Mazes, cell size and coordinates are OGBench's; the dynamics are ours: where its point is moved by its action, this
//! disc has a mass, is driven by a force, and slides along walls that rapier2d stops it at.

mod env;
mod factors;
mod layout;
mod physics;
mod policies;
mod rendering;
mod settings;
mod shortest_path;
#[cfg(test)]
mod tests;

use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use env::PointMaze;
pub use factors::factors;

/// `swm/PointMaze-v0`.
pub const POINT_MAZE: EnvEntry = EnvEntry::new(
    PointMaze::ID,
    "drive a disc through a maze to a goal by a force",
    FactorEnv::<PointMaze>::boxed,
)
.family(crate::FAMILY)
.success("within `goal.radius` of the goal")
.settings(settings::Settings::SETTINGS)
.policies(policies::POLICIES);
