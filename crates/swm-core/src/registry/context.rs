//! What a policy is made for.

use super::{EnvEntry, Registry};
use crate::env::EnvConfig;

/// What a policy is made for: an environment, how it is made, and what else there is to choose from.
///
/// `&World` converts into one.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct PolicyContext<'a> {
    /// The environment.
    pub env: &'a EnvEntry,
    /// How its environments are made.
    pub config: &'a EnvConfig,
    /// How often the world applies each action.
    pub frame_skip: u32,
    /// Where the policy may look up other entries, such as a solver by its name.
    pub registry: Option<&'a Registry>,
}

impl<'a> PolicyContext<'a> {
    /// Environments that `env` makes with `config`, each action applied once.
    pub fn new(env: &'a EnvEntry, config: &'a EnvConfig) -> Self {
        Self { env, config, frame_skip: 1, registry: None }
    }

    /// Each action is applied `times` times.
    #[must_use]
    pub fn frame_skip(mut self, times: u32) -> Self {
        self.frame_skip = times;
        self
    }

    /// Entries are looked up in `registry`. [`Registry::policy`] sets this itself.
    #[must_use]
    pub fn within(mut self, registry: &'a Registry) -> Self {
        self.registry = Some(registry);
        self
    }
}
