//! The environment of every task: reset, step, observation, images, saved states.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, Place, RowsMut,
    Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};
use swm_render::{Geometry, Renderer};

use super::settings::Settings;
use super::task::{Step, Task, colors, factors};

// Field indices, in the order of `fields`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const SIMULATOR_STATE: usize = 2;
const FACTORS: usize = 3;

/// The column that holds the whole state of the simulator.
pub(super) const SIMULATOR_STATE_COLUMN: &str = "simulator_state";

/// An environment of classic control. See the module's documentation.
pub(super) struct ClassicControl<T: Task> {
    spec: EnvSpec,
    time_limit: u64,
    space: FovSpace,
    fov: Fov,
    task: T,
    moving: Moving<T::State>,
    renderer: Option<Renderer>,
}

/// What changes in an episode.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Moving<S> {
    state: S,
    /// The last action, which the pendulum shows; 0 at the start.
    action: f32,
    steps: u64,
    has_ended: bool,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
#[serde(bound(deserialize = "S: DeserializeOwned"))]
struct Saved<S> {
    fov: SavedFov,
    moving: Moving<S>,
}

impl<S> Moving<S> {
    fn at(state: S) -> Self {
        Self { state, action: 0.0, steps: 0, has_ended: false }
    }
}

/// The task under the factors of a state that [`Env::snapshot`] saved.
pub(super) fn saved_task<T: Task>(space: &FovSpace, state: &EnvState) -> Result<T, EnvError> {
    let saved: Saved<T::State> = state.load(T::ID)?;
    Ok(T::new(&recall::<T>(space, &saved.fov)?))
}

fn recall<T: Task>(space: &FovSpace, saved: &SavedFov) -> Result<Fov, EnvError> {
    let foreign =
        |error: swm_fov::FovError| EnvError::State { env: T::ID.to_owned(), reason: error.to_string() };
    space.recall(saved).map_err(foreign)
}

impl<T: Task> ClassicControl<T> {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub(super) fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let settings: Settings = config.parse_settings(T::ID)?;
        let space = factors::<T>().with_defaults(T::ID, &settings.init_value)?;
        let fov = space.defaults();
        let task = T::new(&fov);
        let renderer = config.image.map(|ImageSize { height, width }| {
            Renderer::new(settings.render.into(), Geometry::surface(T::SURFACE, height, width))
        });
        let renderer = renderer
            .transpose()
            .map_err(|error| EnvError::Setting { env: T::ID.to_owned(), reason: error.to_string() })?;
        let start = task.start(&mut swm_core::EpisodeSeed::new(0).stream("start"));
        let mut env = Self {
            spec: spec::<T>(config.image, &space),
            time_limit: settings.time_limit.unwrap_or(T::TIME_LIMIT),
            space,
            fov,
            task,
            moving: Moving::at(start),
            renderer,
        };
        env.refresh_look();
        Ok(env)
    }

    /// The state of a recorded row: exactly, or as far as its observation tells.
    fn recorded(&self, row: &BTreeMap<String, Value>) -> Result<T::State, EnvError> {
        let wrong = |reason: String| EnvError::Reset { env: T::ID.to_owned(), reason };
        let values = |column: &str, dim: usize| -> Result<Option<Vec<f64>>, EnvError> {
            let Some(value) = row.get(column) else { return Ok(None) };
            let values = value.cast(column, Dtype::F64, &[dim])?.to_f64s(column)?;
            if values.iter().any(|number| !number.is_finite()) {
                return Err(wrong(format!("the recorded `{column}` is not finite")));
            }
            Ok(Some(values))
        };
        if let Some(state) = values(SIMULATOR_STATE_COLUMN, T::STATE_DIM)? {
            return state
                .as_slice()
                .try_into()
                .map_err(|_| wrong("the recorded state does not fit".to_owned()));
        }
        match values("state", T::OBSERVATION_DIM)? {
            Some(observation) => Ok(self.task.observed(&observation)),
            None => {
                Err(wrong(format!("a recorded start needs the column `{SIMULATOR_STATE_COLUMN}` or `state`")))
            }
        }
    }

    fn success(&self) -> bool {
        !self.moving.has_ended && self.task.is_success(&self.moving.state, self.moving.steps)
    }

    fn refresh_look(&mut self) {
        if let Some(renderer) = &mut self.renderer {
            renderer.set_palette(&colors::<T>(&self.fov));
            let task = &self.task;
            renderer.set_background(|painter| task.render_background(painter));
        }
    }
}

impl<T: Task> Env for ClassicControl<T> {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        if episode.options.goal.as_ref().is_some_and(|row| !row.is_empty()) {
            let reason = "it takes no goals from recorded rows: its goal is fixed".to_owned();
            return Err(EnvError::Reset { env: T::ID.to_owned(), reason });
        }
        self.fov = self.space.sample(T::ID, episode)?;
        self.task = T::new(&self.fov);
        self.moving = Moving::at(match &episode.options.start {
            Some(row) => self.recorded(row)?,
            None => self.task.start(&mut episode.seed.stream("start")),
        });
        self.refresh_look();
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(self.success()) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let diverged = |reason: String| EnvError::Diverged { env: T::ID.to_owned(), reason };
        let value = match (action, &self.spec.action) {
            (Slice::F32(&[value]), Space::Box { .. }) => Some(value),
            (Slice::I64(&[index]), Space::Discrete { n, .. }) if (0..*n).contains(&index) => {
                Some(index as f32)
            }
            _ => None,
        };
        let Some(action) = value else {
            return Err(diverged(format!("{action:?} is no action")));
        };
        let moving = &mut self.moving;
        let Step { reward, terminated } = self.task.step(&mut moving.state, action, moving.has_ended);
        moving.action = action;
        moving.steps += 1;
        if moving.state.as_ref().iter().any(|value| !value.is_finite()) {
            return Err(diverged(format!("the state is not finite after the action {action}")));
        }
        let success = self.success();
        self.moving.has_ended |= terminated;
        Ok(Outcome { reward, terminated, success: Some(success) })
    }

    fn is_truncated(&self) -> bool {
        self.time_limit != 0 && self.moving.steps >= self.time_limit
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.fov.write(FACTORS, out);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Moving { state, action, .. } = &self.moving;
        for field in [OBSERVATION, STATE] {
            self.task.observe(state, out.at(field));
        }
        out.write(SIMULATOR_STATE, state.as_ref());
        if let Some(renderer) = &mut self.renderer {
            let task = &self.task;
            let pixels = out.at(self.spec.fields.len() - 1);
            let rendered = renderer.render(pixels, |painter| task.render(state, *action, painter));
            rendered.expect("the pixel field has the renderer's size");
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(T::ID, &Saved { fov: self.fov.save(), moving: self.moving })
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved<T::State> = state.load(T::ID)?;
        let fov = recall::<T>(&self.space, &saved.fov)?;
        if saved.moving.state.as_ref().iter().any(|number| !number.is_finite()) {
            let reason = "it holds values that are not finite".to_owned();
            return Err(EnvError::State { env: T::ID.to_owned(), reason });
        }
        // Planners return to states of one episode again and again: what does not change in it stays.
        if fov != self.fov {
            self.fov = fov;
            self.task = T::new(&self.fov);
            self.refresh_look();
        }
        self.moving = saved.moving;
        Ok(())
    }

    fn task_cost(&self) -> Option<f64> {
        Some(self.task.cost(&self.moving.state))
    }

    fn places(&self) -> Vec<Place> {
        let (name, [x, y]) = self.task.place(&self.moving.state);
        let [height, width] = T::SURFACE.map(|side| side as f64);
        vec![Place { name, at: [x / width, 1.0 - y / height] }]
    }
}

fn spec<T: Task>(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F32, &[T::OBSERVATION_DIM]),
        Field::step("state", Dtype::F32, &[T::OBSERVATION_DIM]),
        Field::step(SIMULATOR_STATE_COLUMN, Dtype::F64, &[T::STATE_DIM]),
    ];
    fields.extend(space.fields());
    if let Some(size) = image {
        fields.push(size.field(PIXELS));
    }
    EnvSpec::new(T::ID, T::action_space(), fields)
        .factors(space.specs())
        .time_step_s(T::TIME_STEP_S)
        .start_columns(&[SIMULATOR_STATE_COLUMN, "state"])
}
