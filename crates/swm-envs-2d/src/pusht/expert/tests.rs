//! The expert as a policy of the environment.
