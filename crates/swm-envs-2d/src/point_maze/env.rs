//! `swm/PointMaze-v0` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, Place, RowsMut,
    Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::POINT_MAZE;
use super::factors::{disc, factors_with, goal, layout, start};
use super::layout::cell_at;
use super::physics::{PointSim, STEP_S};
use super::rendering::{Look, in_image};
use super::settings::Settings;
use super::ways::ways;
use crate::image::Image;
use crate::ways::{Ways, distance};

// Field indices, in the order of `fields`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const POS_AGENT: usize = 2;
const VEL_AGENT: usize = 3;
const GOAL_STATE: usize = 4;
const GOAL_PROPRIO: usize = 5;
const FACTORS: usize = 6;

/// Drive a disc through a maze. See the module's documentation.
pub struct PointMaze {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    goal: [f64; 2],
    sim: PointSim,
    /// Ways to the goal, found when first asked for.
    ways: OnceLock<Ways>,
    image: Option<Image<Look>>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    goal: [f64; 2],
    position: [f64; 2],
    velocity: [f64; 2],
}

impl PointMaze {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = POINT_MAZE.id;
        let settings: Settings = config.parse_settings(id)?;
        let space = factors_with(id, &settings.init_value)?;
        let fov = space.defaults();
        let goal = goal(&fov);
        let look = Look::new(&fov, settings.with_target.then_some(goal));
        let image = config.image.map(|size| Image::new(size, settings.render, look)).transpose();
        let image = image.map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        Ok(Self {
            spec: spec(config.image, &space),
            sim: PointSim::new(layout(&fov), disc(&fov)),
            goal,
            settings,
            space,
            fov,
            ways: OnceLock::new(),
            image,
        })
    }

    /// Where the goal is.
    pub fn goal(&self) -> [f64; 2] {
        self.goal
    }

    /// x, y, velocity x, y of a recorded row; its place must be free in this maze.
    fn recorded(&self, what: &str, row: &BTreeMap<String, Value>) -> Result<[f64; 4], EnvError> {
        let wrong = |reason: String| EnvError::Reset { env: self.spec.id.clone(), reason };
        let value = row.get("state").ok_or_else(|| wrong(format!("a {what} needs the column `state`")))?;
        let values = value.cast("state", Dtype::F64, &[4])?.to_f64s("state")?;
        if values.iter().any(|number| !number.is_finite()) {
            return Err(wrong(format!("the `state` of the recorded {what} is not finite")));
        }
        let state: [f64; 4] = values.try_into().expect("cast to four values");
        let [x, y, ..] = state;
        let layout = layout(&self.fov);
        if !layout.is_free(cell_at([x, y])) {
            let name = layout.name;
            return Err(wrong(format!(
                "the recorded {what} [{x}, {y}] lies in a wall of the layout {name}; set maze.layout to that of the \
                 recording"
            )));
        }
        Ok(state)
    }

    /// x, y, velocity x, y of the disc.
    pub fn state(&self) -> [f64; 4] {
        let ([x, y], [vx, vy]) = (self.sim.position(), self.sim.velocity());
        [x, y, vx, vy]
    }

    fn outcome(&self) -> Outcome {
        let success = distance(self.sim.position(), self.goal) < self.fov.f64("goal.radius");
        Outcome {
            reward: if success { 0.0 } else { -1.0 },
            terminated: success && self.settings.terminate_at_goal,
            success: Some(success),
        }
    }

    fn refresh_look(&mut self) {
        if let Some(image) = &mut self.image {
            image.set_look(Look::new(&self.fov, self.settings.with_target.then_some(self.goal)));
        }
    }
}

impl Env for PointMaze {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        let [x, y] = start(&self.fov);
        let [x, y, vx, vy] = match &episode.options.start {
            Some(row) => self.recorded("start", row)?,
            None => [x, y, 0.0, 0.0],
        };
        self.goal = match &episode.options.goal {
            Some(row) => self.recorded("goal", row).map(|[x, y, ..]| [x, y])?,
            None => goal(&self.fov),
        };
        self.sim = PointSim::new(layout(&self.fov), disc(&self.fov));
        self.sim.place([x, y], [vx, vy]);
        self.ways = OnceLock::new();
        self.refresh_look();
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let Slice::F32(&[x, y]) = action else {
            let reason = format!("{} values of {} are no action", action.len(), action.dtype());
            return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
        };
        self.sim.control_step([x, y].map(|force| f64::from(force.clamp(-1.0, 1.0))));
        if self.state().iter().any(|value| !value.is_finite()) {
            let reason = format!("the state is not finite after the action {:?}", [x, y]);
            return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
        }
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let [x, y] = self.goal;
        out.write(GOAL_STATE, &[x, y, 0.0, 0.0]);
        out.write(GOAL_PROPRIO, &[x, y, 0.0, 0.0]);
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            if image.goal_is_stale {
                image.render_goal(|look, painter| look.render(self.goal, painter));
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let state = self.state();
        let [x, y, vx, vy] = state;
        out.write(STATE, &state);
        out.write(PROPRIO, &state);
        out.write(POS_AGENT, &[x, y]);
        out.write(VEL_AGENT, &[vx, vy]);
        if let Some(image) = &mut self.image {
            let pixels = out.at(self.spec.fields.len() - 2);
            image.render(pixels, |look, painter| look.render([x, y], painter));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved {
            fov: self.fov.save(),
            goal: self.goal,
            position: self.sim.position(),
            velocity: self.sim.velocity(),
        };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        let Saved { fov, goal, position, velocity } = state.load(&self.spec.id)?;
        let fov = self.space.recall(&fov).map_err(|error| foreign(error.to_string()))?;
        if [goal, position, velocity].iter().flatten().any(|number| !number.is_finite()) {
            return Err(foreign("it holds values that are not finite".to_owned()));
        }
        // Planners return to states of one episode again and again: what does not change in it stays.
        let is_new = fov != self.fov;
        if is_new {
            self.sim = PointSim::new(layout(&fov), disc(&fov));
            self.fov = fov;
        }
        if is_new || goal != self.goal {
            self.goal = goal;
            self.ways = OnceLock::new();
            self.refresh_look();
        }
        self.sim.place(position, velocity);
        Ok(())
    }

    /// The way that is left to the goal after coasting to rest, as far as that goes along the way. Length.
    fn places(&self) -> Vec<Place> {
        vec![Place { name: "agent", at: in_image(&self.fov, self.sim.position()) }]
    }

    fn task_cost(&self) -> Option<f64> {
        let disc = disc(&self.fov);
        let to_goal = self.ways.get_or_init(|| ways(layout(&self.fov), disc.radius, self.goal));
        let (position, velocity) = (self.sim.position(), self.sim.velocity());
        let leg = to_goal.leg(position);
        let reach = distance(position, leg.to);
        let along: f64 = [0, 1].iter().map(|&axis| (leg.to[axis] - position[axis]) * velocity[axis]).sum();
        let coasting = if reach > 0.0 { along / reach / disc.damping } else { 0.0 };
        Some(leg.length - coasting.min(reach))
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
    let episode = |name: &str, dim: usize| Field::episode(name, Dtype::F64, &[dim]);
    let mut fields = vec![
        step("state", 4),
        step("proprio", 4),
        step("pos_agent", 2),
        step("vel_agent", 2),
        episode("goal_state", 4),
        episode("goal_proprio", 4),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    EnvSpec::new(POINT_MAZE.id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(STEP_S)
        .start_columns(&["state"])
        .goal_columns(&["state"])
}
