//! `swm/TwoRoom-v1` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::env::ResetOptions;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, Place, RowsMut,
    Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::factors::{factors_with, goal_radius, position, setup};
use super::goal::{Overlap, task_cost};
use super::physics::{Sim, State, Vec2, contact_count};
use super::rendering::Look;
use super::settings::Settings;
use crate::image::Image;

// Field indices, in the order of `fields`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const POS_AGENT: usize = 2;
const POS_GOAL: usize = 3;
const N_CONTACTS: usize = 4;
const ENERGY: usize = 5;
const FRACTION_OF_GOAL: usize = 6;
const FRACTION_OF_AGENT: usize = 7;
const GOAL_POS: usize = 8;
const GOAL_POS_AGENT: usize = 9;
const MAX_ENERGY: usize = 10;
const FACTORS: usize = 11;

/// Reward of a step that ends at the goal, and of any other.
const REWARDS: [f64; 2] = [1.0, -0.01];

/// Steer a disc through the door of a wall to a goal in the other room. See the crate's documentation.
pub struct TwoRoom {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    sim: Sim,
    goal: Vec2,
    step_state: StepState,
    image: Option<Image<Look>>,
    /// Values of visual factors that images show in place of those of the episode.
    look: BTreeMap<String, Value>,
}

/// What else changes in an episode.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct StepState {
    energy: i64,
    /// Contact points counted since the last observation.
    contact_points: u32,
    /// No action has been taken: the reference reports no overlap then.
    is_start: bool,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    goal: [f64; 2],
    step_state: StepState,
    sim: State,
}

impl TwoRoom {
    /// Makes the environment `id`.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(id: &str, config: &EnvConfig) -> Result<Self, EnvError> {
        let settings: Settings = config.parse_settings(id)?;
        let space = factors_with(id, &settings.init_value)?;
        let fov = space.defaults();
        let sim = Sim::new(setup(&fov, &settings), position(&fov, "agent"));
        let image = config
            .image
            .map(|size| Image::new(size, settings.render, Look::new(&fov, &sim.setup().plan)))
            .transpose()
            .map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        Ok(Self {
            spec: spec(id, config.image, &space),
            settings,
            goal: position(&fov, "goal"),
            fov,
            space,
            sim,
            step_state: StepState::default(),
            image,
            look: BTreeMap::new(),
        })
    }

    fn reset_error(&self, reason: impl Into<String>) -> EnvError {
        EnvError::Reset { env: self.spec.id.clone(), reason: reason.into() }
    }

    /// Some finite values of a recorded row.
    fn recorded<const N: usize>(
        &self,
        row: &BTreeMap<String, Value>,
        column: &str,
    ) -> Result<Option<[f64; N]>, EnvError> {
        let Some(value) = row.get(column) else { return Ok(None) };
        let values = value.cast(column, Dtype::F64, &[N])?.to_f64s(column)?;
        if values.iter().any(|number| !number.is_finite()) {
            return Err(self.reset_error(format!("the recorded `{column}` is not finite")));
        }
        Ok(values.try_into().ok())
    }

    /// The recorded place of the agent: `pos_agent`, or the first two values of `state`.
    fn recorded_agent(&self, row: &BTreeMap<String, Value>) -> Result<Option<Vec2>, EnvError> {
        if let Some(place) = self.recorded::<2>(row, "pos_agent")? {
            return Ok(Some(place.into()));
        }
        Ok(self.recorded::<6>(row, "state")?.map(|[x, y, ..]| [x, y].into()))
    }

    /// The reference's order: agent at the goal and one substep, then at its start and one substep. What the goal leaves
    /// in contacts acts in the second. A recorded start is taken over exactly instead.
    /// The factors that a recorded start and goal take the place of, with their values.
    fn positions_in_use(&self, options: &ResetOptions) -> Result<Vec<(&'static str, Value)>, EnvError> {
        let mut in_use = Vec::new();
        for (factor, row) in [("agent.position", &options.start), ("goal.position", &options.goal)] {
            if let Some(at) = row.as_ref().map(|row| self.recorded_agent(row)).transpose()?.flatten() {
                in_use.push((factor, Value::vector(&at.to_array())));
            }
        }
        Ok(in_use)
    }

    fn place(&mut self, options: &ResetOptions) -> Result<(), EnvError> {
        let start = position(&self.fov, "agent");
        self.goal = position(&self.fov, "goal");
        self.sim = Sim::new(setup(&self.fov, &self.settings), start);
        let max_energy = self.fov.i64("agent.max_energy");
        self.step_state = StepState { energy: max_energy, contact_points: 0, is_start: true };
        let recorded = match &options.start {
            None => None,
            Some(row) => {
                let state = self.recorded::<6>(row, "state")?;
                let agent = self.recorded_agent(row)?.ok_or_else(|| {
                    self.reset_error("a recorded start needs the column `state` or `pos_agent`")
                })?;
                if let Some([_, _, x, y, energy, _]) = state {
                    self.goal = [x, y].into();
                    self.step_state.energy = (energy as i64).clamp(0, max_energy);
                }
                Some(agent)
            }
        };
        if let Some(row) = &options.goal {
            self.goal = self
                .recorded_agent(row)?
                .ok_or_else(|| self.reset_error("a recorded goal needs the column `pos_agent` or `state`"))?;
        }
        if let Some(agent) = recorded {
            self.step_state.contact_points = self.sim.place_exactly(agent);
            return Ok(());
        }
        for place in [self.goal, start] {
            self.sim.place(place);
            self.step_state.contact_points += self.sim.settle();
        }
        Ok(())
    }

    fn overlap(&self) -> Overlap {
        let (agent, goal) = (self.sim.position().to_array(), self.goal.to_array());
        Overlap::new(agent, self.sim.setup().radius, goal, goal_radius(&self.fov))
    }

    fn outcome(&self) -> Outcome {
        let success = self.overlap().is_success();
        Outcome { reward: REWARDS[usize::from(!success)], terminated: success, success: Some(success) }
    }

    fn refresh_look(&mut self) {
        if let Some(image) = &mut self.image {
            let dressed = self.space.dressed(&self.spec.id, &self.fov, &self.look);
            image.set_look(Look::new(dressed.as_ref().unwrap_or(&self.fov), &self.sim.setup().plan));
        }
    }
}

impl Env for TwoRoom {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = match self.space.sample(&self.spec.id, episode) {
            // A recorded start stands elsewhere than the factor says: what counts is whether it can stand there.
            Err(EnvError::Constraint { .. }) if episode.options.start.is_some() => {
                self.space.sample_in_use(&self.spec.id, episode, &self.positions_in_use(episode.options)?)?
            }
            drawn => drawn?,
        };
        self.place(episode.options)?;
        self.refresh_look();
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let diverged = |reason| EnvError::Diverged { env: self.spec.id.clone(), reason };
        let Slice::F32(&[x, y]) = action else {
            return Err(diverged(format!("{} values of {} are no action", action.len(), action.dtype())));
        };
        let contact_points = self.sim.control_step([x, y]);
        if !self.sim.position().is_finite() {
            return Err(diverged(format!("the agent's place is not finite after the action {:?}", [x, y])));
        }
        self.step_state = StepState { energy: self.step_state.energy - 1, contact_points, is_start: false };
        Ok(self.outcome())
    }

    fn is_truncated(&self) -> bool {
        self.step_state.energy <= 0
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let goal: [f32; 2] = self.fov.vector("goal.position");
        out.write(GOAL_POS, &goal);
        out.write(GOAL_POS_AGENT, &self.goal.to_array());
        out.write(MAX_ENERGY, &[self.fov.i64("agent.max_energy")]);
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            if image.goal_is_stale {
                image.render_goal(|look, painter| look.render(self.goal, self.goal, painter));
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let ([x, y], [gx, gy]) = (self.sim.position().to_array(), self.goal.to_array());
        let StepState { energy, contact_points, is_start } = self.step_state;
        let overlap = if is_start { Overlap::default() } else { self.overlap() };
        out.write(STATE, &[x, y, gx, gy, energy as f64, f64::from(self.sim.setup().speed)]);
        out.write(PROPRIO, &[x, y]);
        out.write(POS_AGENT, &[x, y]);
        out.write(POS_GOAL, &[gx, gy]);
        out.write(N_CONTACTS, &[contact_count(contact_points)]);
        out.write(ENERGY, &[energy]);
        out.write(FRACTION_OF_GOAL, &[overlap.of_goal]);
        out.write(FRACTION_OF_AGENT, &[overlap.of_agent]);
        if let Some(image) = &mut self.image {
            let (agent, goal, pixels) = (self.sim.position(), self.goal, out.at(self.spec.fields.len() - 2));
            image.render(pixels, |look, painter| look.render(agent, goal, painter));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved {
            fov: self.fov.save(),
            goal: self.goal.to_array(),
            step_state: self.step_state,
            sim: self.sim.state(),
        };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        let fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        let mut sim = if fov == self.fov {
            self.sim.clone()
        } else {
            Sim::new(setup(&fov, &self.settings), position(&fov, "agent"))
        };
        let goal = Vec2::from(saved.goal);
        if !sim.restore(saved.sim) || !goal.is_finite() {
            return Err(foreign("it holds values that are not finite".to_owned()));
        }
        let same_world = fov == self.fov && goal == self.goal;
        (self.fov, self.sim, self.goal, self.step_state) = (fov, sim, goal, saved.step_state);
        if !same_world {
            self.refresh_look();
        }
        Ok(())
    }

    fn dress(&mut self, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        self.space.dressed(&self.spec.id, &self.fov, look)?;
        if *look != self.look {
            self.look.clone_from(look);
            self.refresh_look();
        }
        Ok(())
    }

    fn task_cost(&self) -> Option<f64> {
        Some(task_cost(&self.sim, self.goal))
    }

    fn places(&self) -> Vec<Place> {
        let Vec2 { x, y } = self.sim.position();
        vec![Place { name: "agent", at: [x, y].map(|px| px / IMAGE_PX) }]
    }
}

/// Side of the square that the image shows, pixels.
const IMAGE_PX: f64 = 512.0;

fn spec(id: &str, image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let step = |name: &str, shape: &[usize]| Field::step(name, Dtype::F64, shape);
    let mut fields = vec![
        step("state", &[6]),
        step("proprio", &[2]),
        step("pos_agent", &[2]),
        step("pos_goal", &[2]),
        Field::step("n_contacts", Dtype::I64, &[]),
        Field::step("energy", Dtype::I64, &[]),
        step("fraction_of_goal", &[]),
        step("fraction_of_agent", &[]),
        Field::episode("goal_pos", Dtype::F32, &[2]),
        Field::episode("goal_pos_agent", Dtype::F64, &[2]),
        Field::episode("max_energy", Dtype::I64, &[]),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    EnvSpec::new(id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "pos_agent"])
        .goal_columns(&["pos_agent"])
}
