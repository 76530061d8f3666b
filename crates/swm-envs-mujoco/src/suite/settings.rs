//! Constructor settings of the environments of the suite.

use serde::{Deserialize, Serialize};
use swm_core::settings::Table;
use swm_core::{Setting, Settings as _};

use crate::views::settings::ImageSettings;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// What is rewarded: the name of a task. `swm envs` and the page of the environment list them.
        task: Option<String> = None => "the first",
        /// Start from dm_control's own model and looks, not from the reference's changes to them.
        stock: bool = false,
        /// Control steps per action; their rewards add up.
        action_repeat: u32 = 2,
        /// `error`: a simulation that diverges fails the run; `end`: it ends the episode, without a reward for that step.
        on_divergence: OnDivergence = OnDivergence::Error => "error",
        ..images: ImageSettings,
    }
}

/// What happens when the simulation diverges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum OnDivergence {
    Error,
    End,
}

/// The settings for help and docs.
pub(super) const SETTINGS: &[Setting] = WITH_CAMERA.as_slice();
const WITH_CAMERA: &Table = &Table::of(&[Settings::SETTINGS]).with_default("camera", "0; quadruped 2");

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::Settings>();
    }
}
