//! Two-dimensional environments: PushT.

pub mod pusht;
