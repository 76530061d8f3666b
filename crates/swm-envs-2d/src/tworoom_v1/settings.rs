//! What the maker of a TwoRoom environment may choose.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Setting;

use crate::settings::Render;

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub solid_walls: bool,
    pub render: Render,
    pub init_value: Map<String, Json>,
}

/// The settings for help and docs, one per field of `Settings`.
pub(super) const SETTINGS: &[Setting] = &[
    Setting {
        name: "solid_walls",
        doc: "walls stop the agent for good; in the reference a strong push goes through them",
        default: "false",
    },
    Setting {
        name: "render",
        doc: "`exact`: the reference's images to the byte; `fast`: drawn at the asked size",
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
