//! `swm/SimplePointMaze-v0`: reset, step, observation, images.

use std::sync::OnceLock;

use swm_core::{EnvSpec, Episode, ImageSize, Keypoint, Outcome, RowsMut, Slice};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::{factors, sample};
use super::rendering::{Disc, Look};
use super::settings::Settings;
use super::walls::{MAX_ACTION, Room, SIDE};
use crate::dot_room::{
    Canvas, DISTANCE, Dots, GOAL_STATE, OBSERVATION, PROPRIO, STATE, finite_action, recorded, spec,
};
use crate::shortest_path::{ShortestPaths, distance};

/// Move a disc past walls to a goal. See the module's documentation.
pub(super) struct SimplePointMaze {
    room: Room,
    goal_radius: f32,
    show_goal: bool,
    /// Paths to the goal, found when first asked for.
    paths: OnceLock<ShortestPaths>,
}

/// Euclidean distance to the goal, summed in f32 as in the reference.
fn to_goal(state: &Dots) -> f32 {
    let [x, y] = [0, 1].map(|axis| state.agent[axis] - state.target[axis]);
    (x * x + y * y).sqrt()
}

impl Scene for SimplePointMaze {
    const ID: &'static str = "swm/SimplePointMaze-v0";
    type Settings = Settings;
    type State = Dots;
    type Canvas = Canvas<Look, Disc>;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        spec(Self::ID, 2, f64::from(MAX_ACTION))
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Self::Canvas, SceneError> {
        Canvas::new(size, settings.render)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        Ok(sample(Self::ID, space, episode, recorded(SIDE, episode)?)?)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        let (room, goal_radius) = (Room::new(fov), fov.f32("goal.radius"));
        Ok(Self { room, goal_radius, show_goal: settings.show_goal, paths: OnceLock::new() })
    }

    fn start(&mut self, _: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Dots, SceneError> {
        let [start, goal] = recorded(SIDE, episode)?;
        Ok(Dots {
            agent: start.unwrap_or_else(|| fov.vector("agent.position")),
            target: goal.unwrap_or_else(|| fov.vector("goal.position")),
        })
    }

    fn take_goal(&mut self, _: &Dots) {
        self.paths = OnceLock::new();
    }

    fn restore(&mut self, state: &Dots) -> Result<(), SceneError> {
        state.check(SIDE)
    }

    fn is_same_goal(a: &Dots, b: &Dots) -> bool {
        a.target == b.target
    }

    fn step(&mut self, state: &mut Dots, action: Slice<'_>) -> Result<Outcome, SceneError> {
        state.agent = self.room.step(state.agent, finite_action(action)?);
        Ok(self.outcome(state))
    }

    fn outcome(&self, state: &Dots) -> Outcome {
        let success = to_goal(state) < self.goal_radius;
        Outcome { reward: if success { 1.0 } else { -0.01 }, terminated: success, success: Some(success) }
    }

    fn write_episode(&self, state: &Dots, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &state.target);
    }

    fn observe(&self, state: &Dots, out: &mut RowsMut<'_>) {
        for field in [OBSERVATION, STATE, PROPRIO] {
            out.write(field, &state.agent);
        }
        out.write(DISTANCE, &[f64::from(to_goal(state))]);
    }

    fn dress(&self, state: &Dots, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError> {
        let disc = Disc { center: state.agent, radius: self.room.radius, color: look.rgb("agent.color") };
        canvas.set_look(disc, Look::new(look, &self.room, self.show_goal.then_some(state.target)))
    }

    fn render(&self, state: &Dots, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(state.agent, pixels);
    }

    fn render_goal(&self, state: &Dots, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(state.target, pixels);
    }

    /// The length of the shortest way to the goal.
    fn task_cost(&self, state: &Dots) -> Option<f64> {
        let paths = self.paths.get_or_init(|| self.room.shortest_paths(state.target));
        let [agent, goal] = [state.agent, state.target].map(|position| position.map(f64::from));
        let length = paths.leg(agent).length;
        // Where walls leave no way: as the crow flies, and worse than any way.
        Some(if length.is_finite() { length } else { distance(agent, goal) + f64::from(4.0 * SIDE) })
    }

    fn keypoints(&self, state: &Dots) -> Vec<Keypoint> {
        let [x, y] = state.agent.map(|c| f64::from(c / SIDE));
        vec![Keypoint { name: "agent", at: [x, 1.0 - y] }]
    }
}
