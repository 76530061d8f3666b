//! The environment: resets, control steps, saved states.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use swm_core::{Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Outcome, RowsMut, Slice, Space};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::factors::{self, ANGLE, BACKGROUND, GOAL, GRIPPER, IN_THE_AIR, OBJECT, VIEW, pair, values};
use super::models::{Shared, Start, settle};
use super::robot::{Robot, distance};
use super::rows::{TaskState, episode_columns, fields, start_columns};
use super::settings::{SETTINGS, Settings};
use super::task::{REACHED, Reward, SUBSTEPS, Task, Variant};
use crate::inputs::finite_values;
use crate::suite::Control;
use crate::views::{CameraName, GoalImage, Images, Views, settings};
use swm_mujoco::MujocoError;
use swm_mujoco::assets;
use swm_mujoco::visuals::mjTEXTURE_SKYBOX;
use swm_mujoco::{Object, Simulation};

/// The share of the gripper's distance to the object in the task cost: a planner finds the object by it.
const APPROACH_COST: f64 = 0.1;
/// Control steps in which the image of Reach's goal brings the gripper there.
const REACHING: usize = 15;

/// A Fetch arm at a table.
pub(super) struct FetchEnv {
    pub(super) variant: Variant,
    pub(super) spec: EnvSpec,
    pub(super) robot: Robot,
    pub(super) task_state: TaskState,
    settings: Settings,
    controls: Vec<Control>,
    space: FovSpace,
    fov: Fov,
    shared: Arc<Shared>,
    /// The start with the gripper at the last value of its factor that was not the default.
    shifted: Option<([f64; 2], Start)>,
    /// The site that marks the goal, and where its body is, m.
    target: (usize, [f64; 3]),
    images: Option<Rendering>,
    goal_image: Option<GoalImage>,
}

/// What images need.
struct Rendering {
    images: Images,
    /// The texture of the sky, and the color that it is shown in.
    sky: (Option<usize>, [f64; 3]),
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    task_state: TaskState,
    simulation: Vec<f64>,
}

impl FetchEnv {
    /// Makes one of the environments.
    pub(super) fn new(variant: Variant, config: &EnvConfig) -> Result<Self, EnvError> {
        let settings: Settings = settings::read(config, variant.id, SETTINGS)?;
        Self::assemble(variant, settings, config).map_err(|error| error.at_making(variant.id))
    }

    fn assemble(variant: Variant, settings: Settings, config: &EnvConfig) -> Result<Self, MujocoError> {
        let task = variant.task;
        let controls = factors::controls(task);
        let space = factors::space(task, &controls);
        let shared = Shared::get(task)?;
        let model = Arc::clone(&shared.model);
        let mut columns = fields(&variant, [model.nq(), model.nv()]);
        columns.extend(space.fields());
        let image = config.image;
        let goal_image = image.map(|size| GoalImage::new(size, &mut columns));
        let camera = CameraName::Name(VIEW.to_owned());
        let views = Views::new(&settings.images, &camera, &model, image)?;
        columns.extend(views.iter().flat_map(Views::fields));
        let sky =
            (0..model.texture_count()).find(|&index| model.texture_type(index) == mjTEXTURE_SKYBOX as i32);
        let rendering = |views| -> Result<Rendering, MujocoError> {
            Ok(Rendering { images: Images::new(views, &model)?, sky: (sky, [f64::NAN; 3]) })
        };
        let images = views.map(rendering).transpose()?;
        let spec = EnvSpec::new(variant.id, Space::uniform_box(Dtype::F32, &[4], -1.0, 1.0), columns)
            .factors(space.specs())
            .time_step_s(model.timestep_s() * f64::from(SUBSTEPS))
            .start_columns(start_columns(task))
            .goal_columns(&["achieved_goal", "qpos"])
            .start_extras(&["proprio"])
            .asset_hashes(assets::asset_hashes(assets::FETCH));
        let mut sim = Simulation::new(Arc::clone(&model))?;
        sim.reset();
        sim.forward()?;
        let marker = model.id(Object::Site, "target0")?;
        let target = (marker, sim.xpos(model.site_body()[marker] as usize));
        let observation = vec![0.0; task.observation_dim()];
        let (goal_qpos, is_goal_recorded) = (sim.qpos().to_vec(), false);
        let task_state = TaskState { steps: 0, goal: [0.0; 3], goal_qpos, is_goal_recorded, observation };
        let (fov, robot) = (space.defaults(), Robot::new(task, sim)?);
        let shifted = None;
        let mut env = Self {
            variant,
            spec,
            robot,
            task_state,
            settings,
            controls,
            space,
            fov,
            shared,
            shifted,
            target,
            images,
            goal_image,
        };
        env.set_model()?;
        Ok(env)
    }

    /// Gives the simulation and the images the model of the present factors. The state stays.
    fn set_model(&mut self) -> Result<(), MujocoError> {
        self.shared.apply(&self.controls, &self.fov, &mut self.robot.sim)?;
        let color = values(&self.fov, BACKGROUND);
        if let Some(Rendering { images, sky: (Some(texture), shown), .. }) = &mut self.images
            && *shown != color
        {
            let byte = color.map(|value| (255.0 * value) as u8);
            images.recolor(&self.shared.model, *texture, &|_, _| byte)?;
            *shown = color;
        }
        Ok(())
    }

    /// Shows the marker where the goal is; the next image of the goal is rendered anew.
    fn show_goal(&mut self) {
        let (marker, body) = self.target;
        let goal = self.task_state.goal;
        let place: [f64; 3] = std::array::from_fn(|k| goal[k] - body[k]);
        self.robot.sim.model_mut().site_pos_mut()[3 * marker..][..3].copy_from_slice(&place);
        GoalImage::renew(&mut self.goal_image);
    }

    /// Places arm and object by the factors.
    fn place(&mut self) -> Result<(), MujocoError> {
        let task = self.variant.task;
        let (wanted, [x, y, _]) = (pair(&self.fov, GRIPPER), task.gripper());
        let start = if wanted == [x, y] {
            &self.shared.start
        } else {
            if self.shifted.as_ref().is_none_or(|(known, _)| *known != wanted) {
                let start = settle(task, &self.shared.model, [wanted[0] - x, wanted[1] - y])?;
                self.shifted = Some((wanted, start));
            }
            self.shifted.as_ref().map_or(&self.shared.start, |(_, start)| start)
        };
        let sim = &mut self.robot.sim;
        sim.reset();
        sim.set_time(start.time_s);
        sim.qpos_mut().copy_from_slice(&start.qpos);
        sim.qvel_mut().copy_from_slice(&start.qvel);
        if let Some(pose) = self.robot.object_pose_mut() {
            pose[..2].copy_from_slice(&pair(&self.fov, OBJECT));
            let [angle] = values(&self.fov, ANGLE);
            // At 0 it lies as it came to rest.
            if angle != 0.0 {
                let (sin, cos) = (angle / 2.0).sin_cos();
                pose[3..].copy_from_slice(&[cos, 0.0, 0.0, sin]);
            }
        }
        self.robot.sim.forward()?;
        let mut goal: [f64; 3] = values(&self.fov, GOAL);
        if task == Task::PickAndPlace && values(&self.fov, IN_THE_AIR) == [0.0] {
            goal[2] = task.height();
        }
        self.task_state.goal = goal;
        Ok(())
    }

    /// The distance to the goal, m.
    fn distance(&self) -> f64 {
        distance(self.achieved(), self.task_state.goal)
    }

    /// Renders the goal, and returns to where the episode is.
    fn render_goal(&mut self, pixels: &mut [u8]) -> Result<(), MujocoError> {
        let mut kept = Vec::new();
        self.robot.sim.save(&mut kept);
        self.go_to_goal()?;
        if let Some(rendering) = &mut self.images {
            rendering.images.render(&mut self.robot.sim, pixels);
        }
        self.robot.sim.load(&kept)
    }

    /// The recorded row that is the goal; else the object at the goal, or the gripper brought there.
    fn go_to_goal(&mut self) -> Result<(), MujocoError> {
        let TaskState { goal, ref goal_qpos, is_goal_recorded, .. } = self.task_state;
        self.robot.sim.reset();
        self.robot.sim.qpos_mut().copy_from_slice(goal_qpos);
        if !is_goal_recorded && let Some(pose) = self.robot.object_pose_mut() {
            pose[..3].copy_from_slice(&goal);
        }
        self.robot.sim.forward()?;
        if is_goal_recorded || self.variant.task.has_object() {
            return Ok(());
        }
        let mut unused = Vec::new();
        for _ in 0..REACHING {
            let grip = self.robot.grip();
            let stride = |k: usize| (10.0 * (goal[k] - grip[k])) as f32;
            self.robot.advance([stride(0), stride(1), stride(2), 0.0], &mut unused)?;
        }
        Ok(())
    }
}

impl Env for FetchEnv {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let id = self.variant.id;
        self.fov = self.space.sample(id, episode)?;
        let at_reset = |error: MujocoError| error.at_reset(id);
        self.set_model().map_err(at_reset)?;
        self.place().map_err(at_reset)?;
        if let Some(row) = &episode.options.start {
            self.start_from(row)?;
        }
        let Self { robot, task_state, .. } = self;
        (task_state.steps, task_state.is_goal_recorded) = (0, false);
        task_state.goal_qpos.copy_from_slice(robot.sim.qpos());
        if let Some(row) = &episode.options.goal {
            self.set_goal(row)?;
        }
        self.show_goal();
        self.robot.observe(&mut self.task_state.observation);
        if let Some(row) = &episode.options.start {
            self.recall_observation(row);
        }
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(self.distance() < REACHED) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let id = self.variant.id;
        let failure = self.images.as_mut().and_then(|rendering| rendering.images.take_failure());
        if let Some(failure) = failure {
            return Err(failure.at_step(id));
        }
        let values = finite_values(action, 4)?.first_chunk().expect("four values");
        let Self { robot, task_state, .. } = self;
        robot.advance(*values, &mut task_state.observation).map_err(|error| error.at_step(id))?;
        task_state.steps += 1;
        let distance = self.distance();
        let reward = match self.variant.reward {
            Reward::Sparse => -f64::from(u8::from(distance > REACHED)),
            Reward::Dense => -distance,
        };
        Ok(Outcome { reward, terminated: false, success: Some(distance < REACHED) })
    }

    fn is_truncated(&self) -> bool {
        self.settings.time_limit != 0 && self.task_state.steps >= self.settings.time_limit
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let first = episode_columns(self.variant.task);
        out.write(first, &self.task_state.goal);
        out.write(first + 1, &self.task_state.goal);
        self.fov.write(first + 2, out);
        if let Some(mut image) = self.goal_image.take() {
            image.write(out, |pixels| self.render_goal(pixels));
            self.goal_image = Some(image);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        self.write_step(out);
        let first = episode_columns(self.variant.task) + 3 + self.spec.factors.len();
        if let Some(rendering) = &mut self.images {
            rendering.images.write(&mut self.robot.sim, first, out);
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let mut simulation = Vec::new();
        self.robot.sim.save(&mut simulation);
        let saved = Saved { fov: self.fov.save(), task_state: self.task_state.clone(), simulation };
        state.store(self.variant.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let id = self.variant.id;
        let saved: Saved = state.load(id)?;
        let foreign = |reason: String| EnvError::State { env: id.to_owned(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        let nq = self.robot.sim.model().nq();
        if saved.task_state.observation.len() != self.variant.task.observation_dim()
            || saved.task_state.goal_qpos.len() != nq
        {
            return Err(foreign("it belongs to another task".to_owned()));
        }
        let is_other = fov != self.fov;
        if is_other {
            self.fov = fov;
            self.set_model().map_err(|error| error.at_restore(id))?;
        }
        let is_other = is_other
            || saved.task_state.goal != self.task_state.goal
            || saved.task_state.goal_qpos != self.task_state.goal_qpos;
        self.task_state = saved.task_state;
        if is_other {
            self.show_goal();
        }
        self.robot.sim.load(&saved.simulation).map_err(|error| error.at_restore(id))
    }

    fn renderer(&self) -> Option<String> {
        self.images.as_ref().map(|rendering| rendering.images.renderer())
    }

    /// The distance to the goal, and a tenth of that from gripper to object, m.
    fn task_cost(&self) -> Option<f64> {
        let approach =
            if self.variant.task.has_object() { distance(self.robot.grip(), self.achieved()) } else { 0.0 };
        Some(self.distance() + APPROACH_COST * approach)
    }
}
