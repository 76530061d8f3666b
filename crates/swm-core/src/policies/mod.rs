//! Policies that fit every environment: random, smooth random, constant. Their entries stand in `registry/basic.rs`.

mod constant;
mod random;
mod smooth;

pub use constant::constant;
pub use random::random;
pub use smooth::{OrnsteinUhlenbeck, Sines, ornstein_uhlenbeck, sines};
