//! Constructor settings of PointMaze.

use serde_json::{Map, Value as Json};

use crate::settings::Render;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Render the goal.
        with_target: bool = true,
        /// Reaching the goal ends the episode.
        terminate_at_goal: bool = true,
        /// `exact`: with the rasterizer of the other environments' exact images; `fast`: directly at the requested size.
        render: Render = Render::Exact => "exact",
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
