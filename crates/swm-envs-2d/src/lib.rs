//! Two-dimensional environments.
//!
//! ```
//! use swm_core::{Registry, Rollout, World, WorldOptions};
//! use swm_envs_2d::pusht::PUSHT;
//!
//! let mut world = World::new(&PUSHT, WorldOptions::new(2).image(64, 64).max_episode_steps(20))?;
//! world.set_policy(Registry::new().policy("weak", &world)?)?; // a policy of this environment, by its name
//! let evaluation = world.evaluate(&Rollout::new(0..4).seed(42).vary(["+block.color"]))?;
//! assert_eq!(evaluation.episode_lengths.len(), 4);
//! assert_eq!(world.infos().get::<u8>("pixels")?.len(), 2 * 64 * 64 * 3); // [N, H, W, 3]
//! # Ok::<(), swm_core::BoxError>(())
//! ```
//!
//! Each environment is one module and one line in [`ENVS`]. It brings its physics, its rendering, its factors of
//! variation, its policies; rendering comes from `swm-render`. No solver, dataset or model is known here.

mod artist;
pub mod classic_control;
pub mod craftax_classic;
mod dot_room;
mod image;
pub mod piecewise;
#[cfg(feature = "rapier")]
pub mod point_maze;
pub mod pusht;
mod random_actions;
#[cfg(feature = "rapier")]
mod rigid;
mod settings;
mod shortest_path;
pub mod simple_navigation;
pub mod simple_point_maze;
pub mod tworoom_v1;
pub mod tworoom_v2;

use swm_core::EnvEntry;

/// What lists of environments show most of these under; those of classic control have a family of their own.
const FAMILY: &str = "2D manipulation and navigation";

/// All environments of this crate.
pub const ENVS: &[EnvEntry] = &[
    pusht::PUSHT,
    pusht::PUSHT_DISCRETE,
    tworoom_v1::TWO_ROOM,
    tworoom_v2::TWO_ROOM_V2,
    piecewise::PIECEWISE,
    simple_point_maze::SIMPLE_POINT_MAZE,
    simple_navigation::SIMPLE_NAVIGATION,
    #[cfg(feature = "rapier")]
    pusht::PUSHT_RAPIER,
    #[cfg(feature = "rapier")]
    point_maze::POINT_MAZE,
    craftax_classic::CRAFTAX_CLASSIC_SYMBOLIC,
    craftax_classic::CRAFTAX_CLASSIC_PIXELS,
    classic_control::CART_POLE,
    classic_control::MOUNTAIN_CAR,
    classic_control::MOUNTAIN_CAR_CONTINUOUS,
    classic_control::ACROBOT,
    classic_control::PENDULUM,
];
