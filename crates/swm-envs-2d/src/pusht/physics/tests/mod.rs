//! Tests of the simulation as a whole: facts that can be checked by hand, recorded trajectories, properties.

mod facts;
mod golden;
mod properties;
#[cfg(feature = "rapier")]
mod rapier;
