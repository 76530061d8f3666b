//! Environments on MuJoCo: the DeepMind Control Suite.
//!
//! * [`ffi`]: the C library, loaded at run time, behind safe owners;
//! * [`assets`]: where library and models lie (`cargo xtask setup` puts them there);
//! * [`suite`]: what all domains share;
//! * one file per domain, and one line in [`ENVS`].
//!
//! The crate builds with nothing installed. Without the library, making an environment fails with the command that
//! mends it.

pub mod assets;
mod cheetah;
pub mod error;
#[expect(unsafe_code, reason = "the C library; the only folder of the workspace with such code")]
pub mod ffi;
pub mod suite;

use swm_core::EnvEntry;

pub use cheetah::CHEETAH;
pub use error::MujocoError;

/// All environments of this crate.
pub const ENVS: &[EnvEntry] = &[CHEETAH];
