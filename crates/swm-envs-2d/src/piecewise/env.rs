//! `swm/Piecewise-v0`: reset, step, observation, images.

use swm_core::{EnvSpec, Episode, ImageSize, Keypoint, Outcome, RowsMut, Slice};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::factors;
use super::rendering::Look;
use super::settings::Settings;
use super::zones::Zones;
use crate::dot_room::{
    Canvas, DISTANCE, Dots, GOAL_STATE, LEAST, OBSERVATION, PROPRIO, STATE, finite_action, recorded, spec,
    target,
};
use crate::tworoom_v2::dot::Dot;
use crate::tworoom_v2::room::{self, IMAGE_PX, SIDE, distance_f32, to_target};

/// Walk to a target over zones that push. See the module's documentation.
pub(super) struct Piecewise {
    zones: Zones,
    /// The setting asks for far targets.
    asks_for_far_targets: bool,
}

impl Scene for Piecewise {
    const ID: &'static str = "swm/Piecewise-v0";
    type Settings = Settings;
    type State = Dots;
    type Canvas = Canvas<Look, Dot>;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        settings.check()?;
        Ok(factors(settings.grid_n).with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        spec(Self::ID, 4, 1.0)
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Self::Canvas, SceneError> {
        Canvas::new(size, settings.render)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        Ok(Self {
            zones: Zones::new(fov, settings.grid_n),
            asks_for_far_targets: settings.init_value.contains_key(LEAST),
        })
    }

    fn start(&mut self, spec: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Dots, SceneError> {
        let [start, goal] = recorded(SIDE, episode)?;
        let agent = start.unwrap_or_else(|| fov.vector("agent.position"));
        let least_px = |steps: i64| f64::from(steps as f32 * self.zones.speed);
        let way_to = |target| f64::from(distance_f32(agent, target));
        let sampled = || target(spec, fov, self.asks_for_far_targets, episode, least_px, way_to);
        Ok(Dots { agent, target: goal.unwrap_or_else(sampled) })
    }

    fn restore(&mut self, state: &Dots) -> Result<(), SceneError> {
        state.check(SIDE)
    }

    fn is_same_goal(a: &Dots, b: &Dots) -> bool {
        a.target == b.target
    }

    fn step(&mut self, state: &mut Dots, action: Slice<'_>) -> Result<Outcome, SceneError> {
        state.agent = self.zones.step(state.agent, finite_action(action)?);
        Ok(self.outcome(state))
    }

    fn outcome(&self, state: &Dots) -> Outcome {
        room::outcome(state)
    }

    fn write_episode(&self, state: &Dots, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &state.target);
    }

    fn observe(&self, state: &Dots, out: &mut RowsMut<'_>) {
        out.write(OBSERVATION, [state.agent, state.target].as_flattened());
        out.write(STATE, &state.agent);
        out.write(PROPRIO, &state.agent);
        out.write(DISTANCE, &[to_target(state)]);
    }

    fn dress(&self, state: &Dots, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError> {
        canvas.set_look(Dot::new(look, state.agent), Look::new(look, &self.zones, state.target))
    }

    fn render(&self, state: &Dots, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(state.agent, pixels);
    }

    fn render_goal(&self, state: &Dots, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(state.target, pixels);
    }

    /// Pixels to the target.
    fn task_cost(&self, state: &Dots) -> Option<f64> {
        Some(to_target(state))
    }

    fn keypoints(&self, state: &Dots) -> Vec<Keypoint> {
        let at = state.agent.map(|c| (f64::from(c) + 0.5) / IMAGE_PX as f64);
        vec![Keypoint { name: "agent", at }]
    }
}
