//! The environment: resets, control steps, rows, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    BatchError, Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Field, ImageSize,
    Outcome, RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};
use swm_render::scene::Quality;

use super::columns::{Declare, Write, observation, visit};
use super::factors::{self, FLOOR_COLOR, LOCK_COLOR, numbers};
use super::furniture::Which;
use super::layout::{FLOOR, Kind};
use super::models::Models;
use super::moment::{Moment, Pursued};
use super::settings::{Mode, Settings};
use super::standing::{Goal, Standing};
use super::table::Table;
use super::{start, targets};
use crate::error::MujocoError;
use crate::ffi::{Object, Simulation};
use crate::suite::picture::Canvas;
use crate::suite::recorded;

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
    moment: Moment,
    standing: Standing,
    goal: Goal,
    lock_colors: Vec<f64>,
    scratch: Vec<f64>,
    /// Where the episode columns begin.
    episode_columns: usize,
    canvas: Option<Canvas>,
    /// The picture of the goal, and whether it belongs to an earlier episode.
    goal_picture: (Vec<u8>, bool),
    /// The factors whose floor the pictures show.
    floor: Vec<f64>,
}

/// A saved moment.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    moment: Moment,
    standing: Standing,
    goal: Goal,
}

impl TableEnv {
    /// Makes the environment `id`.
    pub(super) fn new(id: &'static str, is_scene: bool, config: &EnvConfig) -> Result<Self, EnvError> {
        let settings: Settings = config.parse_settings(id)?;
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
        let moment = Moment::new(0, sim.qpos().len(), sim.qvel().len());
        let mut scratch = Vec::new();
        observation(&table, &sim, &moment, &mut scratch);
        let mut declared = Declare::default();
        visit(&table, &sim, &moment, &scratch, &mut declared);
        let mut fields = declared.0;
        let episode_columns = fields.len();
        fields.push(Field::episode("task_id", Dtype::I64, &[]));
        fields.push(Field::episode("goal_observation", Dtype::F64, &[scratch.len()]));
        fields.extend(space.fields());
        fields.extend(
            image
                .iter()
                .flat_map(|size| [Field::episode("goal", Dtype::U8, &size.shape()), size.field(PIXELS)]),
        );
        let is_scene = kind == Kind::Scene;
        let spec = EnvSpec {
            id: id.to_owned(),
            action: Space::uniform_box(Dtype::F32, &[5], -1.0, 1.0),
            fields,
            factors: space.specs(),
            time_step_s: sim.model().timestep_s() * f64::from(SUBSTEPS),
            start_columns: if is_scene { SCENE_START_COLUMNS } else { START_COLUMNS },
            goal_columns: if is_scene { &["qpos", "button_states"] } else { &["qpos"] },
        };
        let canvas = match image {
            None => None,
            Some(size) => {
                let full = models.full();
                let camera = full.id(Object::Camera, &settings.camera)?;
                Some(Canvas::new(&full, settings.renderer, camera, size, Quality::default())?)
            }
        };
        let goal_picture = (vec![0; image.map_or(0, |size| size.shape().iter().product())], true);
        let fov = space.defaults();
        let mut env = Self {
            standing: Standing::at_rest(&sim),
            goal: Goal::default(),
            lock_colors: if is_scene { numbers(&fov, LOCK_COLOR) } else { Vec::new() },
            floor: FLOOR.to_vec(),
            spec,
            settings,
            space,
            fov,
            models,
            sim,
            table,
            moment,
            scratch,
            episode_columns,
            canvas,
            goal_picture,
        };
        env.set_model()?;
        Ok(env)
    }

    /// Gives the simulation the model of the present factors.
    fn set_model(&mut self) -> Result<(), MujocoError> {
        self.models.apply(&self.fov, &mut self.sim)?;
        self.show_markers();
        if self.table.furniture.is_some() {
            self.lock_colors = numbers(&self.fov, LOCK_COLOR);
        }
        let floor = numbers(&self.fov, FLOOR_COLOR);
        if let Some(canvas) = &mut self.canvas
            && self.floor != floor
        {
            let (texture, size, pixels) = self.models.floor(&self.fov)?;
            canvas.set_texture(&self.models.full(), texture, size, &pixels)?;
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

    /// Locks, frees and colours the furniture by the buttons' states, and computes everything.
    fn apply_buttons(&mut self, states: [u8; 2]) -> Result<(), MujocoError> {
        let Some(furniture) = &self.table.furniture else { return Ok(()) };
        furniture.show_states(self.sim.model_mut(), states, &self.lock_colors);
        self.sim.forward()
    }

    fn begin(&mut self, episode: &Episode<'_>) -> Result<(), MujocoError> {
        let Self { sim, table, moment, fov, settings, .. } = self;
        *moment = Moment::new(episode.seed.value(), sim.qpos().len(), sim.qvel().len());
        sim.reset();
        sim.forward()?;
        match settings.mode {
            Mode::DataCollection => {
                start::place_by_factors(table, sim, moment, fov)?;
                targets::show(table, sim, fov);
                targets::draw(table, sim, moment, fov);
            }
            Mode::Task => {
                let task = start::Chosen::new(table, settings.task, settings.permute_blocks, moment);
                task.set_goals(table, sim, moment, fov);
                task.place(table, sim, moment, fov)?;
            }
        }
        sim.forward()
    }

    /// Stands at a recorded row.
    fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = &self.spec.id;
        let needed = |name: &str| EnvError::Reset {
            env: id.clone(),
            reason: format!("a start needs the column `{name}`"),
        };
        let Self { sim, table, moment, .. } = self;
        let (nq, nv, nu) = (sim.model().nq(), sim.model().nv(), sim.model().nu());
        let cubes = table.kind.cubes();
        let qpos = recorded(id, row, "qpos", nq)?.ok_or_else(|| needed("qpos"))?;
        let qvel = recorded(id, row, "qvel", nv)?.ok_or_else(|| needed("qvel"))?;
        sim.qpos_mut().copy_from_slice(&qpos);
        sim.qvel_mut().copy_from_slice(&qvel);
        sim.qacc_warmstart_mut().fill(0.0);
        if let Some(control) = recorded(id, row, "control", nu)? {
            sim.ctrl_mut().copy_from_slice(&control);
        }
        if let Some(warmstart) = recorded(id, row, "qacc_warmstart", nv)? {
            sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        }
        sim.set_time(recorded(id, row, "time", 1)?.map_or(0.0, |time| time[0]));
        if let Some(goals) = recorded(id, row, "mocap_pos", 3 * cubes)? {
            sim.mocap_pos_mut().copy_from_slice(&goals);
            let shown = goals.chunks_exact(3).position(|goal| goal[2] > 0.0);
            if let (Pursued::Cube(_), Some(index)) = (moment.pursued, shown) {
                moment.pursued = Pursued::Cube(index as u8);
            }
        }
        if let Some(turns) = recorded(id, row, "mocap_quat", 4 * cubes)? {
            sim.mocap_quat_mut().copy_from_slice(&turns);
        }
        if let Some(states) = recorded(id, row, "button_states", 2)? {
            moment.buttons = [0, 1].map(|index| u8::from(states[index] > 0.5));
        }
        Ok(())
    }

    /// Wants everything where it is in a recorded row. Returns the row's positions.
    fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<Vec<f64>, EnvError> {
        let id = &self.spec.id;
        let wrong = |reason: String| EnvError::Reset { env: id.clone(), reason };
        if let Some(column) = row.keys().find(|column| !self.spec.goal_columns.contains(&column.as_str())) {
            return Err(wrong(format!("`{column}` is no goal of this environment")));
        }
        let qpos = recorded(id, row, "qpos", self.sim.model().nq())?;
        let qpos = qpos.ok_or_else(|| wrong("a goal needs the column `qpos`".to_owned()))?;
        let Self { sim, table, moment, .. } = self;
        moment.pursued = Pursued::Everything;
        moment.goal_is_given = true;
        for index in 0..table.kind.cubes() {
            let (position, turn) = (table.cube_in(&qpos, index), table.cube_rotation_in(&qpos, index));
            table.set_goal(sim, index, position, turn);
        }
        if let Some(furniture) = &table.furniture {
            for which in [Which::Drawer, Which::Window] {
                let position = furniture.position_in(&qpos, which);
                moment.goal_slides[which as usize] = position;
                furniture.set_handle_target(sim.model_mut(), which, position);
            }
            if let Some(states) = recorded(id, row, "button_states", 2)? {
                moment.goal_buttons = [0, 1].map(|index| u8::from(states[index] > 0.5));
            }
        }
        Ok(qpos)
    }

    /// Finds out what the goal looks like: everything where it belongs, or as it was recorded; then returns to the start.
    fn visit_goal(&mut self, recorded: Option<Vec<f64>>) -> Result<(), MujocoError> {
        self.standing = Standing::at_rest(&self.sim);
        let start = self.moment.clone();
        let has_settled = recorded.is_none();
        match recorded {
            Some(qpos) => {
                self.sim.qpos_mut().copy_from_slice(&qpos);
                self.sim.qvel_mut().fill(0.0);
                self.moment.buttons = self.moment.goal_buttons;
            }
            None => start::place_at_goal(&self.table, &mut self.sim, &mut self.moment, &self.fov)?,
        }
        self.sim.forward()?;
        self.apply_buttons(self.moment.buttons)?;
        let mut goal = Goal { standing: Standing::at_rest(&self.sim), ..Goal::default() };
        if has_settled {
            let stream = EpisodeSeed::new(self.moment.seed as u64);
            for step in 0..2 {
                let action = self.spec.action.sample(&mut stream.indexed("goal action", [step, 0]));
                let action = five(action.data.as_slice()).unwrap_or_default();
                self.table.robot.command(&mut self.sim, action);
                goal.standing.advance(&mut self.sim)?;
            }
            self.apply_buttons(self.moment.buttons)?;
        }
        goal.buttons = self.moment.buttons;
        observation(&self.table, &self.sim, &self.moment, &mut goal.observation);
        (self.goal, self.moment) = (goal, start);
        self.goal_picture.1 = true;
        self.stand()
    }

    /// Returns the simulation to where the episode stands.
    fn stand(&mut self) -> Result<(), MujocoError> {
        let (standing, before) = (self.standing.clone(), self.moment.before_buttons);
        self.stand_at(&standing, before, self.moment.buttons)
    }

    /// Takes the simulation to a moment: buttons stood `before` its last step, and stand as `buttons` after it.
    fn stand_at(
        &mut self,
        standing: &Standing,
        before: [u8; 2],
        buttons: [u8; 2],
    ) -> Result<(), MujocoError> {
        if let Some(furniture) = &self.table.furniture {
            furniture.show_states(self.sim.model_mut(), before, &self.lock_colors);
        }
        standing.restore(&mut self.sim)?;
        self.apply_buttons(buttons)?;
        standing.finish(&mut self.sim);
        Ok(())
    }

    /// Whether a target is reached and done with.
    fn is_done_with_target(&self) -> bool {
        let Self { settings, moment, table, sim, .. } = self;
        if settings.mode != Mode::DataCollection
            || !settings.new_targets
            || moment.goal_is_given
            || !moment.success
        {
            return false;
        }
        let effector = table.robot.effector(sim).position;
        let away = super::pose::distance(effector, table.place_of(sim, moment.pursued));
        effector[2] > RAISED && away > LET_GO && table.robot.gripper_contact(sim) < LOOSE
    }

    fn advance(&mut self, action: [f32; 5]) -> Result<(), MujocoError> {
        if self.is_done_with_target() {
            targets::draw(&self.table, &mut self.sim, &mut self.moment, &self.fov);
        }
        let Self { sim, moment, table, standing, .. } = self;
        moment.before_qpos.copy_from_slice(sim.qpos());
        moment.before_qvel.copy_from_slice(sim.qvel());
        moment.before_buttons = moment.buttons;
        table.robot.command(sim, action);
        standing.advance(sim)?;
        if let Some(furniture) = &table.furniture {
            let pressed = furniture.pressed(&moment.before_qpos, sim);
            for (state, is_pressed) in moment.buttons.iter_mut().zip(pressed) {
                *state ^= u8::from(is_pressed);
            }
            self.apply_buttons(self.moment.buttons)?;
        }
        self.moment.success = self.table.is_met(&self.sim, &self.moment, self.moment.pursued);
        Ok(())
    }

    fn draw_goal(&mut self) -> Result<(), MujocoError> {
        let Some(mut canvas) = self.canvas.take() else { return Ok(()) };
        let goal = self.goal.clone();
        let drawn = self.stand_at(&goal.standing, goal.buttons, goal.buttons);
        if drawn.is_ok() {
            canvas.draw(&mut self.sim, &mut self.goal_picture.0);
        }
        self.goal_picture.1 = false;
        self.canvas = Some(canvas);
        drawn?;
        self.stand()
    }
}

/// The columns that a start may name.
const START_COLUMNS: &[&str] =
    &["qpos", "qvel", "time", "qacc_warmstart", "control", "mocap_pos", "mocap_quat"];
const SCENE_START_COLUMNS: &[&str] =
    &["qpos", "qvel", "time", "qacc_warmstart", "control", "mocap_pos", "mocap_quat", "button_states"];

/// The numbers of an action, if they are five and finite.
fn five(action: Slice<'_>) -> Option<[f32; 5]> {
    let Slice::F32(values) = action else { return None };
    let values: [f32; 5] = values.try_into().ok()?;
    values.iter().all(|value| value.is_finite()).then_some(values)
}

impl Env for TableEnv {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.draw(&self.spec.id, episode)?;
        let id = self.spec.id.clone();
        let at_reset = |error: MujocoError| error.at_reset(&id);
        self.set_model().map_err(at_reset)?;
        self.begin(episode).map_err(at_reset)?;
        if let Some(row) = &episode.options.start {
            self.start_from(row)?;
        }
        let goal = episode.options.goal.as_ref().map(|row| self.set_goal(row)).transpose()?;
        self.moment.before_qpos.copy_from_slice(self.sim.qpos());
        self.moment.before_qvel.copy_from_slice(self.sim.qvel());
        self.moment.before_buttons = self.moment.buttons;
        self.visit_goal(goal).map_err(at_reset)?;
        self.moment.success = self.table.is_met(&self.sim, &self.moment, self.moment.pursued);
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(self.moment.success) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        if let Some(failure) = self.canvas.as_mut().and_then(Canvas::take_failure) {
            return Err(failure.at_step(&self.spec.id));
        }
        let Some(numbers) = five(action) else {
            let expected = "5 finite float32 values".to_owned();
            let found = format!("{} values of {}: {action:?}", action.len(), action.dtype());
            return Err(BatchError::WrongValue { name: "action".to_owned(), expected, found }.into());
        };
        self.advance(numbers).map_err(|error| error.at_step(&self.spec.id))?;
        let success = self.moment.success;
        let reward = match self.settings.task {
            Some(_) => -(self.table.unmet_count(&self.sim, &self.moment) as f64),
            None => f64::from(u8::from(success)),
        };
        Ok(Outcome { reward, terminated: success && self.settings.ends_at_goal(), success: Some(success) })
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(self.episode_columns, &[self.moment.task]);
        out.write(self.episode_columns + 1, &self.goal.observation);
        self.fov.write(self.episode_columns + 2, out);
        if self.canvas.is_none() {
            return;
        }
        if self.goal_picture.1 && self.draw_goal().is_err() {
            // The next step finds the simulation unusable, and says so.
            self.goal_picture.0.fill(0);
        }
        out.write(self.spec.fields.len() - 2, &self.goal_picture.0);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Self { sim, table, moment, scratch, spec, canvas, .. } = self;
        scratch.clear();
        observation(table, sim, moment, scratch);
        visit(table, sim, moment, scratch, &mut Write::new(out));
        if let Some(canvas) = canvas {
            canvas.draw(sim, out.at(spec.fields.len() - 1));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved {
            fov: self.fov.save(),
            moment: self.moment.clone(),
            standing: self.standing.clone(),
            goal: self.goal.clone(),
        };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        let widths =
            [saved.moment.before_qpos.len(), saved.moment.before_qvel.len(), saved.goal.observation.len()];
        if widths != [self.sim.qpos().len(), self.sim.qvel().len(), self.goal_width()] {
            return Err(foreign("it belongs to another table".to_owned()));
        }
        let is_same_model = fov == self.fov;
        self.goal_picture.1 |= !is_same_model || saved.goal != self.goal;
        (self.fov, self.moment) = (fov, saved.moment);
        (self.standing, self.goal) = (saved.standing, saved.goal);
        let restored = (|| {
            if !is_same_model {
                self.set_model()?;
            }
            if let Some(furniture) = &self.table.furniture {
                for which in [Which::Drawer, Which::Window] {
                    let goal = self.moment.goal_slides[which as usize];
                    furniture.set_handle_target(self.sim.model_mut(), which, goal);
                }
            }
            self.stand()
        })();
        restored.map_err(|error: MujocoError| error.at_restore(&self.spec.id))
    }

    /// What is left to do, in m: for each cube, drawer and window its distance from where it belongs, 0.1 for a button; and,
    /// at a lower weight, the effector's distance from what is next.
    fn renderer(&self) -> Option<String> {
        self.canvas.as_ref().map(|_| self.settings.renderer.describe())
    }

    fn task_cost(&self) -> Option<f64> {
        Some(self.table.cost(&self.sim, &self.moment))
    }
}

impl TableEnv {
    fn goal_width(&self) -> usize {
        self.spec.fields[0].width()
    }
}
