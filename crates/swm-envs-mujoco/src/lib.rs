//! Environments on MuJoCo: the DeepMind Control Suite, OGBench's manipulation environments and mazes, Fetch, and
//! Meta-World.
//!
//! ```no_run
//! use swm_core::{Registry, Rollout, World, WorldOptions};
//! use swm_envs_mujoco::PENDULUM;
//!
//! // Loads MuJoCo and the model, which `cargo xtask setup` puts there.
//! let mut world = World::new(&PENDULUM, WorldOptions::new(4).max_episode_steps(200))?;
//! world.set_policy(Registry::new().policy("expert", &world)?)?;
//! let evaluation = world.evaluate(&Rollout::new(0..8).seed(42))?;
//! println!("returns {:?}", evaluation.episode_returns);
//! # Ok::<(), swm_core::BoxError>(())
//! ```
//!
//! * [`mujoco`]: the C library, loaded at run time, behind safe owners, and where it and the models lie;
//! * [`suite`]: what all domains share;
//! * one file per domain, and one line in [`ENVS`];
//! * `ogbench`: the arm at its tables;
//! * `locomaze`: OGBench's mazes;
//! * `fetch`: an arm that reaches, pushes, slides, and picks and places;
//! * `metaworld`: an arm and ten tasks.
//!
//! The crate builds with nothing installed. Without the library, making an environment fails with the command that
//! fixes it.

#![warn(clippy::print_stdout, clippy::print_stderr)] // They panic where the reader is gone or the disk full.

mod acrobot;
mod ball_in_cup;
mod cartpole;
mod cheetah;
mod fetch;
mod finger;
mod hopper;
mod humanoid;
mod inputs;
mod locomaze;
mod manipulator;
pub mod metaworld;
mod ogbench;
mod pendulum;
mod quadruped;
mod reacher;
#[cfg(test)]
mod recorded_model;
pub mod software;
pub mod suite;
mod views;
mod walker;

use swm_core::EnvEntry;

pub use acrobot::ACROBOT;
pub use ball_in_cup::BALL_IN_CUP;
pub use cartpole::CARTPOLE;
pub use cheetah::CHEETAH;
pub use fetch::{
    FETCH_PICK_AND_PLACE, FETCH_PICK_AND_PLACE_DENSE, FETCH_PICK_AND_PLACE_DICT, FETCH_PUSH,
    FETCH_PUSH_DENSE, FETCH_PUSH_DICT, FETCH_REACH, FETCH_REACH_DENSE, FETCH_REACH_DICT, FETCH_SLIDE,
    FETCH_SLIDE_DENSE, FETCH_SLIDE_DICT,
};
pub use finger::FINGER;
pub use hopper::HOPPER;
pub use humanoid::HUMANOID;
pub use locomaze::{OGB_ANT_MAZE, OGB_ANT_SOCCER, OGB_HUMANOID_MAZE, OGB_POINT_MAZE};
pub use manipulator::MANIPULATOR;
pub use ogbench::{OGB_CUBE, OGB_SCENE};
pub use pendulum::PENDULUM;
pub use quadruped::QUADRUPED;
pub use reacher::REACHER;
pub use swm_mujoco as mujoco;
pub use walker::WALKER;

/// All environments of this crate.
pub const ENVS: &[EnvEntry] = &[
    HUMANOID,
    CHEETAH,
    HOPPER,
    REACHER,
    WALKER,
    ACROBOT,
    PENDULUM,
    CARTPOLE,
    BALL_IN_CUP,
    FINGER,
    MANIPULATOR,
    QUADRUPED,
    OGB_CUBE,
    OGB_SCENE,
    OGB_POINT_MAZE,
    OGB_ANT_MAZE,
    OGB_HUMANOID_MAZE,
    OGB_ANT_SOCCER,
    FETCH_REACH,
    FETCH_REACH_DENSE,
    FETCH_REACH_DICT,
    FETCH_PUSH,
    FETCH_PUSH_DENSE,
    FETCH_PUSH_DICT,
    FETCH_SLIDE,
    FETCH_SLIDE_DENSE,
    FETCH_SLIDE_DICT,
    FETCH_PICK_AND_PLACE,
    FETCH_PICK_AND_PLACE_DENSE,
    FETCH_PICK_AND_PLACE_DICT,
    metaworld::REACH,
    metaworld::PUSH,
    metaworld::PICK_PLACE,
    metaworld::DOOR_OPEN,
    metaworld::DRAWER_OPEN,
    metaworld::DRAWER_CLOSE,
    metaworld::BUTTON_PRESS_TOPDOWN,
    metaworld::PEG_INSERT_SIDE,
    metaworld::WINDOW_OPEN,
    metaworld::WINDOW_CLOSE,
];
