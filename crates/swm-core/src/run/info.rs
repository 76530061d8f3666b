//! What recorders are told before the first step.

use super::{Rollout, WorldOptions};
use crate::batch::Schema;
use crate::env::EnvSpec;

/// What is known before a run starts.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct RunInfo<'a> {
    /// The environment.
    pub spec: &'a EnvSpec,
    /// The fields of every step.
    pub schema: &'a Schema,
    /// How the world was built.
    pub options: &'a WorldOptions,
    /// Which episodes run.
    pub rollout: &'a Rollout,
    /// The policy's description; `external` where a driver acts without a policy.
    pub policy: &'a str,
    /// What renders images: see [`crate::Env::renderer`].
    pub renderer: Option<&'a str>,
}
