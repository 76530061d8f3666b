//! `swm/TablePush3D-v0` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, RowsMut, Slice,
    Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::TABLE_PUSH;
use super::factors::factors_with;
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
const FACTORS: usize = 5;

/// Push an object over a table. See the module's documentation.
pub struct TablePush {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    unconstrained: FovSpace,
    fov: Fov,
    conditions: Conditions,
    stage: Stage,
    state: State,
    goal: [f64; 2],
    steps: u64,
    image: Option<Image>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    state: State,
    goal: [f64; 2],
    steps: u64,
}

/// The conditions of a state that [`Env::snapshot`] saved.
pub(super) fn saved_conditions(settings: &Settings, state: &EnvState) -> Result<Conditions, EnvError> {
    let saved: Saved = state.load(TABLE_PUSH.id)?;
    let [space, _] = factors_with(TABLE_PUSH.id, &settings.init_value)?;
    let fov = space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
    Ok(Conditions::new(&fov))
}

fn foreign(reason: String) -> EnvError {
    EnvError::State { env: TABLE_PUSH.id.to_owned(), reason }
}

impl TablePush {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = TABLE_PUSH.id;
        let settings: Settings = config.parse_settings(id)?;
        let [space, unconstrained] = factors_with(id, &settings.init_value)?;
        let fov = space.defaults();
        let image = config.image.map(|size| Image::new(size, settings.with_target)).transpose();
        let image = image.map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        let conditions = Conditions::new(&fov);
        let mut env = Self {
            spec: spec(config.image, &space),
            state: start(&fov, &conditions),
            goal: fov.vector("goal.position"),
            stage: Stage::new(conditions),
            conditions,
            settings,
            space,
            unconstrained,
            fov,
            steps: 0,
            image,
        };
        env.refresh();
        Ok(env)
    }

    /// The state of a recorded row.
    fn recorded(&self, what: &str, row: &BTreeMap<String, Value>) -> Result<State, EnvError> {
        let wrong = |reason: String| EnvError::Reset { env: self.spec.id.clone(), reason };
        let value =
            row.get("state").ok_or_else(|| wrong(format!("a recorded {what} needs the column `state`")))?;
        let values = value.cast("state", Dtype::F64, &[STATE_DIM])?.to_f64s("state")?;
        let state = State::from_row(values.first_chunk().expect("cast to so many values"));
        if state.is_sound() {
            Ok(state)
        } else {
            Err(wrong(format!(
                "the `state` of the recorded {what} has values that are not finite, or an attitude that is no unit quaternion"
            )))
        }
    }

    /// The state of the simulation.
    #[cfg(test)]
    pub(super) fn state(&self) -> &State {
        &self.state
    }

    fn distance(&self) -> f64 {
        let object = self.state.object();
        let [x, y] = [object[0] - self.goal[0], object[1] - self.goal[1]];
        (x * x + y * y).sqrt()
    }

    fn outcome(&self) -> Outcome {
        let has_fallen = has_fallen(&self.state);
        let success = !has_fallen && self.distance() < self.fov.f64("goal.radius");
        Outcome { reward: -self.distance(), terminated: success || has_fallen, success: Some(success) }
    }

    /// The object at the goal as it stood at the start, the pusher at its start.
    fn goal_state(&self) -> State {
        let mut state = start(&self.fov, &self.conditions);
        (state.position[0], state.position[1]) = (self.goal[0], self.goal[1]);
        state
    }

    /// Takes over the factors and the goal of an episode.
    fn refresh(&mut self) {
        let conditions = Conditions::new(&self.fov);
        if conditions != self.conditions {
            self.conditions = conditions;
            self.stage = Stage::new(conditions);
        }
        if let Some(image) = &mut self.image {
            image.dress(&self.fov, self.goal);
        }
    }
}

/// The start of an episode by its factors.
fn start(fov: &Fov, conditions: &Conditions) -> State {
    let [x, y] = fov.vector("object.position");
    let position = [x, y, conditions.object.half_height()];
    State::at_rest(position, fov.f64("object.angle"), fov.vector("pusher.position"))
}

impl Env for TablePush {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let options = episode.options;
        let recorded = |what: &str, row: &Option<BTreeMap<String, Value>>| {
            row.as_ref().map(|row| self.recorded(what, row)).transpose()
        };
        let (from, to) = (recorded("start", &options.start)?, recorded("goal", &options.goal)?);
        let is_recorded = from.is_some() || to.is_some();
        let space = if is_recorded { &self.unconstrained } else { &self.space };
        self.fov = space.sample(&self.spec.id, episode)?;
        self.goal = to.map_or_else(|| self.fov.vector("goal.position"), |state| state.object());
        self.refresh();
        self.state = from.unwrap_or_else(|| start(&self.fov, &self.conditions));
        self.steps = 0;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let diverged = |reason: String| EnvError::Diverged { env: TABLE_PUSH.id.to_owned(), reason };
        let values = match action {
            Slice::F32(&[x, y]) if x.is_finite() && y.is_finite() => [x, y],
            _ => return Err(diverged(format!("{action:?} is no action"))),
        };
        let wanted = values.map(|value| f64::from(value.clamp(-1.0, 1.0)) * self.conditions.speed);
        self.stage.step(&mut self.state, wanted);
        self.steps += 1;
        if !self.state.is_sound() {
            return Err(diverged(format!("the state is not finite after the action {values:?}")));
        }
        Ok(self.outcome())
    }

    fn is_truncated(&self) -> bool {
        let limit = self.settings.time_limit;
        limit != 0 && self.steps >= limit
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let goal = self.goal_state();
        out.write(GOAL_STATE, &goal.to_row());
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            image.render(&goal, out.at(self.spec.fields.len() - 1));
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let row = self.state.to_row();
        let mut observation = [0.0; OBSERVATION_DIM];
        observation[..STATE_DIM].copy_from_slice(&row);
        observation[STATE_DIM..].copy_from_slice(&self.goal);
        out.write(OBSERVATION, &observation);
        out.write(STATE, &row);
        out.write(PROPRIO, &row[STATE_DIM - 4..]);
        out.write(DISTANCE, &[self.distance()]);
        if let Some(image) = &mut self.image {
            image.render(&self.state, out.at(self.spec.fields.len() - 2));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let Self { state: moving, goal, steps, .. } = self;
        state
            .store(TABLE_PUSH.id, &Saved { fov: self.fov.save(), state: *moving, goal: *goal, steps: *steps })
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let Saved { fov, state, goal, steps } = state.load(TABLE_PUSH.id)?;
        let fov = self.space.recall(&fov).map_err(|error| foreign(error.to_string()))?;
        if !state.is_sound() || goal.iter().any(|c| !c.is_finite()) {
            return Err(foreign("it holds values that are no state of object and pusher".to_owned()));
        }
        // Planners return to states of one episode again and again: what does not change in it stays.
        let is_same_episode = fov == self.fov && goal == self.goal;
        (self.fov, self.state, self.goal, self.steps) = (fov, state, goal, steps);
        if !is_same_episode {
            self.refresh();
        }
        Ok(())
    }

    /// The object's way to the goal and a share of the pusher's way behind the object, m; 1 m more off the table.
    fn task_cost(&self) -> Option<f64> {
        let fallen = f64::from(u8::from(has_fallen(&self.state)));
        Some(guidance::cost(&self.conditions, &self.state, self.goal) + fallen)
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F64, &[OBSERVATION_DIM]),
        Field::step("state", Dtype::F64, &[STATE_DIM]),
        Field::step("proprio", Dtype::F64, &[4]),
        Field::step("distance_to_target", Dtype::F64, &[]),
        Field::episode("goal_state", Dtype::F64, &[STATE_DIM]),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    EnvSpec::new(TABLE_PUSH.id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(STEP_S)
        .start_columns(&["state"])
        .goal_columns(&["state"])
}
