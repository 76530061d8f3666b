//! What the maker of an environment of the suite may choose.

use serde::{Deserialize, Serialize};
use swm_core::Setting;

use crate::views::settings::{IMAGE_SETTINGS, Imagesettings, with_image_settings};

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub task: Option<String>,
    pub stock: bool,
    pub action_repeat: u32,
    pub on_divergence: OnDivergence,
    #[serde(flatten)]
    pub images: Imagesettings,
}

/// What happens when the simulation means nothing any more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum OnDivergence {
    #[default]
    Error,
    End,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            task: None,
            stock: false,
            action_repeat: 2,
            on_divergence: OnDivergence::Error,
            images: Imagesettings::default(),
        }
    }
}

/// The settings for help and docs, one per field of `Settings`.
pub(super) const SETTINGS: &[Setting] =
    &with_image_settings::<4, { 4 + IMAGE_SETTINGS }>(OWN, "0; quadruped 2");

const OWN: [Setting; 4] = [
    Setting {
        name: "task",
        doc: "what is rewarded; the page of the environment lists the tasks",
        default: "the first",
    },
    Setting {
        name: "stock",
        doc: "start from dm_control's own model and looks, not from what the reference makes of them",
        default: "false",
    },
    Setting { name: "action_repeat", doc: "control steps per action; their rewards add up", default: "2" },
    Setting {
        name: "on_divergence",
        doc: "`error`: a simulation that diverges fails the run; `end`: it ends the episode, without a reward for that step",
        default: "error",
    },
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
