//! What the maker of a manipulation environment may choose.

use serde::{Deserialize, Serialize};
use swm_core::Setting;

use super::layout::{CAMERA, Kind};
use crate::views::settings::{IMAGE_SETTINGS, Imagesettings, with_image_settings};

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub env_type: Option<EnvType>,
    pub mode: Mode,
    pub task: Option<usize>,
    pub terminate_at_goal: Option<bool>,
    pub new_targets: bool,
    pub permute_blocks: bool,
    pub visualize_info: bool,
    pub pixel_transparent_arm: bool,
    #[serde(flatten)]
    pub images: Imagesettings,
}

/// How many cubes there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum EnvType {
    Single,
    Double,
    Triple,
    Quadruple,
}

/// Where starts and goals come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Mode {
    /// From the factors, one target after the other.
    #[default]
    DataCollection,
    /// One of the five tasks.
    Task,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            env_type: None,
            mode: Mode::DataCollection,
            task: None,
            terminate_at_goal: None,
            new_targets: true,
            permute_blocks: true,
            visualize_info: true,
            pixel_transparent_arm: true,
            images: Imagesettings::default(),
        }
    }
}

impl Settings {
    /// Checks what the types cannot say, and says what stands on the table.
    pub(super) fn kind(&self, is_scene: bool) -> Result<Kind, String> {
        let kind = match (is_scene, self.env_type) {
            (true, None) => Kind::Scene,
            (true, Some(_)) => return Err("env_type is a setting of swm/OGBCube-v0".to_owned()),
            (false, None | Some(EnvType::Single)) => Kind::Cubes(1),
            (false, Some(EnvType::Double)) => Kind::Cubes(2),
            (false, Some(EnvType::Triple)) => Kind::Cubes(3),
            (false, Some(EnvType::Quadruple)) => Kind::Cubes(4),
        };
        if let Some(task) = self.task
            && !(1..=5).contains(&task)
        {
            return Err(format!("task {task} is not in 1 to 5"));
        }
        if self.task.is_some() && self.mode != Mode::Task {
            return Err("a task needs `mode=task`".to_owned());
        }
        Ok(kind)
    }

    /// Whether reaching the goal ends an episode.
    pub(super) fn ends_at_goal(&self) -> bool {
        self.terminate_at_goal.unwrap_or(self.mode == Mode::Task)
    }
}

const ENV_TYPE: Setting = Setting {
    name: "env_type",
    doc: "`single`, `double`, `triple` or `quadruple`: how many cubes there are; shapes of columns and factors follow",
    default: "single",
};

/// The settings but `env_type` and those of images for help and docs, one per further field of `Settings`.
const SHARED: [Setting; 7] = [
    Setting {
        name: "mode",
        doc: "`data_collection`: starts and targets come from the factors; `task`: from one of five tasks",
        default: "data_collection",
    },
    Setting {
        name: "task",
        doc: "1 to 5; the reward is then minus the number of unmet goals",
        default: "drawn",
    },
    Setting {
        name: "terminate_at_goal",
        doc: "whether reaching the goal ends the episode",
        default: "true for tasks, else false",
    },
    Setting {
        name: "new_targets",
        doc: "whether data collection goes on with a new target once one is reached and let go",
        default: "true",
    },
    Setting { name: "permute_blocks", doc: "whether tasks mix the colors of the cubes", default: "true" },
    Setting { name: "visualize_info", doc: "whether markers show where cubes belong", default: "true" },
    Setting { name: "pixel_transparent_arm", doc: "whether the arm can be looked through", default: "true" },
];

/// The settings of the scene.
pub(super) const SCENE_SETTINGS: &[Setting] =
    &with_image_settings::<7, { 7 + IMAGE_SETTINGS }>(SHARED, CAMERA);

/// The settings of the cubes.
pub(super) const CUBE_SETTINGS: &[Setting] = {
    const OWN: [Setting; 8] = {
        let [mode, task, terminate, new_targets, permute, info, transparent] = SHARED;
        [ENV_TYPE, mode, task, terminate, new_targets, permute, info, transparent]
    };
    &with_image_settings::<8, { 8 + IMAGE_SETTINGS }>(OWN, CAMERA)
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_described() {
        let json = serde_json::to_value(Settings::default()).unwrap();
        let fields: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        let described: Vec<&str> = CUBE_SETTINGS.iter().map(|setting| setting.name).collect();
        let mut sorted = described.clone();
        sorted.sort_unstable();
        let mut fields_sorted = fields;
        fields_sorted.sort_unstable();
        assert_eq!(fields_sorted, sorted);
        assert_eq!(SCENE_SETTINGS.len() + 1, CUBE_SETTINGS.len());
    }
}
