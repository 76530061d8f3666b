//! The environment over a domain: reset, control steps, observation, saved states.

mod rows;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, ImageSize, Outcome, RowsMut, Slice, Space,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::Stage;
use super::domain::{Domain, Task, TaskEntry};
use super::image::Image;
use super::models::{Models, Origin};
use super::settings::{OnDivergence, SETTINGS, Settings};
use crate::inputs::finite_values;
use crate::views::{CameraName, GoalImage, Views, settings};
use rows::{ACT, Columns, OBSERVATION, QACC_WARMSTART, QPOS, QVEL, SCORE, TIME, fields};
use swm_mujoco::MujocoError;
use swm_mujoco::assets;

/// An environment of the DeepMind Control Suite.
pub struct SuiteEnv {
    spec: EnvSpec,
    domain: &'static Domain,
    settings: Settings,
    task: Box<dyn Task>,
    space: FovSpace,
    fov: Fov,
    models: Models,
    origin: Origin,
    stage: Stage,
    /// `[A]`: control ranges as (low, half width).
    ranges: Vec<[f64; 2]>,
    /// Sum of the rewards since the reset.
    total_reward: f64,
    control_steps: u64,
    /// Control steps after which an episode is cut.
    step_limit: u64,
    scratch: Vec<f64>,
    columns: Columns,
    image: Option<Image>,
    goal_image: Option<GoalImage>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    targets: Vec<f64>,
    simulation: Vec<f64>,
    total_reward: f64,
    control_steps: u64,
}

impl SuiteEnv {
    /// Makes the environment of a domain.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting; or MuJoCo, the model or its textures are missing.
    pub fn new(domain: &'static Domain, config: &EnvConfig) -> Result<Self, EnvError> {
        let id = domain.id;
        let settings: Settings = settings::read(config, id, SETTINGS)?;
        let wrong = |reason: String| EnvError::Setting { env: id.to_owned(), reason };
        let entry = chosen_task(domain, settings.task.as_deref()).map_err(wrong)?;
        if !(1..=1000).contains(&settings.action_repeat) {
            return Err(wrong(format!("action_repeat {} is not in 1 to 1000", settings.action_repeat)));
        }
        Self::assemble(domain, entry, settings, config.image).map_err(|error| error.at_making(id))
    }

    fn assemble(
        domain: &'static Domain,
        entry: &'static TaskEntry,
        settings: Settings,
        image: Option<ImageSize>,
    ) -> Result<Self, MujocoError> {
        let (models, space) = Models::new(domain, entry.name, settings.stock)?;
        let model = models.default_model();
        let task = (entry.make)(&model)?;
        let control_step_s = model.timestep_s() * f64::from(domain.substeps);
        let ranges =
            model.actuator_ctrlrange().chunks_exact(2).map(|range| [range[0], (range[1] - range[0]) / 2.0]);
        let ranges: Vec<[f64; 2]> = ranges.collect();
        let mut stage = Stage::new(model, domain.targets)?;
        stage.sim.reset();
        stage.sim.forward_without_actuation()?;
        let mut scratch = Vec::new();
        task.observe(&stage, &mut scratch);
        let camera = CameraName::Index(domain.camera);
        let views = Views::new(&settings.images, &camera, stage.sim.model(), image)?;
        let (mut fields, columns) = fields(domain, &stage, scratch.len(), &space, views.as_ref());
        // A goal that is a whole state.
        let shown = image.filter(|_| task.goal_qpos(&stage).is_some());
        let goal_image = shown.map(|size| GoalImage::new(size, &mut fields));
        let spec =
            EnvSpec::new(domain.id, Space::uniform_box(Dtype::F64, &[ranges.len()], -1.0, 1.0), fields)
                .factors(space.specs())
                .time_step_s(control_step_s * f64::from(settings.action_repeat))
                .start_columns(domain.start_columns)
                .goal_columns(entry.goal_columns)
                .start_extras(&["observation"])
                .asset_hashes(assets::asset_hashes(assets::SUITE));
        let image = views.map(|views| Image::new(&models, views, &space.defaults())).transpose()?;
        Ok(Self {
            spec,
            domain,
            image,
            goal_image,
            fov: space.defaults(),
            step_limit: (domain.time_limit_s / control_step_s).round() as u64,
            settings,
            task,
            space,
            models,
            origin: Origin::Shared,
            stage,
            ranges,
            total_reward: 0.0,
            control_steps: 0,
            scratch,
            columns,
        })
    }

    /// How the model of the present episode came about.
    pub fn model_origin(&self) -> Origin {
        self.origin
    }

    /// The simulation, and what the task has placed.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// Begins with the model for the present factors, at its reference position.
    fn set_model(&mut self) -> Result<(), MujocoError> {
        let (model, origin) = self.models.model(&self.fov)?;
        self.origin = origin;
        self.stage.sim.set_model(model)?;
        self.stage.forget_targets();
        match &mut self.image {
            Some(image) => image.prepare(&self.models, &self.fov),
            None => Ok(()),
        }
    }

    fn begin(&mut self, episode: &Episode<'_>) -> Result<(), MujocoError> {
        self.set_model()?;
        self.stage.sim.reset();
        match self.stage.sim.forward_without_actuation() {
            // As in dm_control: the task may yet place things where they do no harm.
            Ok(()) | Err(MujocoError::Diverged { .. }) => {}
            Err(error) => return Err(error),
        }
        let mut stream = episode.seed.stream("start");
        self.task.start(&mut self.stage, &mut stream)?;
        self.stage.sim.forward_without_actuation()
    }

    /// Computes where the goal is. What follows an exact start keeps its bits.
    fn see_goal(&mut self) -> Result<(), MujocoError> {
        let sim = &mut self.stage.sim;
        let warmstart = sim.qacc_warmstart().to_vec();
        sim.forward_without_actuation()?;
        sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        Ok(())
    }

    /// Renders the goal, and returns to where the episode is.
    fn render_goal(&mut self, pixels: &mut [u8]) -> Result<(), MujocoError> {
        let Self { image: Some(image), stage, task, .. } = self else { return Ok(()) };
        let Some(qpos) = task.goal_qpos(stage).map(<[f64]>::to_vec) else { return Ok(()) };
        let mut kept = Vec::new();
        stage.sim.save(&mut kept);
        stage.sim.qpos_mut().copy_from_slice(&qpos);
        stage.sim.qvel_mut().fill(0.0);
        stage.sim.forward_without_actuation()?;
        image.render(&mut stage.sim, pixels);
        stage.sim.load(&kept)
    }

    /// One control step with the controls that are set; the reward of the new state.
    fn control_step(&mut self) -> Result<Outcome, MujocoError> {
        self.stage.sim.control_step(self.domain.substeps)?;
        Ok(Outcome {
            reward: self.task.reward(&self.stage),
            terminated: self.task.terminated(&self.stage),
            success: self.task.success(&self.stage),
        })
    }

    fn set_controls(&mut self, action: Slice<'_>) -> Result<(), EnvError> {
        let values: &[f64] = finite_values(action, self.ranges.len())?;
        let controls = self.stage.sim.ctrl_mut().iter_mut();
        for ((control, [low, half]), value) in controls.zip(&self.ranges).zip(values) {
            // The action-scale wrapper's order of operations; not clipped, as there.
            *control = low + half * (value + 1.0);
        }
        Ok(())
    }
}

impl Env for SuiteEnv {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        (self.total_reward, self.control_steps) = (0.0, 0);
        self.begin(episode).map_err(|error| error.at_reset(&self.spec.id))?;
        let observed = match &episode.options.start {
            Some(row) => self.start_from(row)?,
            None => None,
        };
        if let Some(row) = &episode.options.goal {
            self.set_goal(row)?;
            self.see_goal().map_err(|error| error.at_reset(&self.spec.id))?;
        }
        if let Some(observed) = observed {
            self.task.recall(&mut self.stage, &observed);
        }
        GoalImage::renew(&mut self.goal_image);
        Ok(Outcome { reward: f64::NAN, terminated: false, success: self.task.success(&self.stage) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        if let Some(failure) = self.image.as_mut().and_then(Image::take_failure) {
            return Err(failure.at_step(&self.spec.id));
        }
        self.set_controls(action)?;
        let mut total = Outcome { reward: 0.0, terminated: false, success: None };
        for _ in 0..self.settings.action_repeat {
            let outcome = match self.control_step() {
                Ok(outcome) => outcome,
                Err(MujocoError::Diverged { .. }) if self.settings.on_divergence == OnDivergence::End => {
                    total.terminated = true;
                    break;
                }
                Err(error) => return Err(error.at_step(&self.spec.id)),
            };
            self.control_steps += 1;
            total.reward += outcome.reward;
            total.success = total.success.max(outcome.success);
            total.terminated = outcome.terminated;
            if total.terminated || self.is_truncated() {
                break;
            }
        }
        self.total_reward += total.reward;
        Ok(total)
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.fov.write(self.columns.factors, out);
        if let Some(mut image) = self.goal_image.take() {
            image.write(out, |pixels| self.render_goal(pixels));
            self.goal_image = Some(image);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Self { stage, task, scratch, columns, domain, image, .. } = self;
        scratch.clear();
        task.observe(stage, scratch);
        for (target, value) in out.at::<f32>(OBSERVATION).iter_mut().zip(&*scratch) {
            *target = *value as f32;
        }
        out.write(QPOS, stage.sim.qpos());
        out.write(QVEL, stage.sim.qvel());
        // The suite's episodes have at most 1,000 control steps with rewards up to 1.
        out.write(SCORE, &[self.total_reward / 1000.0]);
        out.write(TIME, &[stage.sim.time_s()]);
        out.write(QACC_WARMSTART, stage.sim.qacc_warmstart());
        if !stage.sim.act().is_empty() {
            out.write(ACT, stage.sim.act());
        }
        scratch.clear();
        task.infos(stage, scratch);
        let mut rest = scratch.as_slice();
        for (offset, (_, dim)) in domain.infos.iter().enumerate() {
            let (values, tail) = rest.split_at((*dim).max(1));
            out.write(columns.infos + offset, values);
            rest = tail;
        }
        for index in 0..domain.targets.len() {
            out.write(columns.targets + index, stage.target(index));
        }
        if let Some(image) = image {
            image.write(&mut stage.sim, columns.pixels, out);
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let mut simulation = Vec::new();
        self.stage.sim.save(&mut simulation);
        let saved = Saved {
            fov: self.fov.save(),
            targets: self.stage.targets().to_vec(),
            simulation,
            total_reward: self.total_reward,
            control_steps: self.control_steps,
        };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        if saved.targets.len() != self.stage.targets().len() {
            return Err(foreign(format!("it has {} values of targets", saved.targets.len())));
        }
        let same_bits = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
        let same_model = fov == self.fov && same_bits(&saved.targets, self.stage.targets());
        self.fov = fov;
        let restored = (|| {
            if !same_model {
                self.set_model()?;
                self.stage.set_targets(&saved.targets);
                GoalImage::renew(&mut self.goal_image);
            }
            self.stage.sim.load(&saved.simulation)
        })();
        restored.map_err(|error| error.at_restore(&self.spec.id))?;
        (self.total_reward, self.control_steps) = (saved.total_reward, saved.control_steps);
        Ok(())
    }

    /// The task's own cost; else minus the rewards since the reset: the plan with the lowest final cost has the highest
    /// return.
    fn task_cost(&self) -> Option<f64> {
        self.task.cost(&self.stage).or(Some(-self.total_reward))
    }

    fn renderer(&self) -> Option<String> {
        self.image.as_ref().map(Image::renderer)
    }

    fn is_truncated(&self) -> bool {
        self.control_steps >= self.step_limit
    }
}

fn chosen_task(domain: &'static Domain, name: Option<&str>) -> Result<&'static TaskEntry, String> {
    let Some(name) = name else { return Ok(&domain.tasks[0]) };
    domain.tasks.iter().find(|task| task.name == name).ok_or_else(|| {
        let known: Vec<&str> = domain.tasks.iter().map(|task| task.name).collect();
        format!("unknown task `{name}`; its tasks are {}", known.join(", "))
    })
}
