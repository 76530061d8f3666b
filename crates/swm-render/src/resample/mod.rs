//! Resampling, to the byte: the two filters that stand between the reference's canvas and its frames.

mod antialias;
mod fixed;

pub use antialias::AntialiasBilinear;
pub use fixed::FixedBilinear;
