//! Constructor settings of the mazes.

use serde::{Deserialize, Serialize};
use swm_core::settings::Table;
use swm_core::{Setting, Settings as _};

use super::layout::Maze;
use crate::views::settings::ImageSettings;

swm_core::settings! {
    /// Constructor settings. Unknown names are refused.
    pub(super) struct Settings {
        /// `arena`, `medium`, `large`, `giant` or `teleport`: 36, 26, 46, 86 and 45 free cells of 4 m.
        maze_type: Maze = Maze::default() => "large",
        /// `data_collection`: start and goal lie in any two connected cells; `task`: in those of the maze's tasks.
        mode: Mode = Mode::DataCollection => "data_collection",
        /// 1 to 5 (1 in the arena); the reward is then -1 before the goal and 0 at it.
        task: Option<usize> = None => "drawn",
        /// Whether reaching the goal ends the episode.
        terminate_at_goal: bool = true,
        ..images: ImageSettings,
    }
}

/// Where starts and goals come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Mode {
    /// Any two free cells.
    DataCollection,
    /// One of the maze's tasks.
    Task,
}

impl Settings {
    /// Checks what the types cannot express.
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

/// The settings for help and docs.
pub(super) const SETTINGS: &[Setting] = WITH_CAMERA.as_slice();
const WITH_CAMERA: &Table =
    &Table::of(&[Settings::SETTINGS]).with_default("camera", "top for the point, back for the ant");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_documented() {
        swm_core::testing::assert_documented_defaults::<Settings>();
        let counts: Vec<String> = [Maze::Arena, Maze::Medium, Maze::Large, Maze::Giant, Maze::Teleport]
            .iter()
            .map(|maze| maze.free_cells().len().to_string())
            .collect();
        let [a, b, c, d, e] = counts.try_into().unwrap();
        assert!(SETTINGS[0].doc.contains(&format!("{a}, {b}, {c}, {d} and {e} free")), "{a} {b} {c} {d} {e}");
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
