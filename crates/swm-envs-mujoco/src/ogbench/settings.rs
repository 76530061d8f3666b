//! Constructor settings of the manipulation environments.

use serde::{Deserialize, Serialize};
use swm_core::settings::Table;
use swm_core::{Setting, Settings as _};

use super::layout::{CAMERA, Kind};
use crate::views::settings::ImageSettings;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// `single`, `double`, `triple` or `quadruple`: how many cubes there are; shapes of columns and factors follow.
        env_type: Option<EnvType> = None => "single",
        /// `data_collection`: starts and targets come from the factors; `task`: from one of five tasks.
        mode: Mode = Mode::DataCollection => "data_collection",
        /// 1 to 5; the reward is then minus the number of unmet goals.
        task: Option<usize> = None => "drawn",
        /// Whether reaching the goal ends the episode.
        terminate_at_goal: Option<bool> = None => "true for tasks, else false",
        /// Whether data collection goes on with a new target once one is reached and released.
        new_targets: bool = true,
        /// Whether tasks permute the colors of the cubes.
        permute_blocks: bool = true,
        /// Whether markers show where cubes belong.
        visualize_info: bool = true,
        /// Whether the arm is transparent.
        pixel_transparent_arm: bool = true,
        ..images: ImageSettings,
    }
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Mode {
    /// From the factors, one target after the other.
    DataCollection,
    /// One of the five tasks.
    Task,
}

impl Settings {
    /// Checks what the types cannot express, and returns which objects are on the table.
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

/// The settings of the cubes for help and docs.
pub(super) const CUBE_SETTINGS: &[Setting] = CUBES.as_slice();
const CUBES: &Table = &Table::of(&[Settings::SETTINGS]).with_default("camera", CAMERA);

/// The settings of the scene, which has one cube.
pub(super) const SCENE_SETTINGS: &[Setting] = SCENE.as_slice();
const SCENE: &Table = &CUBES.without("env_type");

#[cfg(test)]
mod tests {
    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<super::Settings>();
    }
}
