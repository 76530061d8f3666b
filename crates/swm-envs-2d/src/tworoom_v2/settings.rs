//! What the maker of a TwoRoom environment may choose.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Setting;

use crate::settings::Render;

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub(super) render_target: bool,
    pub(super) render: Render,
    pub(super) init_value: Map<String, Json>,
}

/// The settings for help and docs, one per field of `Settings`.
pub(super) const SETTINGS: &[Setting] = &[
    Setting {
        name: "render_target",
        doc: "draw the target, whatever the factor rendering.render_target says",
        default: "false",
    },
    Setting {
        name: "render",
        doc: "`exact`: the reference's images; `fast`: drawn at the asked size",
        default: "exact",
    },
    Setting { name: "init_value", doc: "other defaults of factors, {name: value}", default: "{}" },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_described() {
        let json = serde_json::to_value(Settings::default()).unwrap();
        let fields: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        let described: Vec<&str> = SETTINGS.iter().map(|setting| setting.name).collect();
        assert_eq!(fields, described);
    }
}
