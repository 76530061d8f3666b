//! `swm/TablePush3D-v0`: reset, step, observation, images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvSpec, Episode, Field, ImageSize, Outcome, RowsMut, Slice, Space, Value};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::factors;
use super::guidance;
use super::physics::{Conditions, STEP_S, Stage, has_fallen};
use super::rendering::Image;
use super::settings::Settings;
use super::state::{STATE_DIM, State};

/// Values of the observation: the state, and x, y of the goal.
const OBSERVATION_DIM: usize = STATE_DIM + 2;

// Field indices, in the order of `fields`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const PROPRIO: usize = 2;
const DISTANCE: usize = 3;
const GOAL_STATE: usize = 4;

/// Push an object over a table. See the module's documentation.
pub(super) struct TablePush {
    conditions: Conditions,
    stage: Stage,
    time_limit: u64,
    goal_radius: f64,
    /// Where the factors put object and pusher.
    start: State,
}

/// What changes in an episode, and the goal.
#[derive(Serialize, Deserialize)]
pub(super) struct Moving {
    pub(super) state: State,
    goal: [f64; 2],
    steps: u64,
}

impl Moving {
    fn distance(&self) -> f64 {
        let object = self.state.object();
        let [x, y] = [object[0] - self.goal[0], object[1] - self.goal[1]];
        (x * x + y * y).sqrt()
    }
}

/// The state of a recorded row.
fn recorded(what: &str, row: &Option<BTreeMap<String, Value>>) -> Result<Option<State>, SceneError> {
    let Some(row) = row else { return Ok(None) };
    let value = row.get("state").ok_or_else(|| format!("a recorded {what} needs the column `state`"))?;
    let values = value.cast("state", Dtype::F64, &[STATE_DIM])?.to_f64s("state")?;
    let state = State::from_row(values.first_chunk().expect("cast to so many values"));
    match state.is_sound() {
        true => Ok(Some(state)),
        false => Err(format!(
            "the `state` of the recorded {what} has values that are not finite, or an attitude that is no unit quaternion"
        )
        .into()),
    }
}

impl TablePush {
    /// The object at the goal as it stood at the start, the pusher at its start.
    fn at_goal(&self, moving: &Moving) -> State {
        let mut state = self.start;
        (state.position[0], state.position[1]) = (moving.goal[0], moving.goal[1]);
        state
    }
}

impl Scene for TablePush {
    const ID: &'static str = "swm/TablePush3D-v0";
    type Settings = Settings;
    type State = Moving;
    type Canvas = Image;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let fields = vec![
            Field::step("observation", Dtype::F64, &[OBSERVATION_DIM]),
            Field::step("state", Dtype::F64, &[STATE_DIM]),
            Field::step("proprio", Dtype::F64, &[4]),
            Field::step("distance_to_target", Dtype::F64, &[]),
            Field::episode("goal_state", Dtype::F64, &[STATE_DIM]),
        ];
        EnvSpec::new(Self::ID, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
            .time_step_s(STEP_S)
            .start_columns(&["state"])
            .goal_columns(&["state"])
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Image, SceneError> {
        Ok(Image::new(size, settings.with_target)?)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        let from = recorded("start", &episode.options.start)?;
        let is_recorded = recorded("goal", &episode.options.goal)?.or(from).is_some();
        Ok(space.sample_where(Self::ID, episode, |_| !is_recorded)?)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        let conditions = Conditions::new(fov);
        let [x, y] = fov.vector("object.position");
        let position = [x, y, conditions.object.half_height()];
        Ok(Self {
            stage: Stage::new(conditions),
            time_limit: settings.time_limit,
            goal_radius: fov.f64("goal.radius"),
            start: State::at_rest(position, fov.f64("object.angle"), fov.vector("pusher.position")),
            conditions,
        })
    }

    fn start(&mut self, _: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Moving, SceneError> {
        let to = recorded("goal", &episode.options.goal)?;
        Ok(Moving {
            state: recorded("start", &episode.options.start)?.unwrap_or(self.start),
            goal: to.map_or_else(|| fov.vector("goal.position"), |state| state.object()),
            steps: 0,
        })
    }

    fn restore(&mut self, Moving { state, goal, .. }: &Moving) -> Result<(), SceneError> {
        match state.is_sound() && goal.iter().all(|c| c.is_finite()) {
            true => Ok(()),
            false => Err("it holds values that are no state of object and pusher".into()),
        }
    }

    fn is_same_goal(a: &Moving, b: &Moving) -> bool {
        a.goal == b.goal
    }

    fn step(&mut self, moving: &mut Moving, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let values = match action {
            Slice::F32(&[x, y]) if x.is_finite() && y.is_finite() => [x, y],
            _ => return Err(format!("{action:?} is no action").into()),
        };
        let wanted = values.map(|value| f64::from(value.clamp(-1.0, 1.0)) * self.conditions.speed);
        self.stage.step(&mut moving.state, wanted);
        moving.steps += 1;
        if !moving.state.is_sound() {
            return Err(format!("the state is not finite after the action {values:?}").into());
        }
        Ok(self.outcome(moving))
    }

    fn outcome(&self, moving: &Moving) -> Outcome {
        let has_fallen = has_fallen(&moving.state);
        let success = !has_fallen && moving.distance() < self.goal_radius;
        Outcome { reward: -moving.distance(), terminated: success || has_fallen, success: Some(success) }
    }

    fn is_truncated(&self, moving: &Moving) -> bool {
        self.time_limit != 0 && moving.steps >= self.time_limit
    }

    fn write_episode(&self, moving: &Moving, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &self.at_goal(moving).to_row());
    }

    fn observe(&self, moving: &Moving, out: &mut RowsMut<'_>) {
        let row = moving.state.to_row();
        let mut observation = [0.0; OBSERVATION_DIM];
        observation[..STATE_DIM].copy_from_slice(&row);
        observation[STATE_DIM..].copy_from_slice(&moving.goal);
        out.write(OBSERVATION, &observation);
        out.write(STATE, &row);
        out.write(PROPRIO, &row[STATE_DIM - 4..]);
        out.write(DISTANCE, &[moving.distance()]);
    }

    fn dress(&self, moving: &Moving, look: &Fov, image: &mut Image) -> Result<(), SceneError> {
        image.dress(look, moving.goal);
        Ok(())
    }

    fn render(&self, moving: &Moving, image: &mut Image, pixels: &mut [u8]) {
        image.render(&moving.state, pixels);
    }

    fn render_goal(&self, moving: &Moving, image: &mut Image, pixels: &mut [u8]) {
        image.render(&self.at_goal(moving), pixels);
    }

    /// The object's way to the goal and a share of the pusher's way behind the object, m; 1 m more off the table.
    fn task_cost(&self, moving: &Moving) -> Option<f64> {
        let fallen = f64::from(u8::from(has_fallen(&moving.state)));
        Some(guidance::cost(&self.conditions, &moving.state, moving.goal) + fallen)
    }
}
