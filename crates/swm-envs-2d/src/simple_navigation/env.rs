//! `swm/SimpleNavigation-v0` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, Place, RowsMut,
    Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::SIMPLE_NAVIGATION;
use super::factors::{factors, maze};
use super::maze::{Cell, Distances, Maze, SIDE, next_to};
use super::rendering::{Artist, Scene};
use crate::settings::FactorDefaults;

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const GOAL_STATE: usize = 2;
const GOAL_PROPRIO: usize = 3;
const WALLS: usize = 4;
const FACTORS: usize = 5;

/// The actions.
pub(super) const LEFT: i64 = 0;
pub(super) const RIGHT: i64 = 1;
pub(super) const FORWARD: i64 = 2;

/// Walk through a maze. See the module's documentation.
pub struct SimpleNavigation {
    spec: EnvSpec,
    settings: FactorDefaults,
    space: FovSpace,
    fov: Fov,
    maze: Maze,
    agent: Pose,
    goal: Pose,
    distances: Distances,
    image: Option<Image>,
}

/// A cell and where the agent on it looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Pose {
    cell: Cell,
    direction: i64,
}

/// What rendering needs.
struct Image {
    artist: Artist,
    goal: Vec<u8>,
    /// The goal image belongs to an earlier episode.
    goal_is_stale: bool,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    walls: Vec<u8>,
    agent: Pose,
    goal: Pose,
}

/// The distances of a state that [`Env::snapshot`] saved.
pub(super) fn saved_distances(state: &EnvState) -> Result<Distances, EnvError> {
    let saved: Saved = state.load(SIMPLE_NAVIGATION.id)?;
    saved.check().map(|maze| maze.distances(saved.goal.cell))
}

impl Saved {
    /// The maze, if everything fits into it.
    fn check(&self) -> Result<Maze, EnvError> {
        let foreign = |reason: String| EnvError::State { env: SIMPLE_NAVIGATION.id.to_owned(), reason };
        let maze = Maze::from_walls(&self.walls).map_err(|reason| foreign(format!("its walls: {reason}")))?;
        for Pose { cell, direction } in [self.agent, self.goal] {
            if !maze.is_free(cell) || !(0..4).contains(&direction) {
                return Err(foreign(format!("no agent stands on {cell:?} in direction {direction}")));
            }
        }
        Ok(maze)
    }
}

impl SimpleNavigation {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = SIMPLE_NAVIGATION.id;
        let settings: FactorDefaults = config.parse_settings(id)?;
        let space = factors([false; 2]).with_defaults(id, &settings.init_value)?;
        let fov = space.defaults();
        let image = config.image.map(Image::new).transpose();
        let image = image.map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        let (maze, [agent, goal]) = (maze(&fov), poses(&fov));
        Ok(Self {
            spec: spec(config.image, &space),
            distances: maze.distances(goal.cell),
            settings,
            space,
            fov,
            maze,
            agent,
            goal,
            image,
        })
    }

    fn wrong(&self, reason: String) -> EnvError {
        EnvError::Reset { env: self.spec.id.clone(), reason }
    }

    /// Cell and direction of a recorded row.
    fn recorded(&self, what: &str, row: &BTreeMap<String, Value>) -> Result<Pose, EnvError> {
        let value =
            row.get("state").ok_or_else(|| self.wrong(format!("a {what} needs the column `state`")))?;
        let value = value.cast("state", Dtype::I64, &[5])?;
        let Slice::I64(&[x, y, direction, ..]) = value.data.as_slice() else {
            unreachable!("cast to five integers")
        };
        let is_inside = [x, y].iter().all(|c| (1..SIDE as i64 - 1).contains(c));
        if !is_inside || !(0..4).contains(&direction) {
            return Err(self.wrong(format!(
                "the `state` of the recorded {what} has column {x}, row {y}, direction {direction}; columns and rows are 1 to {}, \
                 directions 0 to 3",
                SIDE - 2
            )));
        }
        Ok(Pose { cell: [x, y], direction })
    }

    /// Steps along columns and rows to the goal.
    fn distance(&self) -> i64 {
        [0, 1].map(|axis| (self.agent.cell[axis] - self.goal.cell[axis]).abs()).iter().sum()
    }

    fn outcome(&self) -> Outcome {
        let success = self.agent.cell == self.goal.cell;
        Outcome { reward: -(self.distance() as f64), terminated: success, success: Some(success) }
    }

    fn scene(&self, agent: Pose) -> Scene {
        Scene { maze: self.maze, goal: self.goal.cell, agent: agent.cell, direction: agent.direction }
    }

    /// Takes over the maze and the goal of an episode.
    fn refresh(&mut self) {
        self.distances = self.maze.distances(self.goal.cell);
        if let Some(image) = &mut self.image {
            image.goal_is_stale = true;
        }
    }
}

/// The agent and the goal of an assignment.
fn poses(fov: &Fov) -> [Pose; 2] {
    [("agent.position", "agent.direction"), ("goal.position", "goal.agent.direction")]
        .map(|(cell, direction)| Pose { cell: fov.vector(cell), direction: fov.i64(direction) })
}

impl Env for SimpleNavigation {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let options = episode.options;
        let pose = |what: &str, row: &Option<BTreeMap<String, Value>>| {
            row.as_ref().map(|row| self.recorded(what, row)).transpose()
        };
        let (start, goal) = (pose("start", &options.start)?, pose("goal", &options.goal)?);
        let walls = options.start.as_ref().and_then(|row| row.get("walls"));
        let recorded_maze =
            match walls.map(|walls| walls.cast("walls", Dtype::U8, &[SIDE, SIDE])).transpose()? {
                Some(Value { data: walls, .. }) => {
                    let cells: &[u8] = walls.as_slice().get().expect("cast to bytes");
                    let maze = Maze::from_walls(cells);
                    Some(maze.map_err(|reason| self.wrong(format!("the recorded `walls`: {reason}")))?)
                }
                None => None,
            };
        let recorded = [start.is_some(), goal.is_some()];
        let fov = match recorded {
            [false, false] => self.space.sample(&self.spec.id, episode)?,
            _ => factors(recorded)
                .with_defaults(&self.spec.id, &self.settings.init_value)?
                .sample(&self.spec.id, episode)?,
        };
        let maze = recorded_maze.unwrap_or_else(|| maze(&fov));
        let [from_factors, goal_from_factors] = poses(&fov);
        let (agent, goal) = (start.unwrap_or(from_factors), goal.unwrap_or(goal_from_factors));
        for (what, Pose { cell: [x, y], .. }) in [("start", agent), ("goal", goal)] {
            if !maze.is_free([x, y]) {
                return Err(self.wrong(format!(
                    "the {what} [{x}, {y}] is a wall of the maze; give the row's column `walls`, or the maze's factors, too"
                )));
            }
        }
        (self.fov, self.maze, self.agent, self.goal) = (fov, maze, agent, goal);
        self.refresh();
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let Pose { cell, direction } = self.agent;
        match action {
            Slice::I64(&[LEFT]) => self.agent.direction = (direction + 3) % 4,
            Slice::I64(&[RIGHT]) => self.agent.direction = (direction + 1) % 4,
            Slice::I64(&[FORWARD]) => {
                let next = next_to(cell, direction);
                if self.maze.is_free(next) {
                    self.agent.cell = next;
                }
            }
            _ => {
                let reason = format!("{action:?} is no action: 0 left, 1 right, 2 forward");
                return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
            }
        }
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let Pose { cell: [x, y], direction } = self.goal;
        out.write(GOAL_STATE, &[x, y, direction, x, y]);
        out.write(GOAL_PROPRIO, &[x, y, direction]);
        out.write(WALLS, &self.maze.walls);
        self.fov.write(FACTORS, out);
        let scene = self.scene(self.goal);
        if let Some(image) = &mut self.image {
            if image.goal_is_stale {
                let rendered = image.artist.render(&scene, &mut image.goal);
                rendered.expect("the goal image has the artist's size");
                image.goal_is_stale = false;
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Pose { cell: [x, y], direction } = self.agent;
        let [to_x, to_y] = self.goal.cell;
        out.write(STATE, &[x, y, direction, to_x, to_y]);
        out.write(PROPRIO, &[x, y, direction]);
        let scene = self.scene(self.agent);
        if let Some(image) = &mut self.image {
            let rendered = image.artist.render(&scene, out.at(self.spec.fields.len() - 2));
            rendered.expect("the pixel field has the artist's size");
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let (fov, walls) = (self.fov.save(), self.maze.walls.to_vec());
        state.store(&self.spec.id, &Saved { fov, walls, agent: self.agent, goal: self.goal })
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let maze = saved.check()?;
        let fov = self
            .space
            .recall(&saved.fov)
            .map_err(|error| EnvError::State { env: self.spec.id.clone(), reason: error.to_string() })?;
        // Planners return to states of one episode again and again: what does not change in it stays.
        let is_same_episode = maze == self.maze && saved.goal == self.goal;
        (self.fov, self.maze, self.agent, self.goal) = (fov, maze, saved.agent, saved.goal);
        if !is_same_episode {
            self.refresh();
        }
        Ok(())
    }

    /// The number of actions to the goal; of a goal without a way, more than any way takes.
    fn task_cost(&self) -> Option<f64> {
        let actions = self.distances.actions(self.agent.cell, self.agent.direction);
        Some(actions.map_or((4 * SIDE * SIDE) as f64, f64::from))
    }

    fn places(&self) -> Vec<Place> {
        let at = self.agent.cell.map(|c| (c as f64 + 0.5) / SIDE as f64);
        vec![Place { name: "agent", at }]
    }
}

impl Image {
    fn new(size: ImageSize) -> Result<Self, String> {
        let artist = Artist::new(size).map_err(|error| error.to_string())?;
        let bytes = size.shape().iter().product();
        Ok(Self { artist, goal: vec![0; bytes], goal_is_stale: true })
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("state", Dtype::I64, &[5]),
        Field::step("proprio", Dtype::I64, &[3]),
        Field::episode("goal_state", Dtype::I64, &[5]),
        Field::episode("goal_proprio", Dtype::I64, &[3]),
        Field::episode("walls", Dtype::U8, &[SIDE, SIDE]),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    EnvSpec::new(SIMPLE_NAVIGATION.id, Space::Discrete { n: 3, start: 0 }, fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "walls"])
        .goal_columns(&["state"])
}
