//! Constructor settings of TablePush3D.

use serde_json::{Map, Value as Json};

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Steps after which an episode is truncated; 0: never.
        time_limit: u64 = 200,
        /// Render the goal.
        with_target: bool = true,
        /// Other defaults of factors, {name: value}.
        init_value: Map<String, Json> = Map::new() => "{}",
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::Settings>();
    }
}
