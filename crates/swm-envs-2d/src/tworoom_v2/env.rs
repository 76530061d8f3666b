//! `swm/TwoRoom-v2` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Field, ImageSize, Outcome,
    RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::TWO_ROOM_V2;
use super::dot::Dot;
use super::factors::factors;
use super::rendering::{Artist, Look};
use super::room::{IMAGE_PX, Room, SUCCESS_PX, distance_f32};
use super::route;
use super::settings::Settings;
use crate::settings::with_defaults;

// Field indices, in the order of `fields`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const PROPRIO: usize = 2;
const DISTANCE: usize = 3;
const GOAL_STATE: usize = 4;
const FACTORS: usize = 5;

/// Samples of a target that is far enough, before the farthest of them is taken.
const MAX_TARGETS: usize = 1000;

/// Walk from one room to a target in either. See the module's documentation.
pub struct TwoRoom {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    room: Room,
    agent: [f32; 2],
    target: [f32; 2],
    image: Option<Image>,
}

/// What rendering needs.
struct Image {
    artist: Artist<Look>,
    agent: Dot,
    goal: Vec<u8>,
    /// The goal image belongs to an earlier episode.
    goal_is_stale: bool,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    agent: [f32; 2],
    target: [f32; 2],
}

/// The factor table as the settings have it.
pub(super) fn factors_with(settings: &Settings) -> Result<FovSpace, EnvError> {
    with_defaults(factors(), TWO_ROOM_V2.id, &settings.init_value)
}

/// The rooms of a state that [`Env::snapshot`] saved.
pub(super) fn saved_room(space: &FovSpace, state: &EnvState) -> Result<Room, EnvError> {
    let saved: Saved = state.load(TWO_ROOM_V2.id)?;
    Ok(Room::new(&recall(space, &saved)?))
}

fn recall(space: &FovSpace, saved: &Saved) -> Result<Fov, EnvError> {
    let foreign = |reason: String| EnvError::State { env: TWO_ROOM_V2.id.to_owned(), reason };
    for position in [saved.agent, saved.target] {
        check_position(position).map_err(foreign)?;
    }
    space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))
}

/// Refuses positions that are not in the image.
fn check_position(position: [f32; 2]) -> Result<(), String> {
    let inside =
        (0.0..=IMAGE_PX as f32).contains(&position[0]) && (0.0..=IMAGE_PX as f32).contains(&position[1]);
    if inside { Ok(()) } else { Err(format!("the position {position:?} is not between 0 and {IMAGE_PX}")) }
}

impl TwoRoom {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = TWO_ROOM_V2.id;
        let settings: Settings = config.parse_settings(id)?;
        let wrong = |reason: String| EnvError::Setting { env: id.to_owned(), reason };
        let space = factors_with(&settings)?;
        let fov = space.defaults();
        let (agent, target) = (fov.vector("agent.position"), fov.vector("target.position"));
        let image = config.image.map(|size| Image::new(size, &settings)).transpose().map_err(wrong)?;
        let mut env = Self {
            spec: spec(config.image, &space),
            room: Room::new(&fov),
            settings,
            space,
            fov,
            agent,
            target,
            image,
        };
        env.refresh_look()?;
        Ok(env)
    }

    fn reset_error(&self, reason: impl Into<String>) -> EnvError {
        EnvError::Reset { env: self.spec.id.clone(), reason: reason.into() }
    }

    /// The position of a recorded row.
    fn recorded(&self, row: &BTreeMap<String, Value>) -> Result<[f32; 2], EnvError> {
        let column = ["state", "proprio"].into_iter().find(|column| row.contains_key(*column));
        let column =
            column.ok_or_else(|| self.reset_error("start and goal need the column `state` or `proprio`"))?;
        let value = row[column].cast(column, Dtype::F32, &[2])?;
        let Slice::F32(&[x, y]) = value.data.as_slice() else { unreachable!("cast to two f32") };
        check_position([x, y]).map_err(|reason| self.reset_error(format!("`{column}`: {reason}")))?;
        Ok([x, y])
    }

    /// The target that an episode draws: that of the factor, unless `task.min_steps` asks for a farther one.
    fn drawn_target(&self, episode: &Episode<'_>) -> [f32; 2] {
        const FACTOR: &str = "target.position";
        const LEAST: &str = "task.min_steps";
        let target: [f32; 2] = self.fov.vector(FACTOR);
        let is_asked = self.fov.touched(LEAST) || self.settings.init_value.contains_key(LEAST);
        if !is_asked || episode.options.variation_values.contains_key(FACTOR) {
            return target;
        }
        let least_px = self.fov.i64(LEAST) as f64 * f64::from(self.room.speed);
        self.far_target(target, least_px, episode.seed)
    }

    /// `target`, or the first of many draws that is at least `least_px` away, or the farthest of them all.
    fn far_target(&self, target: [f32; 2], least_px: f64, seed: EpisodeSeed) -> [f32; 2] {
        let way_to = |target: [f32; 2]| {
            let [from, to] = [self.agent, target].map(|position| position.map(f64::from));
            route::way(&self.room, from, to).length
        };
        let factor = self.spec.factors.iter().find(|factor| factor.name == "target.position");
        let space = &factor.expect("a factor of the table").space;
        let mut stream = seed.stream("goal_state target.position");
        let (mut farthest, mut way_px) = (target, way_to(target));
        for _ in 0..MAX_TARGETS {
            if way_px >= least_px {
                break;
            }
            let drawn = space.sample(&mut stream);
            let Slice::F32(&[x, y]) = drawn.data.as_slice() else { unreachable!("a box of two f32") };
            let length = way_to([x, y]);
            if length > way_px {
                (farthest, way_px) = ([x, y], length);
            }
        }
        farthest
    }

    fn distance(&self) -> f32 {
        distance_f32(self.agent, self.target)
    }

    fn outcome(&self) -> Outcome {
        let success = f64::from(self.distance()) < SUCCESS_PX;
        Outcome { reward: 0.0, terminated: success, success: Some(success) }
    }

    fn refresh_look(&mut self) -> Result<(), EnvError> {
        let Some(image) = &mut self.image else { return Ok(()) };
        let look = Look::new(&self.fov, self.target, &self.settings);
        image.agent = Dot {
            center: self.agent,
            radius: self.fov.f32("agent.radius"),
            color: self.fov.rgb("agent.color"),
        };
        image.goal_is_stale = true;
        let drawn = image.artist.set_look(look);
        drawn.map_err(|error| self.reset_error(error.to_string()))
    }
}

impl Env for TwoRoom {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = match (self.space.sample(&self.spec.id, episode), &episode.options.start) {
            // A recorded start stands elsewhere than the factor says: what counts is whether it can stand there.
            (Err(EnvError::Constraint { .. }), Some(row)) => {
                let in_use = [("agent.position", Value::vector(&self.recorded(row)?))];
                self.space.sample_in_use(&self.spec.id, episode, &in_use)?
            }
            (drawn, _) => drawn?,
        };
        self.room = Room::new(&self.fov);
        self.agent = match &episode.options.start {
            Some(row) => self.recorded(row)?,
            None => self.fov.vector("agent.position"),
        };
        self.target = match &episode.options.goal {
            Some(row) => self.recorded(row)?,
            None => self.drawn_target(episode),
        };
        self.refresh_look()?;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let Slice::F32(&[x, y]) = action else {
            let reason = format!("{} values of {} are no action", action.len(), action.dtype());
            return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
        };
        self.agent = self.room.step(self.agent, [x, y]);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &self.target);
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            if image.goal_is_stale {
                image.render_goal(self.target);
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let observation: &mut [f32] = out.at(OBSERVATION);
        observation.fill(0.0);
        observation[..2].copy_from_slice(&self.agent);
        observation[2..4].copy_from_slice(&self.target);
        for (pair, door) in observation[4..].chunks_exact_mut(2).zip(self.room.doors()) {
            pair.copy_from_slice(
                &self.room.position(super::room::WALL_CENTER_PX, door.center).map(|c| c as f32),
            );
        }
        out.write(STATE, &self.agent);
        out.write(PROPRIO, &self.agent);
        out.write(DISTANCE, &[f64::from(self.distance())]);
        if let Some(image) = &mut self.image {
            image.render(self.agent, out.at(self.spec.fields.len() - 2));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), agent: self.agent, target: self.target };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let fov = recall(&self.space, &saved)?;
        let same_look = fov == self.fov && saved.target == self.target;
        (self.fov, self.agent, self.target) = (fov, saved.agent, saved.target);
        if !same_look {
            self.room = Room::new(&self.fov);
            self.refresh_look()?;
        }
        Ok(())
    }

    /// Pixels to walk to the target, through a door if need be.
    fn task_cost(&self) -> Option<f64> {
        let [agent, target] = [self.agent, self.target].map(|position| position.map(f64::from));
        Some(route::way(&self.room, agent, target).length)
    }
}

impl Image {
    fn new(size: ImageSize, settings: &Settings) -> Result<Self, String> {
        let artist = Artist::new(size, settings.render).map_err(|error| error.to_string())?;
        let agent = Dot { center: [0.0; 2], radius: 1.0, color: [0; 3] };
        let bytes = size.shape().iter().product();
        Ok(Self { artist, agent, goal: vec![0; bytes], goal_is_stale: true })
    }

    fn render(&mut self, agent: [f32; 2], out: &mut [u8]) {
        let rendered = self.artist.render(&Dot { center: agent, ..self.agent }, out);
        rendered.expect("the pixel field has the artist's size");
    }

    fn render_goal(&mut self, target: [f32; 2]) {
        let mut goal = std::mem::take(&mut self.goal);
        self.render(target, &mut goal);
        self.goal = goal;
        self.goal_is_stale = false;
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F32, &[10]),
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
    EnvSpec::new(TWO_ROOM_V2.id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "proprio"])
        .goal_columns(&["state", "proprio"])
}
