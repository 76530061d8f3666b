//! Constructor settings of the Fetch environments.

use swm_core::settings::Table;
use swm_core::{Setting, Settings as _};

use super::factors::VIEW;
use crate::views::settings::ImageSettings;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Steps after which an episode is truncated; 0: never.
        time_limit: u64 = 50,
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
