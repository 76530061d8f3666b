//! The environment: resets, control steps, saved states; `start` says where episodes begin.

use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Outcome, RowsMut, Slice, Space,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::Body;
use super::factors::{self, FLOOR_COLOR, SPEED, factor_values};
use super::humanoid::Observations;
use super::layout::{Cell, Maze, TELEPORTER_RADIUS, TELEPORTER_REACH, cell_at, distance, place_of};
use super::models::{Models, TARGET, TOP};
use super::rows::{START_COLUMNS, fields, first_factor};
use super::settings::Settings;
use super::soccer;
use super::state::TaskState;
use crate::inputs::{finite_values, recall};
use crate::views::{CameraName, GoalImage, Images, Views};
use swm_mujoco::MujocoError;
use swm_mujoco::assets;
use swm_mujoco::{Object, Simulation};

/// Physics steps per control step.
const SUBSTEPS: u32 = 5;

/// A body in a maze.
pub(super) struct MazeEnv {
    pub(super) spec: EnvSpec,
    pub(super) body: Body,
    pub(super) sim: Simulation,
    pub(super) task_state: TaskState,
    pub(super) settings: Settings,
    space: FovSpace,
    fov: Fov,
    models: Models,
    /// The geom that marks the goal.
    target: usize,
    /// Cells on the way to the goal, from each cell.
    ways: (Cell, Vec<Option<u32>>),
    /// Of the humanoid, whose observations are more than positions and velocities.
    pub(super) observations: Option<Observations>,
    images: Option<Rendering>,
    goal_image: Option<GoalImage>,
}

/// What images need.
struct Rendering {
    images: Images,
    /// The colors of the floor that they show.
    floor: Vec<f64>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    task_state: TaskState,
    simulation: Vec<f64>,
}

impl MazeEnv {
    /// Makes the environment `id`.
    pub(super) fn new(id: &'static str, body: Body, config: &EnvConfig) -> Result<Self, EnvError> {
        let settings = Settings::read(config, id, body)?;
        Self::assemble(id, body, settings, config).map_err(|error| error.at_making(id))
    }

    fn assemble(id: &str, body: Body, settings: Settings, config: &EnvConfig) -> Result<Self, MujocoError> {
        let space = factors::space(&factors::controls(body));
        let models = Models::new(body, settings.maze_type)?;
        let mut sim = Simulation::new(models.light())?;
        sim.reset();
        sim.forward()?;
        let (nq, nv) = (sim.model().nq(), sim.model().nv());
        let mut columns = fields(body, [nq, nv]);
        columns.extend(space.fields());
        let image = config.image;
        let goal_image = image.map(|size| GoalImage::new(size, &mut columns));
        let camera = CameraName::Name(if body == Body::Point { TOP } else { "back" }.to_owned());
        let full = models.full();
        let views = Views::new(&settings.images, &camera, &full, image)?;
        columns.extend(views.iter().flat_map(Views::fields));
        let fov = space.defaults();
        let rendering = |views| -> Result<Rendering, MujocoError> {
            Ok(Rendering { images: Images::new(views, &full)?, floor: factor_values(&fov, FLOOR_COLOR) })
        };
        let images = views.map(rendering).transpose()?;
        let spec = EnvSpec::new(id, Space::uniform_box(Dtype::F32, &[sim.model().nu()], -1.0, 1.0), columns)
            .factors(space.specs())
            .time_step_s(sim.model().timestep_s() * f64::from(SUBSTEPS))
            .start_columns(START_COLUMNS)
            .goal_columns(&["qpos"])
            .start_extras(&["prev_qpos", "prev_qvel"])
            .asset_hashes(assets::asset_hashes(body.files()));
        let target = models.light().id(Object::Geom, TARGET)?;
        let task_state = TaskState::new(0, nq, nv);
        let ways = ([0, 0], Vec::new());
        let observations =
            (body == Body::Humanoid).then(|| Observations::new(&models.light())).transpose()?;
        let mut env = Self {
            spec,
            body,
            sim,
            task_state,
            settings,
            space,
            fov,
            models,
            target,
            ways,
            observations,
            images,
            goal_image,
        };
        env.set_model()?;
        Ok(env)
    }

    pub(super) fn maze(&self) -> Maze {
        self.settings.maze_type
    }

    /// Where the body is: x, y, m.
    pub(super) fn place(&self) -> [f64; 2] {
        [self.sim.qpos()[0], self.sim.qpos()[1]]
    }

    /// Gives the simulation and the images the model of the present factors. The state stays.
    fn set_model(&mut self) -> Result<(), MujocoError> {
        let is_other = self.models.apply(&self.fov, &mut self.sim)?;
        let floor = factor_values(&self.fov, FLOOR_COLOR);
        let Some(rendering) = &mut self.images else { return Ok(()) };
        let full = self.models.full();
        if is_other {
            rendering.images.set_model(&full)?;
        }
        let is_encoded = factors::is_encoded(&self.fov);
        if !is_encoded && (is_other || rendering.floor != floor) {
            let texture = full.id(Object::Texture, "grid")?;
            let colors = factors::floor_colors(&floor);
            rendering.images.recolor(&full, texture, &|_, color| colors(color))?;
        }
        rendering.floor = floor;
        Ok(())
    }

    /// Shows the marker where the goal is, and finds the ways there.
    fn know_goal(&mut self) {
        let goal = self.task_state.goal;
        self.sim.model_mut().geom_pos_mut()[3 * self.target..][..2].copy_from_slice(&goal);
        let cell = cell_at(goal);
        if self.ways.0 != cell || self.ways.1.is_empty() {
            self.ways = (cell, self.maze().ways(cell));
        }
        GoalImage::renew(&mut self.goal_image);
    }

    /// The place of what has to reach the goal: x, y, m.
    fn place_that_counts(&self) -> [f64; 2] {
        if self.body.has_ball() { soccer::ball_place(self.sim.qpos()) } else { self.place() }
    }

    /// Observes the goal, where that takes more than its positions and velocities.
    fn observe_goal(&mut self) -> Result<(), MujocoError> {
        let Self { observations, sim, task_state: TaskState { goal_qpos, goal_qvel, .. }, .. } = self;
        observations
            .as_mut()
            .map_or(Ok(()), |observations| observations.observe_goal(sim, goal_qpos, goal_qvel))
    }

    /// One control step.
    pub(super) fn advance(&mut self, action: &[f32]) -> Result<(), MujocoError> {
        match self.body {
            Body::Point => {
                // In single precision, as the reference has it.
                let speed = self.fov.f64(SPEED) as f32;
                let places = self.sim.qpos_mut().iter_mut();
                places.zip(action).for_each(|(place, value)| *place += f64::from(speed * value));
                self.sim.qvel_mut().fill(0.0);
            }
            Body::Ant | Body::Humanoid | Body::AntSoccer => {
                let controls = self.sim.ctrl_mut().iter_mut();
                controls.zip(action).for_each(|(control, value)| *control = f64::from(*value));
            }
        }
        self.sim.control_step(SUBSTEPS)
    }

    /// Takes the body from the way into a teleporter to one of its exits.
    fn teleport(&mut self) -> Result<(), MujocoError> {
        let Some(teleporters) = self.maze().teleporters() else { return Ok(()) };
        let place = self.place();
        let is_near = |cell: &Cell| distance(place, place_of(*cell)) <= TELEPORTER_RADIUS * TELEPORTER_REACH;
        if !teleporters.ins.iter().any(is_near) {
            return Ok(());
        }
        let mut stream =
            EpisodeSeed::new(self.task_state.seed as u64).indexed("teleporter", [self.task_state.step, 0]);
        let out = place_of(teleporters.outs[stream.random_range(0..teleporters.outs.len())]);
        self.sim.qpos_mut()[..2].copy_from_slice(&out);
        self.sim.forward()
    }

    fn is_at_goal(&self) -> bool {
        distance(self.place_that_counts(), self.task_state.goal) <= self.body.reach()
    }

    /// Renders the goal, and returns to where the episode is.
    fn render_goal(&mut self, pixels: &mut [u8]) -> Result<(), MujocoError> {
        let mut kept = Vec::new();
        self.sim.save(&mut kept);
        self.sim.qpos_mut().copy_from_slice(&self.task_state.goal_qpos);
        self.sim.qvel_mut().copy_from_slice(&self.task_state.goal_qvel);
        self.sim.forward()?;
        if let Some(rendering) = &mut self.images {
            rendering.images.render(&mut self.sim, pixels);
        }
        self.sim.load(&kept)
    }
}

impl Env for MazeEnv {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        let id = self.spec.id.clone();
        let at_reset = |error: MujocoError| error.at_reset(&id);
        self.set_model().map_err(at_reset)?;
        self.begin(episode).map_err(at_reset)?;
        if let Some(row) = &episode.options.start {
            self.start_from(row)?;
        }
        if let Some(row) = &episode.options.goal {
            self.set_goal(row)?;
        }
        self.know_goal();
        self.observe_goal().map_err(at_reset)?;
        self.task_state.before_qpos.copy_from_slice(self.sim.qpos());
        self.task_state.before_qvel.copy_from_slice(self.sim.qvel());
        if let Some(row) = &episode.options.start {
            let TaskState { before_qpos, before_qvel, .. } = &mut self.task_state;
            recall(row, "prev_qpos", before_qpos);
            recall(row, "prev_qvel", before_qvel);
        }
        self.task_state.success = self.is_at_goal();
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(self.task_state.success) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let failure = self.images.as_mut().and_then(|rendering| rendering.images.take_failure());
        if let Some(failure) = failure {
            return Err(failure.at_step(&self.spec.id));
        }
        let values = finite_values(action, self.spec.action.dim())?;
        let Self { sim, task_state, .. } = self;
        task_state.before_qpos.copy_from_slice(sim.qpos());
        task_state.before_qvel.copy_from_slice(sim.qvel());
        self.advance(values).map_err(|error| error.at_step(&self.spec.id))?;
        self.task_state.step += 1;
        let success = self.is_at_goal();
        self.task_state.success = success;
        self.teleport().map_err(|error| error.at_step(&self.spec.id))?;
        let reward = f64::from(u8::from(success)) - f64::from(u8::from(self.settings.task.is_some()));
        Ok(Outcome { reward, terminated: success && self.settings.terminate_at_goal, success: Some(success) })
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.write_goal(out);
        let first = first_factor(self.body);
        self.fov.write(first, out);
        if let Some(mut image) = self.goal_image.take() {
            image.write(out, |pixels| self.render_goal(pixels));
            self.goal_image = Some(image);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        if let Some(observations) = &mut self.observations {
            observations.observe(&self.sim);
        }
        self.write_step(out);
        let first = first_factor(self.body) + self.spec.factors.len() + 1;
        if let Some(rendering) = &mut self.images {
            rendering.images.write(&mut self.sim, first, out);
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let mut simulation = Vec::new();
        self.sim.save(&mut simulation);
        state.store(
            &self.spec.id,
            &Saved { fov: self.fov.save(), task_state: self.task_state.clone(), simulation },
        )
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        let TaskState { goal_qpos, goal_qvel, before_qpos, before_qvel, .. } = &saved.task_state;
        let dims = [goal_qpos, goal_qvel, before_qpos, before_qvel].map(Vec::len);
        let (nq, nv) = (self.sim.model().nq(), self.sim.model().nv());
        if dims != [nq, nv, nq, nv] {
            return Err(foreign("it belongs to another body".to_owned()));
        }
        if fov != self.fov {
            self.fov = fov;
            self.set_model().map_err(|error| error.at_restore(&self.spec.id))?;
            self.task_state.goal = [f64::NAN; 2];
        }
        let is_same_goal = saved.task_state.goal == self.task_state.goal
            && saved.task_state.goal_qpos == self.task_state.goal_qpos
            && saved.task_state.goal_qvel == self.task_state.goal_qvel;
        self.task_state = saved.task_state;
        if !is_same_goal {
            self.know_goal();
        }
        self.sim.load(&saved.simulation).map_err(|error| error.at_restore(&self.spec.id))?;
        if !is_same_goal {
            self.observe_goal().map_err(|error| error.at_restore(&self.spec.id))?;
        }
        Ok(())
    }

    fn renderer(&self) -> Option<String> {
        self.images.as_ref().map(|rendering| rendering.images.renderer())
    }

    /// The length of the way that is left, over the middles of cells, m; with a ball, see [`soccer::cost`].
    fn task_cost(&self) -> Option<f64> {
        let (maze, ways, goal) = (self.maze(), &self.ways.1, self.task_state.goal);
        Some(if self.body.has_ball() {
            soccer::cost(maze, ways, [self.place(), self.place_that_counts(), goal])
        } else {
            maze.way_left(ways, self.place(), goal)
        })
    }
}
