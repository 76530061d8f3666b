//! Checkpoints by name: runs of `swm-baselines` and what others published, as policies and as files.
//!
//! | module | duty |
//! |---|---|
//! | [`policies`] | [`POLICIES`] and [`MODELS`]: `mpc:RUN`, `lewm:FOLDER` and their arguments |
//! | [`import`] | published checkpoints as runs |
//! | [`export`] | runs as checkpoints that the reference loads |
//! | [`reproduce`] | recipes that repeat published results |
//!
//! Models, their trainings and the files of a run are those of `swm-baselines`, which knows nothing of this crate. No network and no tensor is
//! made here.

pub mod export;
pub mod import;
#[cfg(test)]
mod plane;
pub mod policies;
pub mod reproduce;

pub use policies::{MODELS, POLICIES, latent_model};
