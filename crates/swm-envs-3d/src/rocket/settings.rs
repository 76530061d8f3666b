//! Constructor settings of rocket landing.

use serde_json::{Map, Value as Json};

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Steps after which an episode is truncated; 0: never.
        time_limit: u64 = 1200,
        /// Start with a random place (20 m sideways, 400 to 450 m high) and attitude (0.3 rad), besides the factors.
        randomize_drop: bool = false,
        /// Start with a fall of 30 m/s; otherwise at rest.
        accelerate_drop: bool = true,
        /// Reward contact with the pad and landing alone.
        sparse_reward: bool = false,
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
