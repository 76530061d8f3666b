//! Constructor settings of PushT.

use serde_json::{Map, Value as Json};
use swm_core::settings::Table;
use swm_core::{Setting, Settings as _};

use super::engine::Engine;
use crate::settings::Render;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub struct Settings {
        /// Actions are offsets from the agent, in units of 100 px; otherwise targets in px.
        relative: bool = true,
        /// Render the goal.
        with_target: bool = true,
        /// `exact`: the reference's images to the byte; `fast`: rendered at the requested size.
        render: Render = Render::Exact => "exact",
        /// Mark the controller's target in images.
        render_action: bool = false,
        /// Fraction of velocity left after a second.
        damping: f64 = 0.0,
        /// Center of gravity of the block, [x, y] px.
        block_cog: Option<[f64; 2]> = None => "the shape's",
        /// Coefficient of friction of all contacts.
        friction: Option<f64> = None => "0.5",
        /// Other defaults of factors, {name: value}.
        init_value: Map<String, Json> = Map::new() => "{}",
    }
}

/// The settings of PushT on an engine, which may know no `friction`.
pub(super) const fn known<E: Engine>() -> &'static [Setting] {
    if E::FRICTION == 0.0 { WITHOUT_FRICTION.as_slice() } else { Settings::SETTINGS }
}
const WITHOUT_FRICTION: &Table = &Table::of(&[Settings::SETTINGS]).without("friction");

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::Settings>();
    }
}
