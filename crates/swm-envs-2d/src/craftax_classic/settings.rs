//! Constructor settings of Craftax-Classic.

use serde_json::{Map, Value as Json};
use swm_core::{Setting, Settings as _};

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Other defaults of factors, {name: value}.
        init_value: Map<String, Json> = Map::new() => "{}",
    }
}

/// The settings for help and docs.
pub(super) const SETTINGS: &[Setting] = Settings::SETTINGS;

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::Settings>();
    }
}
