//! Three-dimensional environments on rapier3d, parry3d and nalgebra.
//!
//! ```
//! use swm_core::{ResetOptions, World, WorldOptions, policies};
//! use swm_envs_3d::table_push::TABLE_PUSH;
//!
//! let mut world = World::new(&TABLE_PUSH, WorldOptions::new(2))?;
//! world.set_policy(policies::random())?;
//! world.reset(42, &ResetOptions::default().vary(["all"]))?;
//! world.step()?;
//! assert_eq!(world.infos().rows(), 2);
//! # Ok::<(), swm_core::BoxError>(())
//! ```
//!
//! Each environment is one module and one line in [`ENVS`]. They need neither MuJoCo nor any asset: rendering comes from
//! the 3D scenes of `swm-render`. No solver, dataset or model is known here.

mod attitude;
pub mod rocket;
mod scene;
mod shapes;
pub mod table_push;

use swm_core::EnvEntry;

/// What lists of environments show these under.
const FAMILY: &str = "3D, on rapier3d";

/// All environments of this crate.
pub const ENVS: &[EnvEntry] = &[rocket::ROCKET_LANDING, table_push::TABLE_PUSH];
