//! `swm/PushT-v1` and its discrete variant as environments: reset, step, observation, saved states.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use swm_core::env::ResetOptions;
use swm_core::settings::Settings as _;
use swm_core::{
    BatchError, Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Field, ImageSize,
    Outcome, Place, RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::discrete;
use super::engine::Engine;
use super::factors::{factors_with, setup};
use super::goal::{self, PushTState, observed_state};
use super::physics::{ActionMode, BodyId, Placement, SUBSTEPS, Setup, Sim, contact_count};
use super::rendering::Look;
use super::settings::{SETTINGS, Settings};
use crate::image::Image;

// Field indices, in the order of `fields`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const POS_AGENT: usize = 2;
const VEL_AGENT: usize = 3;
const BLOCK_POSE: usize = 4;
const N_CONTACTS: usize = 5;
const GOAL_POSE: usize = 6;
const GOAL_STATE: usize = 7;
const GOAL_PROPRIO: usize = 8;
const FACTORS: usize = 9;

/// Push a block to a goal pose, on some engine. See the crate's documentation.
pub struct PushT<E: Engine = Sim> {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    sim: E,
    goal: PushTState,
    /// The block's angle at the goal with all its turns, where the goal is a recorded step: its image is that of the step.
    goal_angle: Option<f64>,
    /// Contact points counted since the last observation.
    contact_points: u32,
    /// The controller's target of the last step, in pixels.
    target: Option<[f64; 2]>,
    image: Option<Image<Look>>,
    /// Values of visual factors that images show in place of those of the episode.
    look: BTreeMap<String, Value>,
}

/// A saved state. Behind it stands `goal_angle`, if there is one: older states have none.
#[derive(Serialize, Deserialize)]
struct Saved<S> {
    fov: SavedFov,
    goal: PushTState,
    contact_points: u32,
    target: Option<[f64; 2]>,
    sim: S,
}

impl<S: Clone + Serialize + DeserializeOwned> Saved<S> {
    /// Rebuilds the saved state's factors and world.
    fn recall<E: Engine<State = S>>(
        env: &str,
        space: &FovSpace,
        settings: &Settings,
        state: &EnvState,
    ) -> Result<(Self, Option<f64>, Fov, Setup, E), EnvError> {
        let (saved, goal_angle) = match state.load::<Self>(env) {
            Ok(saved) => (saved, None),
            Err(error) => {
                let (saved, angle) = state.load::<(Self, f64)>(env).map_err(|_| error)?;
                (saved, Some(angle))
            }
        };
        let foreign = |reason: String| EnvError::State { env: env.to_owned(), reason };
        let fov = space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        let setup = setup::<E>(&fov, settings);
        let mut sim = E::new(&setup).map_err(|error| foreign(error.to_string()))?;
        sim.restore(&saved.sim).map_err(|error| foreign(error.to_string()))?;
        Ok((saved, goal_angle, fov, setup, sim))
    }
}

/// A saved state as planners on the true simulator need it: no images, no episode bookkeeping.
pub(super) struct LoadedState<E> {
    pub(super) setup: Setup,
    pub(super) sim: E,
    pub(super) goal: PushTState,
}

impl<E: Engine> LoadedState<E> {
    /// Reads what [`Env::snapshot`] saved in an environment `env` with these settings.
    pub(super) fn load(
        env: &str,
        space: &FovSpace,
        settings: &Settings,
        state: &EnvState,
    ) -> Result<LoadedState<E>, EnvError> {
        let (saved, _, _, setup, sim) = Saved::recall(env, space, settings, state)?;
        Ok(LoadedState { setup, sim, goal: saved.goal })
    }
}

impl<E: Engine> PushT<E> {
    /// Makes the environment `id`, continuous or discrete.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, absolute discrete actions, or an
    /// image size that cannot be rendered.
    pub fn new(id: &str, discrete: bool, config: &EnvConfig) -> Result<Self, EnvError> {
        let known = if E::FRICTION == 0.0 { SETTINGS } else { Settings::SETTINGS };
        let settings: Settings = config.parse_settings_of(id, known)?;
        let wrong = |reason: String| EnvError::Setting { env: id.to_owned(), reason };
        if discrete && !settings.relative {
            return Err(wrong("discrete actions are relative; remove `relative=false`".to_owned()));
        }
        let space = factors_with(id, &settings.init_value)?;
        let fov = space.defaults();
        let setup = setup::<E>(&fov, &settings);
        let sim = E::new(&setup).map_err(|error| wrong(error.to_string()))?;
        let look = Look::new(&fov, setup.block.shape, &settings);
        let image = config.image.map(|size| Image::new(size, settings.render, look));
        let image = image.transpose().map_err(wrong)?;
        Ok(Self {
            spec: spec(id, discrete, config.image, &space),
            settings,
            fov,
            space,
            sim,
            goal: [0.0; 7],
            goal_angle: None,
            contact_points: 0,
            target: None,
            image,
            look: BTreeMap::new(),
        })
    }

    /// The simulation as it stands.
    pub fn sim(&self) -> &E {
        &self.sim
    }

    /// The rewarded goal.
    pub fn goal(&self) -> &PushTState {
        &self.goal
    }

    /// The goal that an episode samples: fresh samples of the start factors' spaces, and the start velocity.
    fn sampled_goal(&self, seed: EpisodeSeed) -> Result<PushTState, EnvError> {
        let sample = |factor: &str| -> Result<Vec<f64>, EnvError> {
            let spec =
                self.spec.factors.iter().find(|spec| spec.name == factor).expect("a factor of the table");
            let mut stream = seed.stream(&format!("goal_state {factor}"));
            Ok(spec.space.sample(&mut stream).to_f64s(factor)?)
        };
        let (agent, block) = (sample("agent.start_position")?, sample("block.start_position")?);
        let angle = sample("block.angle")?;
        let [vx, vy] = self.fov.vector("agent.velocity");
        Ok([agent[0], agent[1], block[0], block[1], angle[0], vx, vy])
    }

    fn start(&self) -> PushTState {
        let ([x, y], [vx, vy]) = (self.fov.vector("agent.start_position"), self.fov.vector("agent.velocity"));
        let [bx, by]: [f64; 2] = self.fov.vector("block.start_position");
        [x, y, bx, by, self.fov.f64("block.angle"), vx, vy]
    }

    /// A new world with the bodies at the goal, after the reference's one substep there.
    fn sim_at_goal(&self) -> Result<(E, u32), EnvError> {
        let mut sim =
            E::new(&setup::<E>(&self.fov, &self.settings)).map_err(|error| self.reset_error(error))?;
        sim.place(&Placement::from(self.goal)).map_err(|error| self.reset_error(error))?;
        let points = sim.substep();
        Ok((sim, points))
    }

    /// What the image of the goal shows: the recorded step, or, of a goal that was sampled, what the reference shows.
    fn sim_to_show(&self) -> Result<E, EnvError> {
        let Some(block_angle) = self.goal_angle else { return Ok(self.sim_at_goal()?.0) };
        let made = E::new(&setup::<E>(&self.fov, &self.settings)).and_then(|mut sim| {
            sim.place_exactly(&Placement { block_angle, ..Placement::from(self.goal) })?;
            // Images show contacts.
            sim.settle();
            Ok(sim)
        });
        made.map_err(|error| self.reset_error(error))
    }

    /// All of the block's angle in a recorded row, if it has that: `state` holds the angle modulo a full turn.
    fn whole_angle(row: &BTreeMap<String, Value>) -> Result<Option<f64>, EnvError> {
        let Some(pose) = row.get("block_pose") else { return Ok(None) };
        let pose = pose.cast("block_pose", Dtype::F64, &[3])?.to_f64s("block_pose")?;
        if pose.iter().any(|number| !number.is_finite()) {
            let (name, expected) = ("block_pose".to_owned(), "three finite numbers".to_owned());
            return Err(BatchError::WrongValue { name, expected, found: format!("{pose:?}") }.into());
        }
        Ok(Some(pose[2]))
    }

    fn reset_error(&self, reason: impl std::fmt::Display) -> EnvError {
        EnvError::Reset { env: self.spec.id.clone(), reason: reason.to_string() }
    }

    /// The column `state` of a recorded row.
    fn recorded_state(&self, row: &BTreeMap<String, Value>) -> Result<PushTState, EnvError> {
        let value =
            row.get("state").ok_or_else(|| self.reset_error("start and goal need the column `state`"))?;
        let mut values = value.to_f64s("state")?;
        if values.len() == 5 {
            // Without a velocity the agent rests, as in the reference.
            values.extend([0.0, 0.0]);
        }
        let values = Value::vector(&values).cast("state", Dtype::F64, &[7])?.to_f64s("state")?;
        if values.iter().any(|number| !number.is_finite()) {
            return Err(self.reset_error("the recorded `state` is not finite"));
        }
        Ok(values.try_into().expect("cast to seven values"))
    }

    /// The reference's order: goal state and one substep, then start state and one substep. What the goal pose
    /// leaves in contacts acts in the second. A recorded start is taken over exactly instead.
    fn place_bodies(&mut self, options: &ResetOptions) -> Result<(), EnvError> {
        let (sim, points) = self.sim_at_goal()?;
        self.sim = sim;
        self.contact_points = points;
        if let Some(start) = &options.start {
            let mut placement = Placement::from(self.recorded_state(start)?);
            placement.block_angle = Self::whole_angle(start)?.unwrap_or(placement.block_angle);
            self.sim.place_exactly(&placement).map_err(|error| self.reset_error(error))?;
            self.contact_points = self.sim.settle();
            let recorded = start.get("n_contacts").and_then(|value| value.to_f64s("n_contacts").ok());
            if let Some(&[count]) = recorded.as_deref() {
                self.contact_points = (count as u32).saturating_mul(SUBSTEPS);
            }
        } else {
            let start = Placement::from(self.start());
            self.sim.place(&start).map_err(|error| self.reset_error(error))?;
            self.contact_points += self.sim.substep();
        }
        Ok(())
    }

    fn outcome(&self) -> Outcome {
        let state = observed_state(&self.sim);
        let success = goal::is_success(self.sim.shape(BodyId::Block), &self.goal, &state);
        Outcome { reward: goal::reward(&self.goal, &state), terminated: success, success: Some(success) }
    }

    fn refresh_look(&mut self) {
        if let Some(image) = &mut self.image {
            let dressed = self.space.dressed(&self.spec.id, &self.fov, &self.look);
            let fov = dressed.as_ref().unwrap_or(&self.fov);
            image.set_look(Look::new(fov, self.sim.shape(BodyId::Block), &self.settings));
        }
    }
}

impl<E: Engine> Env for PushT<E> {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        self.goal = match &episode.options.goal {
            Some(row) => self.recorded_state(row)?,
            None => self.sampled_goal(episode.seed)?,
        };
        self.goal_angle = episode.options.goal.as_ref().map(Self::whole_angle).transpose()?.flatten();
        self.target = None;
        self.place_bodies(episode.options)?;
        self.refresh_look();
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let (action, mode) = match action {
            Slice::F32(&[x, y]) if self.settings.relative => ([x, y], ActionMode::Relative),
            Slice::F32(&[x, y]) => ([x, y], ActionMode::Absolute),
            Slice::I64(&[radius, angle]) => (discrete::to_continuous([radius, angle]), ActionMode::Relative),
            other => {
                let reason = format!("{} values of {} are no action", other.len(), other.dtype());
                return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
            }
        };
        let start = self.sim.position(BodyId::Agent);
        self.target = Some(match mode {
            ActionMode::Relative => [0, 1].map(|axis| start[axis] + 100.0 * f64::from(action[axis])),
            ActionMode::Absolute => action.map(f64::from),
        });
        self.contact_points = self.sim.control_step(action, mode);
        if observed_state(&self.sim).iter().any(|value| !value.is_finite()) {
            let reason = format!("the state is not finite after the action {action:?}");
            return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
        }
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        let [gx, gy]: [f64; 2] = self.fov.vector("goal.position");
        out.write(GOAL_POSE, &[gx, gy, self.fov.f64("goal.angle")]);
        out.write(GOAL_STATE, &self.goal);
        let [x, y, .., vx, vy] = self.goal;
        out.write(GOAL_PROPRIO, &[x, y, vx, vy]);
        self.fov.write(FACTORS, out);
        let stale = self.image.as_ref().is_some_and(|image| image.goal_is_stale);
        let at_goal = stale.then(|| self.sim_to_show()).and_then(Result::ok);
        if let Some(image) = &mut self.image {
            if let Some(sim) = at_goal {
                image.render_goal(|look, painter| look.render(&sim, None, painter));
            }
            out.write(self.spec.fields.len() - 1, &image.goal);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let state = observed_state(&self.sim);
        let [x, y, bx, by, _, vx, vy] = state;
        out.write(STATE, &state);
        out.write(PROPRIO, &[x, y, vx, vy]);
        out.write(POS_AGENT, &[x, y]);
        out.write(VEL_AGENT, &[vx, vy]);
        out.write(BLOCK_POSE, &[bx, by, self.sim.angle(BodyId::Block)]);
        out.write(N_CONTACTS, &[i64::from(contact_count(self.contact_points))]);
        if let Some(image) = &mut self.image {
            let target = self.target.filter(|_| self.settings.render_action);
            let pixels = out.at(self.spec.fields.len() - 2);
            image.render(pixels, |look, painter| look.render(&self.sim, target, painter));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved {
            fov: self.fov.save(),
            goal: self.goal,
            contact_points: self.contact_points,
            target: self.target,
            sim: self.sim.state().clone(),
        };
        match self.goal_angle {
            Some(angle) => state.store(&self.spec.id, &(saved, angle)),
            None => state.store(&self.spec.id, &saved),
        }
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let (saved, goal_angle, fov, _, sim) =
            Saved::recall(&self.spec.id, &self.space, &self.settings, state)?;
        let same_world = fov == self.fov && saved.goal == self.goal && goal_angle == self.goal_angle;
        (self.fov, self.goal, self.goal_angle, self.sim) = (fov, saved.goal, goal_angle, sim);
        (self.contact_points, self.target) = (saved.contact_points, saved.target);
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
        Some(goal::task_cost(&self.sim, &self.goal))
    }

    fn places(&self) -> Vec<Place> {
        let at = |name, [x, y]: [f64; 2]| Place { name, at: [x / WORLD_SIDE, y / WORLD_SIDE] };
        vec![
            at("agent", self.sim.position(BodyId::Agent)),
            at("block", self.sim.center_of_gravity(BodyId::Block)),
        ]
    }
}

/// Side of the square that the image shows, in pixels of the reference.
const WORLD_SIDE: f64 = 512.0;

fn spec(id: &str, discrete: bool, image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
    let episode = |name: &str, dim: usize| Field::episode(name, Dtype::F64, &[dim]);
    let mut fields = vec![
        step("state", 7),
        step("proprio", 4),
        step("pos_agent", 2),
        step("vel_agent", 2),
        step("block_pose", 3),
        Field::step("n_contacts", Dtype::I64, &[]),
        episode("goal_pose", 3),
        episode("goal_state", 7),
        episode("goal_proprio", 4),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    let action = if discrete { discrete::space() } else { Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0) };
    EnvSpec::new(id, action, fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "block_pose"])
        .goal_columns(&["state"])
        .start_extras(&["n_contacts"])
        .goal_extras(&["block_pose"])
}
