//! The smallest complete environment: a point on a line that must reach a goal. For tests of everything that
//! needs some environment; real ones declare their factors with `swm-fov`.

use serde::{Deserialize, Serialize};

use crate::batch::{Dtype, Field, RowsMut, Slice, Value};
use crate::env::{Env, EnvConfig, EnvSpec, EnvState, Episode, FactorSpec, Outcome};
use crate::error::EnvError;
use crate::registry::EnvEntry;
use crate::space::Space;

/// The table entry of the toy environment.
pub const TOY: EnvEntry =
    EnvEntry::new("swm/Toy-v0", "a point on a line that must reach a goal (for tests)", |config| {
        Ok(Box::new(Toy::new(TOY.id, Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0), config)?))
    })
    .success(NEAR);

const NEAR: &str = "within 0.5 of the goal";

/// The toy environment whose point can go one left, stay or go one right.
pub const DISCRETE_TOY: EnvEntry = EnvEntry::new(
    "swm/DiscreteToy-v0",
    "a point on a line that must reach a goal by whole steps (for tests)",
    |config| Ok(Box::new(Toy::new(DISCRETE_TOY.id, Space::Discrete { n: 3, start: -1 }, config)?)),
)
.success(NEAR);

const STATE: usize = 0;
const GOAL_STATE: usize = 1;
const GAIN: usize = 2;
const PIXELS: usize = 3;

#[derive(Clone, Copy, Default, Serialize, Deserialize)]
struct State {
    position: f64,
    goal: f64,
    gain: f64,
}

struct Toy {
    spec: EnvSpec,
    state: State,
    renders: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {}

impl Toy {
    fn new(id: &str, action: Space, config: &EnvConfig) -> Result<Self, EnvError> {
        config.parse_settings::<Settings>(id)?;
        let gain = Space::uniform_box(Dtype::F64, &[], 0.1, 2.0);
        let mut fields = vec![
            Field::step("state", Dtype::F64, &[1]),
            Field::episode("goal_state", Dtype::F64, &[1]),
            Field::episode("variation.point.gain", Dtype::F64, &[]),
        ];
        fields.extend(config.image.map(|size| size.field("pixels")));
        let spec = EnvSpec::new(id, action, fields)
            .factors(vec![FactorSpec::new("point.gain", gain, 1.0).doc("distance per unit of action")])
            .time_step_s(0.1)
            .start_columns(&["state"])
            .goal_columns(&["state"]);
        Ok(Self { spec, state: State::default(), renders: config.image.is_some() })
    }

    fn outcome(&self) -> Outcome {
        let distance = (self.state.position - self.state.goal).abs();
        Outcome { reward: -distance, terminated: distance < 0.5, success: Some(distance < 0.5) }
    }

    fn gain(&self, episode: &Episode<'_>) -> Result<f64, EnvError> {
        let reset = |reason: String| EnvError::Reset { env: self.spec.id.clone(), reason };
        let factor = &self.spec.factors[0];
        let mut gain = 1.0;
        for asked in episode.options.variation.iter().flatten() {
            if !factor.is_selected_by(asked) {
                return Err(reset(format!("unknown factor `{asked}`")));
            }
            gain = factor.space.sample(&mut episode.seed.stream(&factor.name)).to_f64s(&factor.name)?[0];
        }
        for (name, value) in &episode.options.variation_values {
            if *name != factor.name {
                return Err(reset(format!("unknown factor `{name}`")));
            }
            factor.space.check(name, value.data.as_slice())?;
            gain = value.to_f64s(name)?[0];
        }
        Ok(gain)
    }
}

fn first(values: &std::collections::BTreeMap<String, Value>) -> Result<f64, EnvError> {
    let refused = |reason: &str| EnvError::Reset { env: TOY.id.to_owned(), reason: reason.to_owned() };
    let value = values.get("state").ok_or_else(|| refused("start and goal need the column `state`"))?;
    let position = value.cast("state", Dtype::F64, &[1])?.to_f64s("state")?[0];
    if !position.is_finite() {
        return Err(refused("`state` of a start or goal must be finite"));
    }
    Ok(position)
}

impl Env for Toy {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let space = Space::uniform_box(Dtype::F64, &[2], -10.0, 10.0);
        let sampled = space.sample(&mut episode.seed.stream("start and goal")).to_f64s("start")?;
        self.state = State { position: sampled[0], goal: sampled[1], gain: self.gain(episode)? };
        if let Some(start) = &episode.options.start {
            self.state.position = first(start)?;
        }
        if let Some(goal) = &episode.options.goal {
            self.state.goal = first(goal)?;
        }
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let push = action.as_f64(0).unwrap_or(f64::NAN);
        self.state.position += self.state.gain * push;
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &[self.state.goal]);
        out.write(GAIN, &[self.state.gain]);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        out.write(STATE, &[self.state.position]);
        if self.renders {
            let pixels = out.at::<u8>(PIXELS);
            pixels.fill(255);
            let column = ((self.state.position + 10.0) / 20.0).clamp(0.0, 0.999) * pixels.len() as f64;
            pixels[column as usize] = 0;
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(&self.spec.id, &self.state)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        self.state = state.load(&self.spec.id)?;
        Ok(())
    }

    fn task_cost(&self) -> Option<f64> {
        Some((self.state.position - self.state.goal).abs())
    }
}
