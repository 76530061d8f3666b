//! Policies that fit every environment: random, smooth random, constant; and experts with noise. Their entries stand in `registry/basic.rs`.

mod constant;
mod noisy;
mod random;
mod smooth;

pub use constant::constant;
pub use noisy::{NoisyExpert, expert, noisy, noisy_expert};
pub use random::random;
pub use smooth::{OrnsteinUhlenbeck, Sines, ornstein_uhlenbeck, sines};
