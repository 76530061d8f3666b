//! The environment: resets, control steps, saved states.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use swm_core::{Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Outcome, RowsMut, Slice, Space};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::factors::{self, HAND, placed, stride, values};
use super::models::{Scaled, Shared};
use super::reward::{Worth, worth};
use super::robot::{Frame, JOINT, Origin, Robot, minus, norm};
use super::rows::{EPISODE, START, START_EXTRAS, TaskState, fields};
use super::settings::{SETTINGS, Settings, VIEW};
use super::task::{Done, SUBSTEPS, Task};
use crate::inputs::finite_values;
use crate::suite::Control;
use crate::views::{CameraName, GoalImage, Images, Views, settings};
use swm_mujoco::MujocoError;
use swm_mujoco::assets;
use swm_mujoco::{Object, Simulation};

/// The share of the distance from fingers to object in the task cost: a planner finds the object by it.
const APPROACH_COST: f64 = 0.3;
/// The hand above the middle of the finger tips, m.
const ABOVE: f64 = 0.045;
/// Bounds of the hand in observations, m.
const SEEN: [[f64; 3]; 2] = [[-0.525, 0.348, -0.0525], [0.525, 1.025, 0.7]];

/// A Sawyer arm at a table.
pub(super) struct MetaWorldEnv {
    pub(super) task: &'static Task,
    pub(super) spec: EnvSpec,
    pub(super) robot: Robot,
    pub(super) task_state: TaskState,
    pub(super) settings: Settings,
    controls: Vec<Control>,
    space: FovSpace,
    fov: Fov,
    shared: Arc<Shared>,
    scaled: Scaled,
    /// How far an action of 1 moves the hand's target, m.
    stride: f32,
    /// The site that marks the goal.
    marker: Option<usize>,
    images: Option<Images>,
    goal_image: Option<GoalImage>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    task_state: TaskState,
    simulation: Vec<f64>,
}

impl MetaWorldEnv {
    /// Makes the environment of a task.
    pub(super) fn new(task: &'static Task, config: &EnvConfig) -> Result<Self, EnvError> {
        let settings: Settings = settings::read(config, task.id, SETTINGS)?;
        Self::assemble(task, settings, config).map_err(|error| error.at_making(task.id))
    }

    fn assemble(task: &'static Task, settings: Settings, config: &EnvConfig) -> Result<Self, MujocoError> {
        let controls = factors::controls(task);
        let space = factors::space(task, &controls);
        let shared = Shared::get(task)?;
        let model = Arc::clone(&shared.light);
        let mut columns = fields([model.nq(), model.nv()]);
        columns.extend(space.fields());
        let image = config.image;
        let goal_image = image.map(|size| GoalImage::new(size, &mut columns));
        let camera = CameraName::Name(VIEW.to_owned());
        let views = Views::new(&settings.images, &camera, &shared.full, image)?;
        columns.extend(views.iter().flat_map(Views::fields));
        let images = views.map(|views| Images::new(views, &shared.full)).transpose()?;
        let spec = EnvSpec::new(task.id, Space::uniform_box(Dtype::F32, &[4], -1.0, 1.0), columns)
            .factors(space.specs())
            .time_step_s(model.timestep_s() * f64::from(SUBSTEPS))
            .start_columns(START)
            .goal_columns(&["achieved_goal", "qpos"])
            .start_extras(START_EXTRAS)
            .asset_hashes(assets::asset_hashes(assets::METAWORLD));
        let sim = Simulation::new(Arc::clone(&model))?;
        let task_state = TaskState {
            steps: 0,
            origin: Origin::default(),
            frames: [[0.0; 18]; 2],
            worth: Worth::default(),
            goal_qpos: sim.qpos().to_vec(),
            is_goal_recorded: false,
        };
        // The button has its goal marked on its box.
        let marker = model.id(Object::Site, "goal").ok();
        let mut env = Self {
            fov: space.defaults(),
            robot: Robot::new(task, sim)?,
            goal_image,
            scaled: None,
            stride: 0.0,
            task,
            spec,
            task_state,
            settings,
            controls,
            space,
            shared,
            marker,
            images,
        };
        env.set_model()?;
        env.robot.sim.reset();
        env.robot.sim.forward()?;
        Ok(env)
    }

    /// Gives the simulation the model of the present factors. The state stays.
    fn set_model(&mut self) -> Result<(), MujocoError> {
        self.stride = stride(self.task, &self.fov);
        let model = (&self.fov, &mut self.scaled);
        self.shared.apply(self.task, &self.controls, model, &mut self.robot.sim)
    }

    /// Shows the marker where the goal is; the next image of the goal is rendered anew.
    fn show_goal(&mut self) {
        if let Some(marker) = self.marker {
            let target = self.task_state.origin.target;
            self.robot.sim.model_mut().site_pos_mut()[3 * marker..][..3].copy_from_slice(&target);
        }
        GoalImage::renew(&mut self.goal_image);
    }

    /// Renders the goal, and returns to where the episode is.
    fn render_goal(&mut self, pixels: &mut [u8]) -> Result<(), MujocoError> {
        let mut kept = Vec::new();
        self.robot.sim.save(&mut kept);
        self.go_to_goal()?;
        if let Some(images) = &mut self.images {
            images.render(&mut self.robot.sim, pixels);
        }
        self.robot.sim.load(&kept)
    }

    /// The recorded row that is the goal; else what is moved brought to the goal.
    fn go_to_goal(&mut self) -> Result<(), MujocoError> {
        let TaskState { origin: Origin { target, .. }, ref goal_qpos, is_goal_recorded, .. } =
            self.task_state;
        let sim = &mut self.robot.sim;
        sim.qpos_mut().copy_from_slice(goal_qpos);
        sim.qvel_mut().fill(0.0);
        if !is_goal_recorded {
            match self.task.done {
                Done::Hand => self.robot.drive([target[0], target[1], target[2] + ABOVE])?,
                Done::Object(off) => {
                    let place: [f64; 3] = std::array::from_fn(|k| target[k] + off[k]);
                    sim.qpos_mut()[JOINT..JOINT + 3].copy_from_slice(&place);
                }
                Done::Joint(at) => sim.qpos_mut()[JOINT] = at,
            }
        }
        self.robot.sim.forward()
    }

    /// A frame as it is observed after a step: within the bounds of the original. (Its bounds of the goal are left out, since
    /// an observation would be wrong about goals beyond them.)
    fn bounded(mut frame: Frame) -> Frame {
        for (k, place) in frame[..3].iter_mut().enumerate() {
            *place = place.clamp(SEEN[0][k], SEEN[1][k]);
        }
        frame
    }

    fn begin(&mut self) -> Result<(), MujocoError> {
        self.set_model()?;
        let [object, goal] = placed(self.task, &self.fov);
        let origin = self.robot.begin(values(&self.fov, HAND), object, goal)?;
        let frame = self.robot.look();
        let task_state = &mut self.task_state;
        *task_state = TaskState {
            steps: 0,
            origin,
            frames: [frame; 2],
            worth: Worth::default(),
            goal_qpos: std::mem::take(&mut task_state.goal_qpos),
            is_goal_recorded: false,
        };
        Ok(())
    }
}

impl Env for MetaWorldEnv {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let id = self.task.id;
        self.fov = self.space.sample(id, episode)?;
        self.begin().map_err(|error| error.at_reset(id))?;
        if let Some(row) = &episode.options.start {
            self.start_from(row)?;
            self.task_state.frames = [self.robot.look(); 2];
        }
        self.task_state.goal_qpos.copy_from_slice(self.robot.sim.qpos());
        if let Some(row) = &episode.options.goal {
            self.set_goal(row)?;
        }
        self.show_goal();
        let Self { robot, task_state, .. } = self;
        // Some tasks observe what is a physics step old. Images and the rest of the row show the state as it is.
        robot.sim.kinematics().map_err(|error| error.at_reset(id))?;
        task_state.worth = worth(robot, &task_state.origin, &robot.look(), 0.0);
        if let Some(row) = &episode.options.start {
            self.recall_observation(row);
        }
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(self.task_state.worth.success) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let id = self.task.id;
        if let Some(failure) = self.images.as_mut().and_then(Images::take_failure) {
            return Err(failure.at_step(id));
        }
        let values: [f32; 4] = *finite_values(action, 4)?.first_chunk().expect("four values");
        let action = values.map(|value| value.clamp(-1.0, 1.0));
        let Self { robot, task_state, stride, .. } = self;
        robot.advance(action, *stride).map_err(|error| error.at_step(id))?;
        task_state.steps += 1;
        task_state.frames = [robot.look(), task_state.frames[0]].map(Self::bounded);
        task_state.worth = worth(robot, &task_state.origin, &task_state.frames[0], action[3]);
        let Worth { reward, success, .. } = task_state.worth;
        let terminated = success && self.settings.terminate_on_success;
        Ok(Outcome { reward, terminated, success: Some(success) })
    }

    fn is_truncated(&self) -> bool {
        self.settings.time_limit != 0 && self.task_state.steps >= self.settings.time_limit
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let target = self.task_state.origin.target;
        out.write(EPISODE, &target);
        out.write(EPISODE + 1, &target.map(|value| value as f32));
        self.fov.write(EPISODE + 2, out);
        if let Some(mut image) = self.goal_image.take() {
            image.write(out, |pixels| self.render_goal(pixels));
            self.goal_image = Some(image);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        self.write_step(out);
        let first = EPISODE + 3 + self.spec.factors.len();
        if let Some(images) = &mut self.images {
            images.write(&mut self.robot.sim, first, out);
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let mut simulation = Vec::new();
        self.robot.sim.save(&mut simulation);
        let saved = Saved { fov: self.fov.save(), task_state: self.task_state.clone(), simulation };
        state.store(self.task.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let id = self.task.id;
        let saved: Saved = state.load(id)?;
        let foreign = |reason: String| EnvError::State { env: id.to_owned(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        if saved.task_state.goal_qpos.len() != self.robot.sim.model().nq() {
            return Err(foreign("it belongs to another task".to_owned()));
        }
        let is_other = fov != self.fov;
        if is_other {
            self.fov = fov;
            self.set_model().map_err(|error| error.at_restore(id))?;
        }
        let goal = |state: &TaskState| (state.origin.target, state.goal_qpos.clone());
        let is_other = is_other || goal(&saved.task_state) != goal(&self.task_state);
        self.task_state = saved.task_state;
        if is_other {
            self.show_goal();
        }
        self.robot.sim.load(&saved.simulation).map_err(|error| error.at_restore(id))
    }

    fn renderer(&self) -> Option<String> {
        self.images.as_ref().map(Images::renderer)
    }

    /// The distance of what is moved to the goal, and three tenths of that from finger tips to object, m.
    fn task_cost(&self) -> Option<f64> {
        let (robot, target) = (&self.robot, self.task_state.origin.target);
        let approach = match self.task.done {
            Done::Hand => 0.0,
            _ => norm(minus(robot.tips(), robot.object())),
        };
        Some(norm(minus(robot.achieved(), target)) + APPROACH_COST * approach)
    }
}
