//! The environment of every task: reset, step, observation, images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvSpec, Episode, Field, ImageSize, Keypoint, Outcome, RowsMut, Slice, Space, Value};
use swm_fov::{Fov, FovSpace, Scene, SceneError};
use swm_render::{Geometry, Renderer};

use super::settings::Settings;
use super::task::{Step, Task, colors, factors};

// Field indices, in the order of `spec`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const SIMULATOR_STATE: usize = 2;

/// The column that holds the whole state of the simulator.
pub(super) const SIMULATOR_STATE_COLUMN: &str = "simulator_state";

/// An environment of classic control. See the module's documentation.
pub(super) struct ClassicControl<T: Task> {
    task: T,
    actions: Space,
    time_limit: u64,
}

/// What changes in an episode.
#[derive(Serialize, Deserialize)]
pub(super) struct Moving<S> {
    state: S,
    /// The last action, which the pendulum shows; 0 at the start.
    action: f32,
    steps: u64,
    has_ended: bool,
}

impl<T: Task> ClassicControl<T> {
    /// The state of a recorded row: exactly, or as far as its observation tells.
    fn recorded(&self, row: &BTreeMap<String, Value>) -> Result<T::State, SceneError> {
        let values = |column: &str, dim: usize| -> Result<Option<Vec<f64>>, SceneError> {
            let Some(value) = row.get(column) else { return Ok(None) };
            let values = value.cast(column, Dtype::F64, &[dim])?.to_f64s(column)?;
            if values.iter().any(|number| !number.is_finite()) {
                return Err(format!("the recorded `{column}` is not finite").into());
            }
            Ok(Some(values))
        };
        if let Some(state) = values(SIMULATOR_STATE_COLUMN, T::STATE_DIM)? {
            return state.as_slice().try_into().map_err(|_| "the recorded state does not fit".into());
        }
        match values("state", T::OBSERVATION_DIM)? {
            Some(observation) => Ok(self.task.observed(&observation)),
            None => {
                Err(format!("a recorded start needs the column `{SIMULATOR_STATE_COLUMN}` or `state`").into())
            }
        }
    }
}

impl<T: Task> Scene for ClassicControl<T> {
    const ID: &'static str = T::ID;
    const HAS_GOAL_IMAGE: bool = false;
    type Settings = Settings;
    type State = Moving<T::State>;
    type Canvas = Renderer;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors::<T>().with_defaults(T::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let fields = vec![
            Field::step("observation", Dtype::F32, &[T::OBSERVATION_DIM]),
            Field::step("state", Dtype::F32, &[T::OBSERVATION_DIM]),
            Field::step(SIMULATOR_STATE_COLUMN, Dtype::F64, &[T::STATE_DIM]),
        ];
        EnvSpec::new(T::ID, T::action_space(), fields)
            .time_step_s(T::TIME_STEP_S)
            .start_columns(&[SIMULATOR_STATE_COLUMN, "state"])
    }

    fn canvas(settings: &Settings, ImageSize { height, width }: ImageSize) -> Result<Renderer, SceneError> {
        let renderer = Renderer::new(settings.render.into(), Geometry::surface(T::SURFACE, height, width));
        Ok(renderer.map_err(|error| error.to_string())?)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        if episode.options.goal.as_ref().is_some_and(|row| !row.is_empty()) {
            return Err("it takes no goals from recorded rows: its goal is fixed".into());
        }
        Ok(space.sample(T::ID, episode)?)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        let time_limit = settings.time_limit.unwrap_or(T::TIME_LIMIT);
        Ok(Self { task: T::new(fov), actions: T::action_space(), time_limit })
    }

    fn start(&mut self, _: &EnvSpec, _: &Fov, episode: &Episode<'_>) -> Result<Self::State, SceneError> {
        let state = match &episode.options.start {
            Some(row) => self.recorded(row)?,
            None => self.task.start(&mut episode.seed.stream("start")),
        };
        Ok(Moving { state, action: 0.0, steps: 0, has_ended: false })
    }

    fn restore(&mut self, moving: &Self::State) -> Result<(), SceneError> {
        match moving.state.as_ref().iter().all(|value| value.is_finite()) {
            true => Ok(()),
            false => Err("it holds values that are not finite".into()),
        }
    }

    fn step(&mut self, moving: &mut Self::State, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let action = match (action, &self.actions) {
            (Slice::F32(&[value]), Space::Box { .. }) => value,
            (Slice::I64(&[index]), Space::Discrete { n, .. }) if (0..*n).contains(&index) => index as f32,
            _ => return Err(format!("{action:?} is no action").into()),
        };
        let Step { reward, terminated } = self.task.step(&mut moving.state, action, moving.has_ended);
        moving.action = action;
        moving.steps += 1;
        if moving.state.as_ref().iter().any(|value| !value.is_finite()) {
            return Err(format!("the state is not finite after the action {action}").into());
        }
        let outcome = Outcome { reward, terminated, ..self.outcome(moving) };
        moving.has_ended |= terminated;
        Ok(outcome)
    }

    fn outcome(&self, moving: &Self::State) -> Outcome {
        let success = !moving.has_ended && self.task.is_success(&moving.state, moving.steps);
        Outcome { reward: f64::NAN, terminated: false, success: Some(success) }
    }

    fn is_truncated(&self, moving: &Self::State) -> bool {
        self.time_limit != 0 && moving.steps >= self.time_limit
    }

    fn observe(&self, moving: &Self::State, out: &mut RowsMut<'_>) {
        for field in [OBSERVATION, STATE] {
            self.task.observe(&moving.state, out.at(field));
        }
        out.write(SIMULATOR_STATE, moving.state.as_ref());
    }

    fn dress(&self, _: &Self::State, look: &Fov, renderer: &mut Renderer) -> Result<(), SceneError> {
        renderer.set_palette(&colors::<T>(look));
        renderer.set_background(|painter| self.task.render_background(painter));
        Ok(())
    }

    fn render(&self, moving: &Self::State, renderer: &mut Renderer, pixels: &mut [u8]) {
        let rendered =
            renderer.render(pixels, |painter| self.task.render(&moving.state, moving.action, painter));
        rendered.expect("the pixel field has the renderer's size");
    }

    fn task_cost(&self, moving: &Self::State) -> Option<f64> {
        Some(self.task.cost(&moving.state))
    }

    fn keypoints(&self, moving: &Self::State) -> Vec<Keypoint> {
        let (name, [x, y]) = self.task.place(&moving.state);
        let [height, width] = T::SURFACE.map(|side| side as f64);
        vec![Keypoint { name, at: [x / width, 1.0 - y / height] }]
    }
}
