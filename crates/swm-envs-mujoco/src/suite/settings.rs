//! What the maker of an environment of the suite may choose.

use serde::{Deserialize, Serialize};
use swm_core::Setting;
use swm_render::scene::Quality;

use crate::views::{CameraName, CameraNames, Renderer, Wanted};

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub task: Option<String>,
    pub stock: bool,
    pub action_repeat: u32,
    pub on_divergence: OnDivergence,
    pub renderer: Renderer,
    pub camera: Option<CameraName>,
    pub cameras: CameraNames,
    pub depth: bool,
    pub segmentation: bool,
    pub antialias: bool,
    pub shadows: bool,
    pub reflections: bool,
}

impl Settings {
    /// The pictures that are asked for; `camera`: the domain's.
    pub(super) fn wanted(&self, camera: usize) -> Wanted {
        Wanted {
            renderer: self.renderer,
            camera: self.camera.clone().unwrap_or(CameraName::Index(camera)),
            cameras: self.cameras.clone(),
            depth: self.depth,
            segmentation: self.segmentation,
            quality: Quality {
                antialias: self.antialias,
                shadows: self.shadows,
                reflections: self.reflections,
            },
        }
    }
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
            renderer: Renderer::Software,
            camera: None,
            cameras: CameraNames::default(),
            depth: false,
            segmentation: false,
            antialias: true,
            shadows: true,
            reflections: true,
        }
    }
}

/// The settings for help and docs, one per field of `Settings`.
pub(super) const SETTINGS: &[Setting] = &[
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
    Setting {
        name: "renderer",
        doc: "what draws pictures: `software` needs nothing; `gl` is MuJoCo's own, with OpenGL through EGL or OSMesa",
        default: "software",
    },
    Setting {
        name: "camera",
        doc: "the model's camera that `pixels` is taken from, by index or name",
        default: "0; quadruped 2",
    },
    Setting {
        name: "cameras",
        doc: "more cameras, each with a column `pixels.<camera>`: a list of indices or names, or names with commas",
        default: "none",
    },
    Setting {
        name: "depth",
        doc: "whether there is a column `pixels_depth`, f32 in metres along the camera's axis, for each camera",
        default: "false",
    },
    Setting {
        name: "segmentation",
        doc: "whether there is a column `pixels_segmentation`, i32 indices of geoms, -2 - index for sites, -1 for nothing, for each camera",
        default: "false",
    },
    Setting {
        name: "antialias",
        doc: "whether edges are smooth; of the renderer `software`",
        default: "true",
    },
    Setting {
        name: "shadows",
        doc: "whether lights cast shadows; of the renderer `software`",
        default: "true",
    },
    Setting {
        name: "reflections",
        doc: "whether floors mirror; of the renderer `software`",
        default: "true",
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
