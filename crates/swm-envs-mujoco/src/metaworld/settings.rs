//! Constructor settings of the Meta-World environments.

use swm_core::settings::Table;
use swm_core::{Setting, Settings as _};

use crate::views::settings::ImageSettings;

/// The camera that images are rendered from.
pub(super) const VIEW: &str = "corner2";

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Steps after which an episode is truncated; 0: never.
        time_limit: u64 = 500,
        /// Whether success ends the episode.
        terminate_on_success: bool = false,
        /// Whether the observation has the goal; else zeros.
        goal_observable: bool = true,
        ..images: ImageSettings,
    }
}

/// The settings for help and docs.
pub(super) const SETTINGS: &[Setting] = WITH_CAMERA.as_slice();
const WITH_CAMERA: &Table = &Table::of(&[Settings::SETTINGS]).with_default("camera", VIEW);

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::Settings>();
    }
}
