//! Constructor settings of TwoRoom.

use serde_json::{Map, Value as Json};

use crate::settings::Render;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// Walls stop the agent always; in the reference a strong push passes through them.
        solid_walls: bool = false,
        /// `exact`: the reference's images to the byte; `fast`: rendered at the requested size.
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
