//! Two-dimensional environments: PushT.
