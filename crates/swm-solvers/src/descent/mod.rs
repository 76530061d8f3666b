//! Gradient descent on many plans at once: what its solvers share. Which rule, and what else a step does, is theirs.

mod rules;
mod search;
mod settings;
mod simplex;

pub(crate) use rules::{Rule, WeightDecay};
pub(crate) use search::{Limits, Search, scatter};
pub use settings::{Descent, GradClip};
