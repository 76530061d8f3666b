//! `swm/PFRocketLanding-v0` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use serde::{Deserialize, Serialize};
use swm_core::seed::Stream;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Field, ImageSize, Outcome,
    RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::ROCKET_LANDING;
use super::aerodynamics::Load;
use super::contact::Stage;
use super::factors::{conditions, factors_with};
use super::flight::{Conditions, PHYSICS_STEP_S, fly};
use super::guidance;
use super::rendering::Image;
use super::rules::{End, PHYSICS_STEPS, control_step, physics_step};
use super::settings::Settings;
use super::state::{ACTION_DIM, STATE_DIM, State};
use crate::attitude::{euler, from_euler, world_from_body};

/// Control steps per step of the agent.
const CONTROL_STEPS: usize = 3;
/// Duration of a step, s.
const STEP_S: f64 = PHYSICS_STEP_S * (CONTROL_STEPS * PHYSICS_STEPS) as f64;
/// Height that the start's ratio is a share of, m.
const MAX_HEIGHT: f64 = 500.0;
/// Speed at which a start falls, m/s.
const DROP_SPEED: f64 = 30.0;
/// Physics steps, without a command, before the first observation.
const WARM_UP_STEPS: usize = 20;
/// Values of the observation.
pub(super) const OBSERVATION_DIM: usize = 30;
/// The throttle's noise is normal with this mean and standard deviation 1: PyFlyt passes the shape as the mean.
const NOISE_MEAN: f64 = 1.0;
/// Below this an action's value is clipped to it; above 1, to 1.
const ACTION_LOW: [f64; ACTION_DIM] = [-1.0, -1.0, -1.0, 0.0, 0.0, -1.0, -1.0];

// Field indices, in the order of `fields`.
const OBSERVATION: usize = 0;
const STATE: usize = 1;
const OUT_OF_BOUNDS: usize = 2;
const FATAL_COLLISION: usize = 3;
const ENV_COMPLETE: usize = 4;
const FACTORS: usize = 5;

/// Land a rocket. See the module's documentation.
pub struct RocketLanding {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    conditions: Conditions,
    moving: Moving,
    stage: Stage,
    image: Option<Image>,
}

/// What changes in an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Moving {
    state: State,
    end: End,
    steps: u64,
    /// Of the episode: the key of the throttle's noise.
    seed: u64,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    moving: Moving,
}

impl RocketLanding {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = ROCKET_LANDING.id;
        let settings: Settings = config.parse_settings(id)?;
        let space = factors_with(id, &settings.init_value)?;
        let fov = space.defaults();
        let image = config.image.map(|size| Image::new(size, &fov)).transpose();
        let image = image.map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        Ok(Self {
            spec: spec(config.image, &space),
            conditions: conditions(&fov),
            moving: Moving { state: State::landed(0.0), end: End::default(), steps: 0, seed: 0 },
            stage: Stage::new(),
            settings,
            space,
            fov,
            image,
        })
    }

    /// The start of an episode by its factors: falling, after the steps without a command.
    fn start(&mut self, seed: EpisodeSeed) -> State {
        let ratio = self.fov.f64("environment.start_height_ratio");
        let [x, y] = self.fov.vector::<f32, 2>("environment.start_horizontal_offset").map(f64::from);
        let [roll, pitch] = self.fov.vector::<f32, 2>("environment.start_tilt").map(f64::from);
        let (mut position, mut angles) = ([x, y, MAX_HEIGHT * ratio], [roll, pitch, 0.0]);
        if self.settings.randomize_drop {
            let stream = &mut seed.stream("rocket drop");
            for coordinate in &mut position[..2] {
                *coordinate += uniform(stream, -20.0, 20.0);
            }
            position[2] *= uniform(stream, 400.0, 450.0) / 450.0;
            for angle in &mut angles {
                *angle += uniform(stream, -0.3, 0.3);
            }
            for coordinate in &mut position[..2] {
                *coordinate += uniform(stream, -2.0, 2.0);
            }
        }
        let mut state = State::at_rest(position, from_euler(angles), self.fov.f64("rocket.fuel"));
        if self.settings.accelerate_drop {
            state.velocity[2] = -DROP_SPEED;
        }
        // Before its first step, PyBullet knows no velocities of links: the air does nothing.
        fly(&self.conditions, &mut state, &Load::default());
        for _ in 1..WARM_UP_STEPS {
            physics_step(&self.conditions, &mut self.stage, &mut state, 0.0);
        }
        state
    }

    /// The state of a recorded row.
    fn recorded(&self, row: &BTreeMap<String, Value>) -> Result<State, EnvError> {
        let wrong = |reason: String| EnvError::Reset { env: self.spec.id.clone(), reason };
        let value =
            row.get("state").ok_or_else(|| wrong("a recorded start needs the column `state`".to_owned()))?;
        let values = value.cast("state", Dtype::F64, &[STATE_DIM])?.to_f64s("state")?;
        let state = State::from_row(values.first_chunk().expect("cast to so many values"));
        if !state.is_sound() {
            let reason = "the recorded `state` has values that are not finite, attitudes that are no unit quaternions, \
                          or fuel outside of 0 to 1";
            return Err(wrong(reason.to_owned()));
        }
        Ok(state)
    }

    /// One step with the throttle's noise, a sample per physics step. Returns the reward.
    pub(super) fn step_with(
        &mut self,
        action: &[f64; ACTION_DIM],
        noise: &[f64; CONTROL_STEPS * PHYSICS_STEPS],
    ) -> f64 {
        let Moving { state, end, steps, .. } = &mut self.moving;
        for (value, (given, low)) in state.action.iter_mut().zip(action.iter().zip(ACTION_LOW)) {
            *value = given.clamp(low, 1.0);
        }
        let mut total = 0.0;
        for noise in noise.as_chunks().0 {
            let reward;
            (reward, *end) =
                control_step(&self.conditions, &mut self.stage, state, noise, self.settings.sparse_reward);
            total += reward;
            if end.any() {
                break;
            }
        }
        *steps += 1;
        total
    }

    /// The state of the simulation.
    #[cfg(test)]
    pub(super) fn state_mut(&mut self) -> &mut State {
        &mut self.moving.state
    }

    fn refresh(&mut self) {
        self.conditions = conditions(&self.fov);
        if let Some(image) = &mut self.image {
            image.dress(&self.fov);
        }
    }
}

/// A value drawn uniformly from `low..high`.
fn uniform(stream: &mut Stream, low: f64, high: f64) -> f64 {
    let share: f64 = StandardUniform.sample(stream);
    low + (high - low) * share
}

/// The reference's observation: body rates, attitude, body velocity, position, action, actuators, contact.
fn observation(state: &State) -> [f64; OBSERVATION_DIM] {
    let body = world_from_body(state.attitude).transpose();
    let [wx, wy, wz]: [f64; 3] = (body * Vector3::from(state.spin)).into();
    let [vx, vy, vz]: [f64; 3] = (body * Vector3::from(state.velocity)).into();
    // Through Euler angles, as the reference does: the sign of a quaternion is theirs.
    let [qx, qy, qz, qw] = from_euler(euler(state.attitude));
    let [x, y, z] = state.position;
    let [a0, a1, a2, a3, a4, a5, a6] = state.action;
    let [f0, f1, f2, f3] = state.fins;
    let flag = |is_set: bool| f64::from(u8::from(is_set));
    let [gx, gy] = state.gimbal;
    let (ignition, contact) = (flag(a3 > 0.5), flag(state.pad_contact[0]));
    [
        wx,
        wy,
        wz,
        qx,
        qy,
        qz,
        qw,
        vx,
        vy,
        vz,
        x,
        y,
        z,
        a0,
        a1,
        a2,
        a3,
        a4,
        a5,
        a6,
        f0,
        f1,
        f2,
        f3,
        ignition,
        state.fuel,
        state.throttle,
        gx,
        gy,
        contact,
    ]
}

impl Env for RocketLanding {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        if episode.options.goal.as_ref().is_some_and(|row| !row.is_empty()) {
            let reason = "it takes no goals from recorded rows: the goal is to land".to_owned();
            return Err(EnvError::Reset { env: ROCKET_LANDING.id.to_owned(), reason });
        }
        self.fov = self.space.sample(&self.spec.id, episode)?;
        self.refresh();
        let state = match &episode.options.start {
            Some(row) => self.recorded(row)?,
            None => self.start(episode.seed),
        };
        let seed = episode.seed.value().unsigned_abs();
        self.moving = Moving { state, end: End::default(), steps: 0, seed };
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(false) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let diverged = |reason: String| EnvError::Diverged { env: ROCKET_LANDING.id.to_owned(), reason };
        let values = match action {
            Slice::F64(values) => values.try_into().ok(),
            _ => None,
        };
        let Some(action) = values else {
            return Err(diverged(format!("{} values of {} are no action", action.len(), action.dtype())));
        };
        let Moving { seed, steps, .. } = self.moving;
        let mut stream = EpisodeSeed::new(seed).indexed("rocket throttle noise", [steps, 0]);
        let noise = std::array::from_fn(|_| {
            let sample: f64 = StandardNormal.sample(&mut stream);
            NOISE_MEAN + sample
        });
        let reward = self.step_with(action, &noise);
        let Moving { state, end, .. } = &self.moving;
        if !(state.is_sound() && reward.is_finite()) {
            return Err(diverged(format!("the state is not finite after the action {action:?}")));
        }
        let terminated = end.fatal_collision || end.out_of_bounds;
        Ok(Outcome { reward, terminated, success: Some(end.env_complete && !terminated) })
    }

    fn is_truncated(&self) -> bool {
        let limit = self.settings.time_limit;
        self.moving.end.env_complete || (limit != 0 && self.moving.steps >= limit)
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            let landed = State::landed(self.fov.f64("rocket.fuel"));
            image.render(&landed, out.at(self.spec.fields.len() - 1));
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Moving { state, end, .. } = &self.moving;
        out.write(OBSERVATION, &observation(state));
        out.write(STATE, &state.to_row());
        out.write(OUT_OF_BOUNDS, &[end.out_of_bounds]);
        out.write(FATAL_COLLISION, &[end.fatal_collision]);
        out.write(ENV_COMPLETE, &[end.env_complete]);
        if let Some(image) = &mut self.image {
            image.render(state, out.at(self.spec.fields.len() - 2));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(ROCKET_LANDING.id, &Saved { fov: self.fov.save(), moving: self.moving })
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let foreign = |reason: String| EnvError::State { env: ROCKET_LANDING.id.to_owned(), reason };
        let Saved { fov, moving } = state.load(ROCKET_LANDING.id)?;
        let fov = self.space.recall(&fov).map_err(|error| foreign(error.to_string()))?;
        if !moving.state.is_sound() {
            return Err(foreign("it holds values that are no state of a rocket".to_owned()));
        }
        // Planners return to states of one episode again and again: what does not change in it stays.
        if fov != self.fov {
            self.fov = fov;
            self.refresh();
        }
        self.moving = moving;
        Ok(())
    }

    /// How far the flight is from the descent that the expert flies, and how far it leans and turns.
    fn task_cost(&self) -> Option<f64> {
        let Moving { state, end, .. } = &self.moving;
        Some(guidance::cost(&self.conditions, state, *end))
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F64, &[OBSERVATION_DIM]),
        Field::step("state", Dtype::F64, &[STATE_DIM]),
        Field::step("out_of_bounds", Dtype::Bool, &[]),
        Field::step("fatal_collision", Dtype::Bool, &[]),
        Field::step("env_complete", Dtype::Bool, &[]),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    let action = Space::Box {
        dtype: Dtype::F64,
        shape: vec![ACTION_DIM],
        low: ACTION_LOW.to_vec(),
        high: vec![1.0; ACTION_DIM],
    };
    EnvSpec::new(ROCKET_LANDING.id, action, fields)
        .factors(space.specs())
        .time_step_s(STEP_S)
        .start_columns(&["state"])
}
