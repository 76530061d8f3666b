//! `swm/Piecewise-v0` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, Place, RowsMut,
    Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::PIECEWISE;
use super::factors::factors;
use super::rendering::Look;
use super::settings::Settings;
use super::zones::Zones;
use crate::settings::with_defaults;
use crate::tworoom_v2::dot::Dot;
use crate::tworoom_v2::rendering::Artist;
use crate::tworoom_v2::room::{IMAGE_PX, SUCCESS_PX, distance_f32};

// Field indices, in the order of `fields`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const PROPRIO: usize = 2;
const DISTANCE: usize = 3;
const GOAL_STATE: usize = 4;
const FACTORS: usize = 5;

const TARGET: &str = "target.position";
const LEAST: &str = "task.min_steps";
/// Samples of a target that is far enough, before the farthest of them is taken.
const MAX_TARGETS: usize = 1000;

/// Walk to a target over zones that push. See the module's documentation.
pub struct Piecewise {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    zones: Zones,
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

/// The zones of a state that [`Env::snapshot`] saved.
pub(super) fn saved_zones(settings: &Settings, state: &EnvState) -> Result<Zones, EnvError> {
    let saved: Saved = state.load(PIECEWISE.id)?;
    Ok(Zones::new(&recall(&factors(settings.grid_n), &saved)?, settings.grid_n))
}

fn recall(space: &FovSpace, saved: &Saved) -> Result<Fov, EnvError> {
    let foreign = |reason: String| EnvError::State { env: PIECEWISE.id.to_owned(), reason };
    for position in [saved.agent, saved.target] {
        check_position(position).map_err(foreign)?;
    }
    space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))
}

/// Refuses positions that are not in the image.
fn check_position(position: [f32; 2]) -> Result<(), String> {
    let is_inside = position.iter().all(|c| (0.0..=IMAGE_PX as f32).contains(c));
    if is_inside { Ok(()) } else { Err(format!("the position {position:?} is not between 0 and {IMAGE_PX}")) }
}

impl Piecewise {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = PIECEWISE.id;
        let settings: Settings = config.parse_settings(id)?;
        let wrong = |reason: String| EnvError::Setting { env: id.to_owned(), reason };
        settings.check().map_err(wrong)?;
        let space = with_defaults(factors(settings.grid_n), id, &settings.init_value)?;
        let fov = space.defaults();
        let image = config.image.map(|size| Image::new(size, &settings)).transpose().map_err(wrong)?;
        let mut env = Self {
            spec: spec(config.image, &space),
            zones: Zones::new(&fov, settings.grid_n),
            agent: fov.vector("agent.position"),
            target: fov.vector(TARGET),
            settings,
            space,
            fov,
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

    /// The target of an episode: that of the factor, unless `task.min_steps` asks for a farther one.
    fn sampled_target(&self, episode: &Episode<'_>) -> [f32; 2] {
        let target: [f32; 2] = self.fov.vector(TARGET);
        let is_asked = self.fov.touched(LEAST) || self.settings.init_value.contains_key(LEAST);
        if !is_asked || episode.options.variation_values.contains_key(TARGET) {
            return target;
        }
        let least_px = self.fov.i64(LEAST) as f32 * self.zones.speed;
        let factor = self.spec.factors.iter().find(|factor| factor.name == TARGET);
        let space = &factor.expect("a factor of the table").space;
        let mut stream = episode.seed.stream("goal_state target.position");
        let (mut farthest, mut way_px) = (target, distance_f32(self.agent, target));
        for _ in 0..MAX_TARGETS {
            if way_px >= least_px {
                break;
            }
            let sampled = space.sample(&mut stream);
            let Slice::F32(&[x, y]) = sampled.data.as_slice() else { unreachable!("a box of two f32") };
            let way = distance_f32(self.agent, [x, y]);
            if way > way_px {
                (farthest, way_px) = ([x, y], way);
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
        image.agent = Dot {
            center: self.agent,
            radius: self.fov.f32("agent.radius"),
            color: self.fov.rgb("agent.color"),
        };
        image.goal_is_stale = true;
        let rendered = image.artist.set_look(Look::new(&self.fov, &self.zones, self.target));
        rendered.map_err(|error| self.reset_error(error.to_string()))
    }
}

impl Env for Piecewise {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        self.zones = Zones::new(&self.fov, self.settings.grid_n);
        self.agent = match &episode.options.start {
            Some(row) => self.recorded(row)?,
            None => self.fov.vector("agent.position"),
        };
        self.target = match &episode.options.goal {
            Some(row) => self.recorded(row)?,
            None => self.sampled_target(episode),
        };
        self.refresh_look()?;
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
        self.agent = self.zones.step(self.agent, values);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &self.target);
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            if image.goal_is_stale {
                let mut goal = std::mem::take(&mut image.goal);
                image.render(self.target, &mut goal);
                (image.goal, image.goal_is_stale) = (goal, false);
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let ([x, y], [to_x, to_y]) = (self.agent, self.target);
        out.write(OBSERVATION, &[x, y, to_x, to_y]);
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
        let is_same_look = fov == self.fov && saved.target == self.target;
        (self.fov, self.agent, self.target) = (fov, saved.agent, saved.target);
        if !is_same_look {
            self.zones = Zones::new(&self.fov, self.settings.grid_n);
            self.refresh_look()?;
        }
        Ok(())
    }

    /// Pixels to the target.
    fn task_cost(&self) -> Option<f64> {
        Some(f64::from(self.distance()))
    }

    fn places(&self) -> Vec<Place> {
        let at = self.agent.map(|c| (f64::from(c) + 0.5) / IMAGE_PX as f64);
        vec![Place { name: "agent", at }]
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
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F32, &[4]),
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
    EnvSpec::new(PIECEWISE.id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "proprio"])
        .goal_columns(&["state", "proprio"])
}
