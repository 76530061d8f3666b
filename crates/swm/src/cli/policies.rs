//! From `--policy NAME:ARGS` to a policy for an environment.

use swm_core::{EnvConfig, EnvEntry, ImageSize, Policy, PolicyArgs, PolicyContext, Registry};

use super::Failure;
use super::args::policy_args;

/// Makes the policy; the environments that it simulates are made as `config` says, without images.
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

/// The image size that the model behind a policy was trained on, for worlds that no image size is asked for.
pub(super) fn image_of(text: &str) -> Option<ImageSize> {
    let args = policy_args(text).ok()?;
    let side = side_of(&args)?;
    Some(ImageSize { height: side, width: side })
}

#[cfg_attr(
    not(any(feature = "baselines", feature = "onnx")),
    expect(unused_variables, reason = "without models there is nothing to look for")
)]
fn side_of(args: &PolicyArgs) -> Option<usize> {
    #[cfg(feature = "onnx")]
    if let Some(side) = swm_onnx::image_side(args) {
        return Some(side);
    }
    #[cfg(feature = "baselines")]
    if let Some(side) = swm_baselines::acting::image_side(args) {
        return Some(side);
    }
    None
}
