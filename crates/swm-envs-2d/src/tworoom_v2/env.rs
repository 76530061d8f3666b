//! `swm/TwoRoom-v2`: reset, step, observation, images.

use swm_core::{EnvError, EnvSpec, Episode, ImageSize, Outcome, RowsMut, Slice, Value};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::dot::Dot;
use super::factors::factors;
use super::rendering::Look;
use super::room::{self, Room, SIDE, WALL_CENTER_PX, to_target};
use super::route;
use super::settings::Settings;
use crate::dot_room::{
    Canvas, DISTANCE, Dots, GOAL_STATE, LEAST, OBSERVATION, PROPRIO, STATE, recorded, spec, target,
};

/// Walk from one room to a target in either. See the module's documentation.
pub(super) struct TwoRoom {
    settings: Settings,
    room: Room,
}

impl TwoRoom {
    /// Pixels to walk from the agent to the target, through a door if need be.
    fn way(&self, state: &Dots) -> f64 {
        let [from, to] = [state.agent, state.target].map(|position| position.map(f64::from));
        route::way(&self.room, from, to).length
    }
}

impl Scene for TwoRoom {
    const ID: &'static str = "swm/TwoRoom-v2";
    type Settings = Settings;
    type State = Dots;
    type Canvas = Canvas<Look, Dot>;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        spec(Self::ID, 10, 1.0)
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Self::Canvas, SceneError> {
        Canvas::new(size, settings.render)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        match space.sample(Self::ID, episode) {
            // A recorded start is elsewhere than the factor's: it is the one that must be possible.
            Err(EnvError::Constraint { .. }) if episode.options.start.is_some() => {
                let [start, _] = recorded(SIDE, episode)?;
                let in_use = start.map(|at| ("agent.position", Value::vector(&at)));
                Ok(space.sample_in_use(Self::ID, episode, in_use.as_slice())?)
            }
            sampled => Ok(sampled?),
        }
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        Ok(Self { settings: settings.clone(), room: Room::new(fov) })
    }

    fn start(&mut self, spec: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Dots, SceneError> {
        let [start, goal] = recorded(SIDE, episode)?;
        let agent = start.unwrap_or_else(|| fov.vector("agent.position"));
        let least_px = |steps: i64| steps as f64 * f64::from(self.room.speed);
        let way_to = |target| self.way(&Dots { agent, target });
        let is_far = self.settings.init_value.contains_key(LEAST);
        let sampled = || target(spec, fov, is_far, episode, least_px, way_to);
        Ok(Dots { agent, target: goal.unwrap_or_else(sampled) })
    }

    fn restore(&mut self, state: &Dots) -> Result<(), SceneError> {
        state.check(SIDE)
    }

    fn is_same_goal(a: &Dots, b: &Dots) -> bool {
        a.target == b.target
    }

    fn step(&mut self, state: &mut Dots, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let Slice::F32(&[x, y]) = action else {
            return Err(format!("{} values of {} are no action", action.len(), action.dtype()).into());
        };
        state.agent = self.room.step(state.agent, [x, y]);
        Ok(self.outcome(state))
    }

    fn outcome(&self, state: &Dots) -> Outcome {
        room::outcome(state)
    }

    fn write_episode(&self, state: &Dots, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &state.target);
    }

    fn observe(&self, state: &Dots, out: &mut RowsMut<'_>) {
        let observation: &mut [f32] = out.at(OBSERVATION);
        observation.fill(0.0);
        observation[..4].copy_from_slice([state.agent, state.target].as_flattened());
        for (pair, door) in observation[4..].chunks_exact_mut(2).zip(self.room.doors()) {
            pair.copy_from_slice(&self.room.position(WALL_CENTER_PX, door.center).map(|c| c as f32));
        }
        out.write(STATE, &state.agent);
        out.write(PROPRIO, &state.agent);
        out.write(DISTANCE, &[to_target(state)]);
    }

    fn dress(&self, state: &Dots, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError> {
        canvas.set_look(Dot::new(look, state.agent), Look::new(look, state.target, &self.settings))
    }

    fn render(&self, state: &Dots, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(state.agent, pixels);
    }

    fn render_goal(&self, state: &Dots, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(state.target, pixels);
    }

    /// Pixels to walk to the target.
    fn task_cost(&self, state: &Dots) -> Option<f64> {
        Some(self.way(state))
    }
}
