//! `swm/PointMaze-v0`: reset, step, observation, images.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvSpec, Episode, Field, ImageSize, Keypoint, Outcome, RowsMut, Slice, Space, Value};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::{disc, factors, goal, layout, start};
use super::layout::{Layout, cell_at};
use super::physics::{Disc, PointSim, STEP_S};
use super::rendering::{Look, in_image};
use super::settings::Settings;
use super::shortest_path::shortest_paths;
use crate::image::Canvas;
use crate::shortest_path::{ShortestPaths, distance};

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const POS_AGENT: usize = 2;
const VEL_AGENT: usize = 3;
const GOAL_STATE: usize = 4;
const GOAL_PROPRIO: usize = 5;

/// Drive a disc through a maze. See the module's documentation.
pub(super) struct PointMaze {
    layout: &'static Layout,
    disc: Disc,
    goal_radius: f64,
    with_target: bool,
    terminate_at_goal: bool,
    sim: PointSim,
    /// Paths to the goal, found when first asked for.
    paths: OnceLock<ShortestPaths>,
}

/// What changes in an episode, and the goal.
#[derive(Serialize, Deserialize)]
pub(super) struct Moving {
    pub(super) goal: [f64; 2],
    position: [f64; 2],
    velocity: [f64; 2],
}

impl Moving {
    /// x, y, velocity x, y of the disc.
    pub(super) fn state(&self) -> [f64; 4] {
        let ([x, y], [vx, vy]) = (self.position, self.velocity);
        [x, y, vx, vy]
    }
}

impl PointMaze {
    /// x, y, velocity x, y of a recorded row; its place must be free in this maze.
    fn recorded(&self, what: &str, row: &BTreeMap<String, Value>) -> Result<[f64; 4], SceneError> {
        let value = row.get("state").ok_or_else(|| format!("a {what} needs the column `state`"))?;
        let values = value.cast("state", Dtype::F64, &[4])?.to_f64s("state")?;
        if values.iter().any(|number| !number.is_finite()) {
            return Err(format!("the `state` of the recorded {what} is not finite").into());
        }
        let state: [f64; 4] = values.try_into().expect("cast to four values");
        let [x, y, ..] = state;
        if !self.layout.is_free(cell_at([x, y])) {
            let name = self.layout.name;
            return Err(format!(
                "the recorded {what} [{x}, {y}] lies in a wall of the layout {name}; set maze.layout to that of the \
                 recording"
            )
            .into());
        }
        Ok(state)
    }
}

impl Scene for PointMaze {
    const ID: &'static str = "swm/PointMaze-v0";
    type Settings = Settings;
    type State = Moving;
    type Canvas = Canvas<Look>;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
        let episode = |name: &str, dim: usize| Field::episode(name, Dtype::F64, &[dim]);
        let fields = vec![
            step("state", 4),
            step("proprio", 4),
            step("pos_agent", 2),
            step("vel_agent", 2),
            episode("goal_state", 4),
            episode("goal_proprio", 4),
        ];
        EnvSpec::new(Self::ID, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
            .time_step_s(STEP_S)
            .start_columns(&["state"])
            .goal_columns(&["state"])
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Self::Canvas, SceneError> {
        Canvas::new(size, settings.render)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        let (layout, disc) = (layout(fov), disc(fov));
        Ok(Self {
            layout,
            disc,
            goal_radius: fov.f64("goal.radius"),
            with_target: settings.with_target,
            terminate_at_goal: settings.terminate_at_goal,
            sim: PointSim::new(layout, disc),
            paths: OnceLock::new(),
        })
    }

    fn start(&mut self, _: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Moving, SceneError> {
        let [x, y] = start(fov);
        let [x, y, vx, vy] = match &episode.options.start {
            Some(row) => self.recorded("start", row)?,
            None => [x, y, 0.0, 0.0],
        };
        let goal = match &episode.options.goal {
            Some(row) => self.recorded("goal", row).map(|[x, y, ..]| [x, y])?,
            None => goal(fov),
        };
        let moving = Moving { goal, position: [x, y], velocity: [vx, vy] };
        self.sim.place(moving.position, moving.velocity);
        Ok(moving)
    }

    fn take_goal(&mut self, _: &Moving) {
        self.paths = OnceLock::new();
    }

    fn restore(&mut self, &Moving { goal, position, velocity }: &Moving) -> Result<(), SceneError> {
        if [goal, position, velocity].iter().flatten().any(|number| !number.is_finite()) {
            return Err("it holds values that are not finite".into());
        }
        self.sim.place(position, velocity);
        Ok(())
    }

    fn is_same_goal(a: &Moving, b: &Moving) -> bool {
        a.goal == b.goal
    }

    fn step(&mut self, moving: &mut Moving, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let Slice::F32(&[x, y]) = action else {
            return Err(format!("{} values of {} are no action", action.len(), action.dtype()).into());
        };
        self.sim.control_step([x, y].map(|force| f64::from(force.clamp(-1.0, 1.0))));
        (moving.position, moving.velocity) = (self.sim.position(), self.sim.velocity());
        if moving.state().iter().any(|value| !value.is_finite()) {
            return Err(format!("the state is not finite after the action {:?}", [x, y]).into());
        }
        Ok(self.outcome(moving))
    }

    fn outcome(&self, moving: &Moving) -> Outcome {
        let success = distance(moving.position, moving.goal) < self.goal_radius;
        Outcome {
            reward: if success { 0.0 } else { -1.0 },
            terminated: success && self.terminate_at_goal,
            success: Some(success),
        }
    }

    fn write_episode(&self, moving: &Moving, out: &mut RowsMut<'_>) {
        let [x, y] = moving.goal;
        out.write(GOAL_STATE, &[x, y, 0.0, 0.0]);
        out.write(GOAL_PROPRIO, &[x, y, 0.0, 0.0]);
    }

    fn observe(&self, moving: &Moving, out: &mut RowsMut<'_>) {
        out.write(STATE, &moving.state());
        out.write(PROPRIO, &moving.state());
        out.write(POS_AGENT, &moving.position);
        out.write(VEL_AGENT, &moving.velocity);
    }

    fn dress(&self, moving: &Moving, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError> {
        canvas.set_look(Look::new(look, self.with_target.then_some(moving.goal)));
        Ok(())
    }

    fn render(&self, moving: &Moving, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(pixels, |look, painter| look.render(moving.position, painter));
    }

    fn render_goal(&self, moving: &Moving, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(pixels, |look, painter| look.render(moving.goal, painter));
    }

    /// The way that is left to the goal after coasting to rest, as far as that goes along the way. Length.
    fn task_cost(&self, &Moving { goal, position, velocity }: &Moving) -> Option<f64> {
        let leg =
            self.paths.get_or_init(|| shortest_paths(self.layout, self.disc.radius, goal)).leg(position);
        let reach = distance(position, leg.to);
        let along: f64 = [0, 1].iter().map(|&axis| (leg.to[axis] - position[axis]) * velocity[axis]).sum();
        let coasting = if reach > 0.0 { along / reach / self.disc.damping } else { 0.0 };
        Some(leg.length - coasting.min(reach))
    }

    fn keypoints(&self, moving: &Moving) -> Vec<Keypoint> {
        vec![Keypoint { name: "agent", at: in_image(self.layout, moving.position) }]
    }
}
