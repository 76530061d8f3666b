//! Layers, kernels, losses and optimizers of small world models, on tensors of `burn`.
//!
//! * Layers and networks, at the top of the crate, have the form of the reference's PyTorch modules, to the names of their
//!   tensors, so that weights go both ways. Train and evaluation differ by the [`Pass`] alone.
//! * [`params`]: the tensors of a network by name: read, replace, follow their gradients; [`init`]: initial weights.
//! * [`losses`]: the terms of losses; [`optim`]: AdamW, the clipping of gradients, schedules.
//! * `kernels`: what layers compute on a CPU, forwards and backwards.
//!
//! On a CPU no result depends on threads, on other rows of a batch, or on a global generator. No data, no model and no file is known here.

pub mod init;
mod kernels;
mod layers;
pub mod losses;
pub mod optim;
pub mod params;
mod pass;
pub mod placement;

pub use layers::*;
pub use pass::Pass;
