//! `swm/PFRocketLanding-v0` as a scene: reset, step, observation, images.

use nalgebra::Vector3;
use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use serde::{Deserialize, Serialize};
use swm_core::seed::Stream;
use swm_core::{Dtype, EnvSpec, Episode, EpisodeSeed, Field, ImageSize, Outcome, RowsMut, Slice, Space};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::aerodynamics::Load;
use super::contact::Stage;
use super::factors::{conditions, factors};
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

/// Land a rocket. See the module's documentation.
pub(super) struct RocketLanding {
    settings: Settings,
    conditions: Conditions,
    stage: Stage,
    fuel: f64,
}

/// What changes in an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Moving {
    pub(super) state: State,
    end: End,
    steps: u64,
    /// Of the episode: the key of the throttle's noise.
    seed: u64,
}

impl RocketLanding {
    /// The start of an episode by its factors: falling, after the steps without a command.
    fn falling(&mut self, fov: &Fov, seed: EpisodeSeed) -> State {
        let ratio = fov.f64("environment.start_height_ratio");
        let [x, y] = fov.vector::<f32, 2>("environment.start_horizontal_offset").map(f64::from);
        let [roll, pitch] = fov.vector::<f32, 2>("environment.start_tilt").map(f64::from);
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
        let mut state = State::at_rest(position, from_euler(angles), self.fuel);
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

    /// One step with the throttle's noise, a sample per physics step. Returns the reward.
    pub(super) fn step_with(
        &mut self,
        moving: &mut Moving,
        action: &[f64; ACTION_DIM],
        noise: &[f64; CONTROL_STEPS * PHYSICS_STEPS],
    ) -> f64 {
        let Moving { state, end, steps, .. } = moving;
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
}

/// The state of the recorded start.
fn recorded(episode: &Episode<'_>) -> Result<Option<State>, SceneError> {
    let Some(row) = &episode.options.start else { return Ok(None) };
    let value = row.get("state").ok_or("a recorded start needs the column `state`")?;
    let values = value.cast("state", Dtype::F64, &[STATE_DIM])?.to_f64s("state")?;
    let state = State::from_row(values.first_chunk().expect("cast to so many values"));
    if !state.is_sound() {
        let reason = "the recorded `state` has values that are not finite, attitudes that are no unit quaternions, \
                      or fuel outside of 0 to 1";
        return Err(reason.into());
    }
    Ok(Some(state))
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

impl Scene for RocketLanding {
    const ID: &'static str = "swm/PFRocketLanding-v0";
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
            Field::step("out_of_bounds", Dtype::Bool, &[]),
            Field::step("fatal_collision", Dtype::Bool, &[]),
            Field::step("env_complete", Dtype::Bool, &[]),
        ];
        let (shape, low, high) = (vec![ACTION_DIM], ACTION_LOW.to_vec(), vec![1.0; ACTION_DIM]);
        EnvSpec::new(Self::ID, Space::Box { dtype: Dtype::F64, shape, low, high }, fields)
            .time_step_s(STEP_S)
            .start_columns(&["state"])
    }

    fn canvas(_: &Settings, size: ImageSize) -> Result<Image, SceneError> {
        Ok(Image::new(size)?)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        if episode.options.goal.as_ref().is_some_and(|row| !row.is_empty()) {
            return Err("it takes no goals from recorded rows: the goal is to land".into());
        }
        Ok(space.sample(Self::ID, episode)?)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        let (conditions, fuel) = (conditions(fov), fov.f64("rocket.fuel"));
        Ok(Self { settings: settings.clone(), conditions, stage: Stage::new(), fuel })
    }

    fn start(&mut self, _: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Moving, SceneError> {
        let state = recorded(episode)?.unwrap_or_else(|| self.falling(fov, episode.seed));
        let seed = episode.seed.value().unsigned_abs();
        Ok(Moving { state, end: End::default(), steps: 0, seed })
    }

    fn restore(&mut self, moving: &Moving) -> Result<(), SceneError> {
        match moving.state.is_sound() {
            true => Ok(()),
            false => Err("it holds values that are no state of a rocket".into()),
        }
    }

    fn step(&mut self, moving: &mut Moving, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let values = match action {
            Slice::F64(values) => values.try_into().ok(),
            _ => None,
        };
        let Some(action) = values else {
            return Err(format!("{} values of {} are no action", action.len(), action.dtype()).into());
        };
        let mut stream = EpisodeSeed::new(moving.seed).indexed("rocket throttle noise", [moving.steps, 0]);
        let noise = std::array::from_fn(|_| {
            let sample: f64 = StandardNormal.sample(&mut stream);
            NOISE_MEAN + sample
        });
        let reward = self.step_with(moving, action, &noise);
        if !(moving.state.is_sound() && reward.is_finite()) {
            return Err(format!("the state is not finite after the action {action:?}").into());
        }
        Ok(Outcome { reward, ..self.outcome(moving) })
    }

    fn outcome(&self, Moving { end, .. }: &Moving) -> Outcome {
        let terminated = end.fatal_collision || end.out_of_bounds;
        Outcome { reward: f64::NAN, terminated, success: Some(end.env_complete && !terminated) }
    }

    fn is_truncated(&self, moving: &Moving) -> bool {
        let limit = self.settings.time_limit;
        moving.end.env_complete || (limit != 0 && moving.steps >= limit)
    }

    fn observe(&self, Moving { state, end, .. }: &Moving, out: &mut RowsMut<'_>) {
        out.write(OBSERVATION, &observation(state));
        out.write(STATE, &state.to_row());
        out.write(OUT_OF_BOUNDS, &[end.out_of_bounds]);
        out.write(FATAL_COLLISION, &[end.fatal_collision]);
        out.write(ENV_COMPLETE, &[end.env_complete]);
    }

    fn dress(&self, _: &Moving, look: &Fov, image: &mut Image) -> Result<(), SceneError> {
        image.dress(look);
        Ok(())
    }

    fn render(&self, moving: &Moving, image: &mut Image, pixels: &mut [u8]) {
        image.render(&moving.state, pixels);
    }

    fn render_goal(&self, _: &Moving, image: &mut Image, pixels: &mut [u8]) {
        image.render(&State::landed(self.fuel), pixels);
    }

    /// How far the flight is from the descent that the expert flies, and how far it leans and turns.
    fn task_cost(&self, moving: &Moving) -> Option<f64> {
        Some(guidance::cost(&self.conditions, &moving.state, moving.end))
    }
}
