//! `swm/SimpleNavigation-v0`: reset, step, observation, images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvSpec, Episode, Field, ImageSize, Keypoint, Outcome, RowsMut, Slice, Space, Value};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::{factors, maze};
use super::maze::{Cell, Distances, Maze, SIDE, next_to};
use super::rendering::{Artist, Shown};
use crate::settings::FactorDefaults;

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const GOAL_STATE: usize = 2;
const GOAL_PROPRIO: usize = 3;
const WALLS: usize = 4;

/// The actions.
pub(super) const LEFT: i64 = 0;
pub(super) const RIGHT: i64 = 1;
pub(super) const FORWARD: i64 = 2;

/// Walk through a maze. See the module's documentation.
pub(super) struct SimpleNavigation {
    /// Of the factors, or recorded.
    maze: Maze,
    distances: Distances,
}

/// A cell and where the agent on it looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Pose {
    cell: Cell,
    direction: i64,
}

/// What changes in an episode, and the maze with its goal.
#[derive(Serialize, Deserialize)]
pub(super) struct Walk {
    walls: Vec<u8>,
    agent: Pose,
    goal: Pose,
}

impl Walk {
    /// The maze, if everything fits into it.
    fn check(&self) -> Result<Maze, SceneError> {
        let maze = Maze::from_walls(&self.walls).map_err(|reason| format!("its walls: {reason}"))?;
        for Pose { cell, direction } in [self.agent, self.goal] {
            if !maze.is_free(cell) || !(0..4).contains(&direction) {
                return Err(format!("no agent stands on {cell:?} in direction {direction}").into());
            }
        }
        Ok(maze)
    }

    /// Steps along columns and rows to the goal.
    fn distance(&self) -> i64 {
        [0, 1].map(|axis| (self.agent.cell[axis] - self.goal.cell[axis]).abs()).iter().sum()
    }
}

/// What the rows of a dataset give of an episode.
struct Recorded {
    start: Option<Pose>,
    goal: Option<Pose>,
    maze: Option<Maze>,
}

impl Recorded {
    fn of(episode: &Episode<'_>) -> Result<Self, SceneError> {
        let options = episode.options;
        let (start, goal) = (pose("start", &options.start)?, pose("goal", &options.goal)?);
        let walls = options.start.as_ref().and_then(|row| row.get("walls"));
        let Some(walls) = walls.map(|walls| walls.cast("walls", Dtype::U8, &[SIDE, SIDE])).transpose()?
        else {
            return Ok(Self { start, goal, maze: None });
        };
        let maze = Maze::from_walls(walls.data.as_slice().get().expect("cast to bytes"));
        let maze = maze.map_err(|reason| format!("the recorded `walls`: {reason}"))?;
        Ok(Self { start, goal, maze: Some(maze) })
    }
}

/// Cell and direction of a recorded row.
fn pose(what: &str, row: &Option<BTreeMap<String, Value>>) -> Result<Option<Pose>, SceneError> {
    let Some(row) = row else { return Ok(None) };
    let value = row.get("state").ok_or_else(|| format!("a {what} needs the column `state`"))?;
    let value = value.cast("state", Dtype::I64, &[5])?;
    let Slice::I64(&[x, y, direction, ..]) = value.data.as_slice() else {
        unreachable!("cast to five integers")
    };
    let is_inside = [x, y].iter().all(|c| (1..SIDE as i64 - 1).contains(c));
    if !is_inside || !(0..4).contains(&direction) {
        return Err(format!(
            "the `state` of the recorded {what} has column {x}, row {y}, direction {direction}; columns and rows are 1 to {}, \
             directions 0 to 3",
            SIDE - 2
        )
        .into());
    }
    Ok(Some(Pose { cell: [x, y], direction }))
}

impl SimpleNavigation {
    fn shown(&self, agent: Pose, goal: Pose) -> Shown {
        Shown { maze: self.maze, goal: goal.cell, agent: agent.cell, direction: agent.direction }
    }
}

impl Scene for SimpleNavigation {
    const ID: &'static str = "swm/SimpleNavigation-v0";
    type Settings = FactorDefaults;
    type State = Walk;
    type Canvas = Artist;

    fn factors(settings: &FactorDefaults) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let fields = vec![
            Field::step("state", Dtype::I64, &[5]),
            Field::step("proprio", Dtype::I64, &[3]),
            Field::episode("goal_state", Dtype::I64, &[5]),
            Field::episode("goal_proprio", Dtype::I64, &[3]),
            Field::episode("walls", Dtype::U8, &[SIDE, SIDE]),
        ];
        EnvSpec::new(Self::ID, Space::Discrete { n: 3, start: 0 }, fields)
            .time_step_s(0.1)
            .start_columns(&["state", "walls"])
            .goal_columns(&["state"])
    }

    fn canvas(_: &FactorDefaults, size: ImageSize) -> Result<Artist, SceneError> {
        Ok(Artist::new(size).map_err(|error| error.to_string())?)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        let Recorded { start, goal, .. } = Recorded::of(episode)?;
        Ok(space.sample_where(Self::ID, episode, |rule| match rule.owner {
            "agent.position" => start.is_none(),
            // Of two rules, one is about the agent, too.
            _ => goal.is_none() && (start.is_none() || !rule.reads.contains(&"agent.position")),
        })?)
    }

    fn new(_: &FactorDefaults, fov: &Fov) -> Result<Self, SceneError> {
        let maze = maze(fov);
        Ok(Self { maze, distances: maze.distances(fov.vector("goal.position")) })
    }

    fn start(&mut self, _: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Walk, SceneError> {
        let Recorded { start, goal, maze } = Recorded::of(episode)?;
        let sampled = |cell, direction| Pose { cell: fov.vector(cell), direction: fov.i64(direction) };
        let agent = start.unwrap_or_else(|| sampled("agent.position", "agent.direction"));
        let goal = goal.unwrap_or_else(|| sampled("goal.position", "goal.agent.direction"));
        self.maze = maze.unwrap_or(self.maze);
        // Without rows, the factors' constraints hold.
        let has_rows = episode.options.start.is_some() || episode.options.goal.is_some();
        for (what, Pose { cell: [x, y], .. }) in [("start", agent), ("goal", goal)] {
            if has_rows && !self.maze.is_free([x, y]) {
                return Err(format!(
                    "the {what} [{x}, {y}] is a wall of the maze; give the row's column `walls`, or the maze's factors, too"
                )
                .into());
            }
        }
        Ok(Walk { walls: self.maze.walls.to_vec(), agent, goal })
    }

    fn take_goal(&mut self, walk: &Walk) {
        self.distances = self.maze.distances(walk.goal.cell);
    }

    fn restore(&mut self, walk: &Walk) -> Result<(), SceneError> {
        self.maze = walk.check()?;
        Ok(())
    }

    fn is_same_goal(a: &Walk, b: &Walk) -> bool {
        (&a.walls, a.goal) == (&b.walls, b.goal)
    }

    fn step(&mut self, walk: &mut Walk, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let Pose { cell, direction } = &mut walk.agent;
        match action {
            Slice::I64(&[LEFT]) => *direction = (*direction + 3) % 4,
            Slice::I64(&[RIGHT]) => *direction = (*direction + 1) % 4,
            Slice::I64(&[FORWARD]) => {
                let next = next_to(*cell, *direction);
                if self.maze.is_free(next) {
                    *cell = next;
                }
            }
            _ => return Err(format!("{action:?} is no action: 0 left, 1 right, 2 forward").into()),
        }
        Ok(self.outcome(walk))
    }

    fn outcome(&self, walk: &Walk) -> Outcome {
        let success = walk.agent.cell == walk.goal.cell;
        Outcome { reward: -(walk.distance() as f64), terminated: success, success: Some(success) }
    }

    fn write_episode(&self, walk: &Walk, out: &mut RowsMut<'_>) {
        let Pose { cell: [x, y], direction } = walk.goal;
        out.write(GOAL_STATE, &[x, y, direction, x, y]);
        out.write(GOAL_PROPRIO, &[x, y, direction]);
        out.write(WALLS, &self.maze.walls);
    }

    fn observe(&self, walk: &Walk, out: &mut RowsMut<'_>) {
        let Pose { cell: [x, y], direction } = walk.agent;
        let [to_x, to_y] = walk.goal.cell;
        out.write(STATE, &[x, y, direction, to_x, to_y]);
        out.write(PROPRIO, &[x, y, direction]);
    }

    fn dress(&self, _: &Walk, _: &Fov, _: &mut Artist) -> Result<(), SceneError> {
        Ok(())
    }

    fn render(&self, walk: &Walk, artist: &mut Artist, pixels: &mut [u8]) {
        let rendered = artist.render(&self.shown(walk.agent, walk.goal), pixels);
        rendered.expect("the pixel field has the artist's size");
    }

    fn render_goal(&self, walk: &Walk, artist: &mut Artist, pixels: &mut [u8]) {
        let rendered = artist.render(&self.shown(walk.goal, walk.goal), pixels);
        rendered.expect("the goal image has the artist's size");
    }

    /// The number of actions to the goal; of a goal without a way, more than any way takes.
    fn task_cost(&self, walk: &Walk) -> Option<f64> {
        let actions = self.distances.actions(walk.agent.cell, walk.agent.direction);
        Some(actions.map_or((4 * SIDE * SIDE) as f64, f64::from))
    }

    fn keypoints(&self, walk: &Walk) -> Vec<Keypoint> {
        let at = walk.agent.cell.map(|c| (c as f64 + 0.5) / SIDE as f64);
        vec![Keypoint { name: "agent", at }]
    }
}
