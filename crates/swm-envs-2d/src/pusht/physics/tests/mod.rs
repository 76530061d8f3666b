//! Tests of the simulation as a whole: cases that can be checked by hand, recorded trajectories, properties.

mod by_hand;
mod golden;
mod properties;
#[cfg(feature = "rapier")]
mod rapier;
