//! `swm/SimplePointMaze-v0` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, Place, RowsMut,
    Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::SIMPLE_POINT_MAZE;
use super::factors::Factors;
use super::rendering::{Disc, Look};
use super::settings::Settings;
use super::walls::{MAX_ACTION, Room, SIDE};
use crate::artist::Artist;
use crate::ways::{Ways, distance};

// Field indices, in the order of `spec`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const PROPRIO: usize = 2;
const DISTANCE: usize = 3;
const GOAL_STATE: usize = 4;
const FACTORS: usize = 5;

/// Move a disc past walls to a goal. See the module's documentation.
pub struct SimplePointMaze {
    spec: EnvSpec,
    settings: Settings,
    factors: Factors,
    fov: Fov,
    room: Room,
    agent: [f32; 2],
    goal: [f32; 2],
    /// Ways to the goal, found when first asked for.
    ways: OnceLock<Ways>,
    image: Option<Image>,
}

/// What rendering needs.
struct Image {
    artist: Artist<Look>,
    goal: Vec<u8>,
    /// The goal image belongs to an earlier episode.
    goal_is_stale: bool,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    agent: [f32; 2],
    goal: [f32; 2],
}

fn check_position(position: [f32; 2]) -> Result<[f32; 2], String> {
    let is_inside = position.iter().all(|c| (0.0..=SIDE).contains(c));
    if is_inside {
        Ok(position)
    } else {
        Err(format!("the position {position:?} is not between 0 and {SIDE}"))
    }
}

/// The room of a state that [`Env::snapshot`] saved.
pub(super) fn saved_room(space: &FovSpace, state: &EnvState) -> Result<Room, EnvError> {
    load(space, state).map(|(_, fov)| Room::new(&fov))
}

fn load(space: &FovSpace, state: &EnvState) -> Result<(Saved, Fov), EnvError> {
    let saved: Saved = state.load(SIMPLE_POINT_MAZE.id)?;
    let foreign = |reason: String| EnvError::State { env: SIMPLE_POINT_MAZE.id.to_owned(), reason };
    for position in [saved.agent, saved.goal] {
        check_position(position).map_err(foreign)?;
    }
    let fov = space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
    Ok((saved, fov))
}

impl SimplePointMaze {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = SIMPLE_POINT_MAZE.id;
        let settings: Settings = config.parse_settings(id)?;
        let factors = Factors::new(id, &settings.init_value)?;
        let fov = factors.space.defaults();
        let image = config.image.map(|size| Image::new(size, &settings)).transpose();
        let image = image.map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        let mut env = Self {
            spec: spec(config.image, &factors.space),
            room: Room::new(&fov),
            agent: fov.vector("agent.position"),
            goal: fov.vector("goal.position"),
            settings,
            factors,
            fov,
            ways: OnceLock::new(),
            image,
        };
        env.refresh()?;
        Ok(env)
    }

    /// The position of a recorded row.
    fn recorded(&self, row: &BTreeMap<String, Value>) -> Result<[f32; 2], EnvError> {
        let wrong = |reason: String| EnvError::Reset { env: self.spec.id.clone(), reason };
        let column = ["state", "proprio"].into_iter().find(|column| row.contains_key(*column));
        let column =
            column.ok_or_else(|| wrong("start and goal need the column `state` or `proprio`".to_owned()))?;
        let value = row[column].cast(column, Dtype::F32, &[2])?;
        let Slice::F32(&[x, y]) = value.data.as_slice() else { unreachable!("cast to two f32") };
        check_position([x, y]).map_err(|reason| wrong(format!("`{column}`: {reason}")))
    }

    /// Euclidean distance to the goal, summed in f32 as in the reference.
    fn distance(&self) -> f32 {
        let [x, y] = [0, 1].map(|axis| self.agent[axis] - self.goal[axis]);
        (x * x + y * y).sqrt()
    }

    fn outcome(&self) -> Outcome {
        let success = self.distance() < self.fov.f32("goal.radius");
        Outcome { reward: if success { 1.0 } else { -0.01 }, terminated: success, success: Some(success) }
    }

    /// Takes over the factors and the goal of an episode.
    fn refresh(&mut self) -> Result<(), EnvError> {
        self.room = Room::new(&self.fov);
        self.ways = OnceLock::new();
        let Some(image) = &mut self.image else { return Ok(()) };
        let goal = self.settings.show_goal.then_some(self.goal);
        image.goal_is_stale = true;
        image
            .artist
            .set_look(Look::new(&self.fov, &self.room, goal))
            .map_err(|error| EnvError::Reset { env: self.spec.id.clone(), reason: error.to_string() })
    }

    fn disc(&self, center: [f32; 2]) -> Disc {
        Disc { center, radius: self.room.radius, color: self.fov.rgb("agent.color") }
    }
}

impl Env for SimplePointMaze {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let position =
            |row: &Option<BTreeMap<String, Value>>| row.as_ref().map(|row| self.recorded(row)).transpose();
        let (start, goal) = (position(&episode.options.start)?, position(&episode.options.goal)?);
        self.fov = self.factors.sample(&self.spec.id, episode, start, goal)?;
        self.agent = start.unwrap_or_else(|| self.fov.vector("agent.position"));
        self.goal = goal.unwrap_or_else(|| self.fov.vector("goal.position"));
        self.refresh()?;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let values = match action {
            Slice::F32(&[x, y]) if x.is_finite() && y.is_finite() => [x, y],
            _ => {
                let reason = format!("{action:?} is no action");
                return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
            }
        };
        self.agent = self.room.step(self.agent, values);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &self.goal);
        self.fov.write(FACTORS, out);
        let disc = self.disc(self.goal);
        if let Some(image) = &mut self.image {
            if image.goal_is_stale {
                let rendered = image.artist.render(&disc, &mut image.goal);
                rendered.expect("the goal image has the artist's size");
                image.goal_is_stale = false;
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        for field in [OBSERVATION, STATE, PROPRIO] {
            out.write(field, &self.agent);
        }
        out.write(DISTANCE, &[f64::from(self.distance())]);
        let disc = self.disc(self.agent);
        if let Some(image) = &mut self.image {
            let rendered = image.artist.render(&disc, out.at(self.spec.fields.len() - 2));
            rendered.expect("the pixel field has the artist's size");
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), agent: self.agent, goal: self.goal };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let (saved, fov) = load(&self.factors.space, state)?;
        // Planners return to states of one episode again and again: what does not change in it stays.
        let is_same_episode = fov == self.fov && saved.goal == self.goal;
        (self.fov, self.agent, self.goal) = (fov, saved.agent, saved.goal);
        if is_same_episode { Ok(()) } else { self.refresh() }
    }

    /// The length of the shortest way to the goal.
    fn task_cost(&self) -> Option<f64> {
        let ways = self.ways.get_or_init(|| self.room.ways(self.goal));
        let [agent, goal] = [self.agent, self.goal].map(|position| position.map(f64::from));
        let length = ways.leg(agent).length;
        // Where walls leave no way: as the crow flies, and worse than any way.
        Some(if length.is_finite() { length } else { distance(agent, goal) + f64::from(4.0 * SIDE) })
    }

    fn places(&self) -> Vec<Place> {
        let [x, y] = self.agent.map(|c| f64::from(c / SIDE));
        vec![Place { name: "agent", at: [x, 1.0 - y] }]
    }
}

impl Image {
    fn new(size: ImageSize, settings: &Settings) -> Result<Self, String> {
        let artist = Artist::new(size, settings.render).map_err(|error| error.to_string())?;
        let bytes = size.shape().iter().product();
        Ok(Self { artist, goal: vec![0; bytes], goal_is_stale: true })
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F32, &[2]),
        Field::step("state", Dtype::F32, &[2]),
        Field::step("proprio", Dtype::F32, &[2]),
        Field::step("distance_to_target", Dtype::F64, &[]),
        Field::episode("goal_state", Dtype::F32, &[2]),
    ];
    fields.extend(space.fields());
    if let Some(size) = image {
        fields.push(size.field(PIXELS));
        fields.push(Field::episode("goal", Dtype::U8, &size.shape()));
    }
    let bound = f64::from(MAX_ACTION);
    EnvSpec::new(SIMPLE_POINT_MAZE.id, Space::uniform_box(Dtype::F32, &[2], -bound, bound), fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "proprio"])
        .goal_columns(&["state", "proprio"])
}
