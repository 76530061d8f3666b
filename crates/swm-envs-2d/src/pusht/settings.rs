//! What the maker of a PushT environment may choose.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Setting;

use crate::settings::Render;

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub relative: bool,
    pub with_target: bool,
    pub render: Render,
    pub render_action: bool,
    pub damping: f64,
    pub block_cog: Option<[f64; 2]>,
    pub friction: Option<f64>,
    pub init_value: Map<String, Json>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            relative: true,
            with_target: true,
            render: Render::Exact,
            render_action: false,
            damping: 0.0,
            block_cog: None,
            friction: None,
            init_value: Map::new(),
        }
    }
}

macro_rules! settings {
    ($($own:expr),*) => {
        &[
            Setting {
                name: "relative",
                doc: "actions are offsets from the agent, in units of 100 px; otherwise targets in px",
                default: "true",
            },
            Setting { name: "with_target", doc: "draw the goal", default: "true" },
            Setting {
                name: "render",
                doc: "`exact`: the reference's images to the byte; `fast`: drawn at the asked size",
                default: "exact",
            },
            Setting { name: "render_action", doc: "mark the controller's target in images", default: "false" },
            Setting { name: "damping", doc: "fraction of velocity left after a second", default: "0" },
            Setting {
                name: "block_cog",
                doc: "center of gravity of the block, [x, y] px",
                default: "the shape's",
            },
            $($own,)*
            Setting { name: "init_value", doc: "other defaults of factors, {name: value}", default: "{}" },
        ]
    };
}

/// The settings for help and docs, one per field of `Settings` but `friction`, which PushT's own physics has not.
pub(super) const SETTINGS: &[Setting] = settings!();

/// The settings of PushT on rapier2d.
#[cfg(feature = "rapier")]
pub(super) const RAPIER_SETTINGS: &[Setting] =
    settings!(Setting { name: "friction", doc: "coefficient of friction of all contacts", default: "0.5" });

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_described() {
        let json = serde_json::to_value(Settings::default()).unwrap();
        let fields: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        let described =
            |settings: &[Setting]| settings.iter().map(|setting| setting.name).collect::<Vec<_>>();
        #[cfg(feature = "rapier")]
        assert_eq!(fields, described(RAPIER_SETTINGS));
        let without: Vec<&str> = fields.into_iter().filter(|name| *name != "friction").collect();
        assert_eq!(without, described(SETTINGS));
    }
}
