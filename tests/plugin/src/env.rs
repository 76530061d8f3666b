//! `demo/IceRink-v0`: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, RowsMut, Slice,
    Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use crate::factors::{REACH, factors};
use crate::{ICE_RINK, image};

const STEP_S: f64 = 0.05;
/// Acceleration of a puck of mass 1 at full action, in rinks per second squared.
const PUSH: f64 = 2.0;
/// The puck lies on the mark only if it is slower than this, in rinks per second.
const REST: f64 = 0.2;

// Field indices, in the order of `fields`.
const STATE: usize = 0;
const GOAL_STATE: usize = 1;
const FACTORS: usize = 2;

/// A puck that slides, bounces off the boards and can be pushed.
pub struct Rink {
    spec: EnvSpec,
    space: FovSpace,
    fov: Fov,
    puck: Puck,
    mark: [f64; 2],
    draws: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Puck {
    position: [f64; 2],
    velocity: [f64; 2],
}

/// A saved moment.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    puck: Puck,
    mark: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {}

impl Rink {
    /// Makes the environment.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        config.parse_settings::<Settings>(ICE_RINK.id)?;
        let space = factors();
        let fov = space.defaults();
        let spec = spec(config.image, &space);
        Ok(Self { spec, space, fov, puck: Puck::default(), mark: [0.0; 2], draws: config.image.is_some() })
    }

    fn distance(&self) -> f64 {
        (self.puck.position[0] - self.mark[0]).hypot(self.puck.position[1] - self.mark[1])
    }

    fn outcome(&self) -> Outcome {
        let [vx, vy] = self.puck.velocity;
        let success = self.distance() <= REACH && vx.hypot(vy) <= REST;
        Outcome { reward: -self.distance(), terminated: success, success: Some(success) }
    }

    /// The state of a recorded row.
    fn recorded(&self, row: &BTreeMap<String, Value>) -> Result<Puck, EnvError> {
        let reset = |reason: &str| EnvError::Reset { env: self.spec.id.clone(), reason: reason.to_owned() };
        let value = row.get("state").ok_or_else(|| reset("start and goal need the column `state`"))?;
        let state = value.cast("state", Dtype::F64, &[4])?.to_f64s("state")?;
        if !state.iter().all(|number| number.is_finite()) {
            return Err(reset("`state` is not finite"));
        }
        Ok(Puck { position: [state[0], state[1]], velocity: [state[2], state[3]] })
    }
}

impl Env for Rink {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        self.puck = match &episode.options.start {
            Some(row) => self.recorded(row)?,
            None => Puck { position: self.fov.vector("puck.start_position"), velocity: [0.0; 2] },
        };
        self.mark = match &episode.options.goal {
            Some(row) => self.recorded(row)?.position,
            None => self.fov.vector("mark.position"),
        };
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let keeps = 1.0 - self.fov.f64("ice.friction") * STEP_S;
        let force = PUSH / self.fov.f64("puck.mass");
        for axis in 0..2 {
            let push = action.as_f64(axis).unwrap_or(0.0).clamp(-1.0, 1.0);
            let (position, velocity) = (&mut self.puck.position[axis], &mut self.puck.velocity[axis]);
            *velocity = (*velocity + force * push * STEP_S) * keeps;
            *position += *velocity * STEP_S;
            if !(0.0..=1.0).contains(position) {
                *position = position.clamp(0.0, 1.0);
                *velocity = -*velocity;
            }
        }
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &[self.mark[0], self.mark[1], 0.0, 0.0]);
        self.fov.write(FACTORS, out);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Puck { position: [x, y], velocity: [vx, vy] } = self.puck;
        out.write(STATE, &[x, y, vx, vy]);
        if self.draws {
            let field = self.spec.fields.len() - 1;
            let width = self.spec.fields[field].shape[1];
            let pixels: &mut [u8] = out.at(field);
            pixels.as_chunks_mut::<3>().0.fill(self.fov.rgb("ice.color"));
            image::disc(pixels, width, self.mark, REACH, self.fov.rgb("mark.color"));
            image::disc(pixels, width, self.puck.position, REACH, self.fov.rgb("puck.color"));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), puck: self.puck, mark: self.mark };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |error: swm_fov::FovError| EnvError::State {
            env: self.spec.id.clone(),
            reason: error.to_string(),
        };
        self.fov = self.space.recall(&saved.fov).map_err(foreign)?;
        (self.puck, self.mark) = (saved.puck, saved.mark);
        Ok(())
    }

    /// How far the puck is from the mark, and a little for its speed: it shall come to lie there.
    fn task_cost(&self) -> Option<f64> {
        let [vx, vy] = self.puck.velocity;
        Some(self.distance() + 0.1 * vx.hypot(vy))
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields =
        vec![Field::step("state", Dtype::F64, &[4]), Field::episode("goal_state", Dtype::F64, &[4])];
    fields.extend(space.fields());
    fields.extend(image.map(|size| size.field(PIXELS)));
    EnvSpec::new(ICE_RINK.id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(STEP_S)
        .start_columns(&["state"])
        .goal_columns(&["state"])
}
