//! Settings that the environments of this crate have in common. Those with settings of their own have a struct for all.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_render::Style;

swm_core::settings! {
    /// Constructor settings of environments that have no others. Unknown names are refused.
    pub(crate) struct FactorDefaults {
        /// Other defaults of factors, {name: value}.
        init_value: Map<String, Json> = Map::new() => "{}",
    }
}

/// [`Style`], as it is written in settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Render {
    #[default]
    Exact,
    Fast,
}

impl From<Render> for Style {
    fn from(render: Render) -> Self {
        match render {
            Render::Exact => Style::Exact,
            Render::Fast => Style::Fast,
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::FactorDefaults>();
    }
}
