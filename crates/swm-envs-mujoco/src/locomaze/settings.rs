//! What the maker of a maze may choose.

use serde::{Deserialize, Serialize};
use swm_core::Setting;

use super::layout::Maze;
use crate::views::settings::{IMAGE_SETTINGS, Imagesettings, with_image_settings};

/// Constructor settings. Unknown names are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub maze_type: Maze,
    pub mode: Mode,
    pub task: Option<usize>,
    pub terminate_at_goal: bool,
    #[serde(flatten)]
    pub images: Imagesettings,
}

/// Where starts and goals come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Mode {
    /// Any two free cells.
    #[default]
    DataCollection,
    /// One of the maze's tasks.
    Task,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            maze_type: Maze::default(),
            mode: Mode::DataCollection,
            task: None,
            terminate_at_goal: true,
            images: Imagesettings::default(),
        }
    }
}

impl Settings {
    /// Checks what the types cannot say.
    pub(super) fn check(&self) -> Result<(), String> {
        let count = self.maze_type.tasks().len();
        if let Some(task) = self.task
            && !(1..=count).contains(&task)
        {
            return Err(format!("task {task} is not in 1 to {count}, those of this maze"));
        }
        if self.task.is_some() && self.mode != Mode::Task {
            return Err("a task needs `mode=task`".to_owned());
        }
        Ok(())
    }
}

const OWN: [Setting; 4] = [
    Setting {
        name: "maze_type",
        doc: "`arena`, `medium`, `large`, `giant` or `teleport`: 36, 26, 46, 86 and 45 free cells of 4 m",
        default: "large",
    },
    Setting {
        name: "mode",
        doc: "`data_collection`: start and goal lie in any two cells with a way between them; `task`: in those of the maze's tasks",
        default: "data_collection",
    },
    Setting {
        name: "task",
        doc: "1 to 5 (1 in the arena); the reward is then -1 before the goal and 0 at it",
        default: "drawn",
    },
    Setting { name: "terminate_at_goal", doc: "whether reaching the goal ends the episode", default: "true" },
];

/// The settings for help and docs, one per field of `Settings`.
pub(super) const SETTINGS: &[Setting] =
    &with_image_settings::<4, { 4 + IMAGE_SETTINGS }>(OWN, "top for the point, back for the ant");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_described() {
        let json = serde_json::to_value(Settings::default()).unwrap();
        let mut fields: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        let mut described: Vec<&str> = SETTINGS.iter().map(|setting| setting.name).collect();
        fields.sort_unstable();
        described.sort_unstable();
        assert_eq!(fields, described);
        let counts: Vec<String> = [Maze::Arena, Maze::Medium, Maze::Large, Maze::Giant, Maze::Teleport]
            .iter()
            .map(|maze| maze.free_cells().len().to_string())
            .collect();
        let [a, b, c, d, e] = counts.try_into().unwrap();
        assert!(OWN[0].doc.contains(&format!("{a}, {b}, {c}, {d} and {e} free")), "{a} {b} {c} {d} {e}");
    }

    #[test]
    fn tasks_that_are_not_there_are_refused() {
        let arena =
            Settings { maze_type: Maze::Arena, mode: Mode::Task, task: Some(2), ..Settings::default() };
        assert!(arena.check().unwrap_err().contains("1 to 1"));
        assert!(Settings { task: Some(1), ..Settings::default() }.check().unwrap_err().contains("mode=task"));
        assert!(Settings { task: Some(5), mode: Mode::Task, ..Settings::default() }.check().is_ok());
    }
}
