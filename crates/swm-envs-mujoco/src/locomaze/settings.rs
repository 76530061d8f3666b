//! Constructor settings of the mazes.

use serde::{Deserialize, Serialize};
use swm_core::settings::Table;
use swm_core::{EnvConfig, EnvError, Setting, Settings as _};

use super::Body;
use super::layout::Maze;
use crate::views::settings::{self, ImageSettings};

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

swm_core::settings! {
    /// Constructor settings of AntSoccer. Unknown names are refused.
    struct SoccerSettings {
        /// `arena` or `medium`: 36 and 26 free cells of 4 m.
        maze_type: Maze = Maze::Arena => "arena",
        /// `data_collection`: ant, ball and goal are in any three connected cells; `task`: in those of the maze's tasks.
        mode: Mode = Mode::DataCollection => "data_collection",
        /// 1 to 5; the reward is then -1 before the ball is at the goal and 0 when it is.
        task: Option<usize> = None => "drawn",
        /// Whether the ball at the goal ends the episode.
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
    /// The settings of the environment `id`, checked.
    pub(super) fn read(config: &EnvConfig, id: &str, body: Body) -> Result<Self, EnvError> {
        let read: Self = if body.has_ball() {
            let soccer: SoccerSettings = settings::read(config, id, SOCCER)?;
            let SoccerSettings { maze_type, mode, task, terminate_at_goal, images } = soccer;
            Self { maze_type, mode, task, terminate_at_goal, images }
        } else {
            settings::read(config, id, SETTINGS)?
        };
        read.check(body).map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        Ok(read)
    }

    /// Checks what the types cannot express.
    fn check(&self, body: Body) -> Result<(), String> {
        let maze = self.maze_type;
        let count = if body.has_ball() { maze.soccer_tasks().len() } else { maze.tasks().len() };
        if count == 0 {
            return Err("AntSoccer is played in the mazes `arena` and `medium`".to_owned());
        }
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
    &Table::of(&[Settings::SETTINGS]).with_default("camera", "top for the point, back for the others");

/// The settings of AntSoccer.
pub(super) const SOCCER: &[Setting] = SOCCER_WITH_CAMERA.as_slice();
const SOCCER_WITH_CAMERA: &Table = &Table::of(&[SoccerSettings::SETTINGS]).with_default("camera", "back");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_documented() {
        swm_core::testing::assert_documented_defaults::<Settings>();
        swm_core::testing::assert_documented_defaults::<SoccerSettings>();
        let counts: Vec<String> = [Maze::Arena, Maze::Medium, Maze::Large, Maze::Giant, Maze::Teleport]
            .iter()
            .map(|maze| maze.free_cells().len().to_string())
            .collect();
        let [a, b, c, d, e] = counts.try_into().unwrap();
        assert!(SETTINGS[0].doc.contains(&format!("{a}, {b}, {c}, {d} and {e} free")), "{a} {b} {c} {d} {e}");
        assert!(SOCCER[0].doc.contains(&format!("{a} and {b} free")), "{a} {b}");
    }

    #[test]
    fn tasks_that_are_not_there_are_refused() {
        let arena =
            Settings { maze_type: Maze::Arena, mode: Mode::Task, task: Some(2), ..Settings::default() };
        assert!(arena.check(Body::Ant).unwrap_err().contains("1 to 1"));
        let task = |task| Settings { task: Some(task), ..Settings::default() };
        assert!(task(1).check(Body::Ant).unwrap_err().contains("mode=task"));
        assert!(Settings { mode: Mode::Task, ..task(5) }.check(Body::Ant).is_ok());
        assert!(arena.check(Body::AntSoccer).is_ok());
        assert!(Settings::default().check(Body::AntSoccer).unwrap_err().contains("`arena` and `medium`"));
    }
}
