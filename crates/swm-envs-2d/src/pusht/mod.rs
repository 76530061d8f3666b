//! PushT: push a block to a pose.

pub mod physics;
