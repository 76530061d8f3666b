//! From `--policy NAME:ARGS` to a policy for an environment.

use swm_core::{EnvConfig, EnvEntry, Policy, PolicyContext, Registry};

use super::Failure;
use super::args::policy_args;

/// Makes the policy; the environments that it simulates are made as `config` says, without pictures.
pub(super) fn make(
    registry: &Registry,
    env: &EnvEntry,
    config: &EnvConfig,
    frame_skip: u32,
    text: &str,
) -> Result<Box<dyn Policy>, Failure> {
    let config = EnvConfig { image: None, ..config.clone() };
    Ok(registry.policy(&PolicyContext { env, config: &config, frame_skip }, &policy_args(text)?)?)
}
