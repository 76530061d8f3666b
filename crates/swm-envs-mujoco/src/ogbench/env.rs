//! The environment: resets, control steps, rows, saved states.

mod goal;
mod rows;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, RowsMut, Slice,
    Space,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::columns::{Declare, Write, observation, visit};
use super::factors::{self, FLOOR_COLOR, LOCK_COLOR, factor_values};
use super::furniture::Which;
use super::layout::{CAMERA, FLOOR, Kind};
use super::models::Models;
use super::settings::{CUBE_SETTINGS, Mode, Settings};
use super::sim_state::{Goal, Observed, SimState};
use super::state::TaskState;
use super::table::Table;
use super::{start, targets};
use crate::inputs::finite_values;
use crate::views::{CameraName, GoalImage, Images, Views, settings};
use swm_mujoco::MujocoError;
use swm_mujoco::assets;
use swm_mujoco::{Object, Simulation};

/// Physics steps per control step.
pub(super) const SUBSTEPS: u32 = 25;
/// A target is done with when the effector is this high and this far from it, m, and touches nothing.
const LET_GO: f64 = 0.1;
const RAISED: f64 = 0.19;
const LOOSE: f64 = 0.1;

/// An environment of OGBench: an arm at a table.
pub(super) struct TableEnv {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    models: Models,
    sim: Simulation,
    table: Table,
    task_state: TaskState,
    sim_state: SimState,
    goal: Goal,
    lock_colors: Vec<f64>,
    scratch: Vec<f64>,
    /// Where the episode columns begin.
    episode_columns: usize,
    /// Where the columns of images begin.
    image_columns: usize,
    images: Option<Images>,
    goal_image: Option<GoalImage>,
    /// The colors of the floor that the images show.
    floor: Vec<f64>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    task_state: TaskState,
    sim_state: SimState,
    goal: Goal,
}

impl TableEnv {
    /// Makes the environment `id`.
    pub(super) fn new(id: &'static str, is_scene: bool, config: &EnvConfig) -> Result<Self, EnvError> {
        // The scene refuses what only cubes have with better words.
        let settings: Settings = settings::read(config, id, CUBE_SETTINGS)?;
        let kind =
            settings.kind(is_scene).map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        Self::assemble(id, kind, settings, config.image).map_err(|error| error.at_making(id))
    }

    fn assemble(
        id: &str,
        kind: Kind,
        settings: Settings,
        image: Option<ImageSize>,
    ) -> Result<Self, MujocoError> {
        let space = factors::space(kind, settings.mode, &factors::controls(kind, settings.mode));
        let models =
            Models::new(kind, settings.pixel_transparent_arm, factors::controls(kind, settings.mode))?;
        let mut sim = Simulation::new(models.light())?;
        sim.reset();
        sim.forward()?;
        let table = Table::new(kind, &sim)?;
        let task_state = TaskState::new(0, sim.qpos().len(), sim.qvel().len());
        let mut scratch = Vec::new();
        observation(&table, &sim, &task_state, &mut scratch);
        let mut declared = Declare::default();
        visit(&table, &sim, &task_state, &scratch, &mut declared);
        let mut fields = declared.0;
        let episode_columns = fields.len();
        fields.push(Field::episode("task_id", Dtype::I64, &[]));
        fields.push(Field::episode("goal_observation", Dtype::F64, &[scratch.len()]));
        fields.extend(space.fields());
        let goal_image = image.map(|size| GoalImage::new(size, &mut fields));
        let image_columns = fields.len();
        let full = models.full();
        let camera = CameraName::Name(CAMERA.to_owned());
        let views = Views::new(&settings.images, &camera, &full, image)?;
        fields.extend(views.iter().flat_map(Views::fields));
        let is_scene = kind == Kind::Scene;
        let spec = EnvSpec::new(id, Space::uniform_box(Dtype::F32, &[5], -1.0, 1.0), fields)
            .factors(space.specs())
            .time_step_s(sim.model().timestep_s() * f64::from(SUBSTEPS))
            .start_columns(if is_scene { rows::SCENE_START } else { rows::START })
            .goal_columns(if is_scene { &["qpos", "button_states"] } else { &["qpos"] })
            .start_extras(if is_scene { rows::SCENE_START_EXTRAS } else { rows::START_EXTRAS })
            .asset_hashes(assets::asset_hashes(assets::MANIPULATION));
        let images = views.map(|views| Images::new(views, &full)).transpose()?;
        let fov = space.defaults();
        let mut env = Self {
            sim_state: SimState::at_rest(&sim),
            goal: Goal::default(),
            lock_colors: if is_scene { factor_values(&fov, LOCK_COLOR) } else { Vec::new() },
            floor: FLOOR.to_vec(),
            spec,
            settings,
            space,
            fov,
            models,
            sim,
            table,
            task_state,
            scratch,
            episode_columns,
            image_columns,
            images,
            goal_image,
        };
        env.set_model()?;
        Ok(env)
    }

    /// Gives the simulation the model of the present factors.
    fn set_model(&mut self) -> Result<(), MujocoError> {
        self.models.apply(&self.fov, &mut self.sim)?;
        self.show_markers();
        if self.table.furniture.is_some() {
            self.lock_colors = factor_values(&self.fov, LOCK_COLOR);
        }
        let floor = factor_values(&self.fov, FLOOR_COLOR);
        if let Some(images) = &mut self.images
            && self.floor != floor
        {
            let full = self.models.full();
            let texture = full.id(Object::Texture, "grid")?;
            let colors = factors::floor_colors(&floor);
            images.recolor(&full, texture, &|at, color| colors.recolor(at, color))?;
            self.floor = floor;
        }
        Ok(())
    }

    /// Shows or hides where cubes belong.
    fn show_markers(&mut self) {
        let is_shown = self.settings.visualize_info;
        for marker in self.table.markers() {
            factors::show_marker(self.sim.model_mut(), marker, is_shown);
        }
    }

    /// Locks, frees and colors the furniture by the buttons' states, and computes everything.
    fn apply_buttons(&mut self, states: [u8; 2]) -> Result<(), MujocoError> {
        let Some(furniture) = &self.table.furniture else { return Ok(()) };
        furniture.show_states(self.sim.model_mut(), states, &self.lock_colors);
        self.sim.forward()
    }

    fn begin(&mut self, episode: &Episode<'_>) -> Result<(), MujocoError> {
        let Self { sim, table, task_state, fov, settings, .. } = self;
        *task_state = TaskState::new(episode.seed.value(), sim.qpos().len(), sim.qvel().len());
        sim.reset();
        sim.forward()?;
        match settings.mode {
            Mode::DataCollection => {
                start::place_by_factors(table, sim, task_state, fov)?;
                targets::show(table, sim, fov);
                targets::sample(table, sim, task_state, fov);
            }
            Mode::Task => {
                let task = start::Chosen::new(table, settings.task, settings.permute_blocks, task_state);
                task.set_goals(table, sim, task_state, fov);
                task.place(table, sim, task_state, fov)?;
            }
        }
        sim.forward()
    }

    /// Whether a target is reached and done with.
    fn is_done_with_target(&self) -> bool {
        let Self { settings, task_state, table, sim, .. } = self;
        if settings.mode != Mode::DataCollection
            || !settings.new_targets
            || task_state.goal_is_given
            || !task_state.success
        {
            return false;
        }
        let effector = table.robot.effector(sim).position;
        let away = super::pose::distance(effector, table.place_of(sim, task_state.pursued));
        effector[2] > RAISED && away > LET_GO && table.robot.gripper_contact(sim) < LOOSE
    }

    fn advance(&mut self, action: [f32; 5]) -> Result<(), MujocoError> {
        if self.is_done_with_target() {
            targets::sample(&self.table, &mut self.sim, &mut self.task_state, &self.fov);
        }
        let Self { sim, task_state, table, sim_state, .. } = self;
        task_state.before_qpos.copy_from_slice(sim.qpos());
        task_state.before_qvel.copy_from_slice(sim.qvel());
        task_state.before_buttons = task_state.buttons;
        match sim_state.observed() {
            Some(Observed { effector, .. }) => table.robot.command_from(sim, effector, action),
            None => table.robot.command(sim, action),
        }
        sim_state.advance(sim)?;
        if let Some(furniture) = &table.furniture {
            let pressed = furniture.pressed(&task_state.before_qpos, sim);
            for (state, is_pressed) in task_state.buttons.iter_mut().zip(pressed) {
                *state ^= u8::from(is_pressed);
            }
            self.apply_buttons(self.task_state.buttons)?;
        }
        self.task_state.success = self.table.is_met(&self.sim, &self.task_state, self.task_state.pursued);
        Ok(())
    }
}

impl Env for TableEnv {
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
        let goal = episode.options.goal.as_ref().map(|row| self.set_goal(row)).transpose()?;
        self.task_state.before_qpos.copy_from_slice(self.sim.qpos());
        self.task_state.before_qvel.copy_from_slice(self.sim.qvel());
        self.task_state.before_buttons = self.task_state.buttons;
        let observed = episode.options.start.as_ref().and_then(|row| self.recall(row));
        self.visit_goal(goal, observed).map_err(at_reset)?;
        self.task_state.success = self.table.is_met(&self.sim, &self.task_state, self.task_state.pursued);
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(self.task_state.success) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        if let Some(failure) = self.images.as_mut().and_then(Images::take_failure) {
            return Err(failure.at_step(&self.spec.id));
        }
        let values = finite_values(action, 5)?.first_chunk().expect("five values");
        self.advance(*values).map_err(|error| error.at_step(&self.spec.id))?;
        let success = self.task_state.success;
        let reward = match self.settings.task {
            Some(_) => -(self.table.unmet_count(&self.sim, &self.task_state) as f64),
            None => f64::from(u8::from(success)),
        };
        Ok(Outcome { reward, terminated: success && self.settings.ends_at_goal(), success: Some(success) })
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(self.episode_columns, &[self.task_state.task]);
        out.write(self.episode_columns + 1, &self.goal.observation);
        self.fov.write(self.episode_columns + 2, out);
        if let Some(mut image) = self.goal_image.take() {
            image.write(out, |pixels| self.render_goal(pixels));
            self.goal_image = Some(image);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Self { sim, table, task_state, scratch, image_columns, images, .. } = self;
        scratch.clear();
        observation(table, sim, task_state, scratch);
        visit(table, sim, task_state, scratch, &mut Write::new(out));
        if let Some(images) = images {
            images.write(sim, *image_columns, out);
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved {
            fov: self.fov.save(),
            task_state: self.task_state.clone(),
            sim_state: self.sim_state.clone(),
            goal: self.goal.clone(),
        };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        let dims = [
            saved.task_state.before_qpos.len(),
            saved.task_state.before_qvel.len(),
            saved.goal.observation.len(),
        ];
        if dims != [self.sim.qpos().len(), self.sim.qvel().len(), self.goal_dim()] {
            return Err(foreign("it belongs to another table".to_owned()));
        }
        let is_same_model = fov == self.fov;
        if !is_same_model || saved.goal != self.goal {
            GoalImage::renew(&mut self.goal_image);
        }
        (self.fov, self.task_state) = (fov, saved.task_state);
        (self.sim_state, self.goal) = (saved.sim_state, saved.goal);
        let restored = (|| {
            if !is_same_model {
                self.set_model()?;
            }
            if let Some(furniture) = &self.table.furniture {
                for which in [Which::Drawer, Which::Window] {
                    let goal = self.task_state.goal_slides[which as usize];
                    furniture.set_handle_target(self.sim.model_mut(), which, goal);
                }
            }
            self.stand()
        })();
        restored.map_err(|error: MujocoError| error.at_restore(&self.spec.id))
    }

    fn renderer(&self) -> Option<String> {
        self.images.as_ref().map(Images::renderer)
    }

    /// What is left to do, in m: for each cube, drawer and window its distance from where it belongs, 0.1 for a button; and,
    /// at a lower weight, the effector's distance from what is next.
    fn task_cost(&self) -> Option<f64> {
        Some(self.table.cost(&self.sim, &self.task_state))
    }
}

impl TableEnv {
    fn goal_dim(&self) -> usize {
        self.spec.fields[0].dim()
    }
}
