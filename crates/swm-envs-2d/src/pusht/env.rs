//! `swm/PushT-v1`, its discrete variant, and PushT on rapier2d: reset, step, observation, images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{
    BatchError, Dtype, EnvConfig, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Field, ImageSize,
    Keypoint, Outcome, RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov, Scene, SceneError};

use super::discrete;
use super::engine::Engine;
use super::factors::{factors, setup};
use super::goal::{self, PushTState, observed_state};
use super::physics::{ActionMode, BodyId, PhysicsError, Placement, SUBSTEPS, Setup, Sim, contact_count};
use super::rendering::Look;
use super::settings::{Settings, known};
use crate::image::Canvas;

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const POS_AGENT: usize = 2;
const VEL_AGENT: usize = 3;
const BLOCK_POSE: usize = 4;
const N_CONTACTS: usize = 5;
const GOAL_POSE: usize = 6;
const GOAL_STATE: usize = 7;
const GOAL_PROPRIO: usize = 8;

/// Side of the square that the image shows, in pixels of the reference.
const WORLD_SIDE: f64 = 512.0;

/// Push a block to a goal pose, on some engine. See the crate's documentation.
pub struct PushT<E: Engine = Sim, const IS_DISCRETE: bool = false> {
    settings: Settings,
    setup: Setup,
    sim: E,
    /// Where the factors put agent and block.
    start: PushTState,
    /// The pose of the rendered goal.
    goal_pose: [f64; 3],
}

/// What changes in an episode, and the goal. `S` is what the engine saves.
#[derive(Serialize, Deserialize)]
pub struct Moving<S> {
    goal: PushTState,
    /// Contact points counted since the last observation.
    contact_points: u32,
    /// The controller's target of the last step, in pixels.
    target: Option<[f64; 2]>,
    sim: S,
    /// The block's angle at the goal with all its turns, where the goal is a recorded step: its image is that of the step.
    #[serde(with = "at_end")]
    goal_angle: Option<f64>,
}

/// A value at the end of a saved state: nothing where there is none, as in states from before it was saved.
mod at_end {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        match value {
            Some(value) => value.serialize(serializer),
            None => serializer.serialize_unit(),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
        Ok(f64::deserialize(deserializer).ok())
    }
}

/// A saved state as planners on the true simulator need it: no images, no episode bookkeeping.
pub(super) struct LoadedState<E> {
    pub(super) setup: Setup,
    pub(super) sim: E,
    pub(super) goal: PushTState,
}

impl<E: Engine> LoadedState<E> {
    /// Reads the saved state of an environment `env` with these settings.
    pub(super) fn load(
        env: &str,
        space: &FovSpace,
        settings: &Settings,
        state: &EnvState,
    ) -> Result<LoadedState<E>, EnvError> {
        let (fov, moving): (SavedFov, Moving<E::State>) = state.load(env)?;
        let foreign = |reason: String| EnvError::State { env: env.to_owned(), reason };
        let fov = space.recall(&fov).map_err(|error| foreign(error.to_string()))?;
        let setup = setup::<E>(&fov, settings);
        let mut sim = E::new(&setup).map_err(|error| foreign(error.to_string()))?;
        sim.restore(&moving.sim).map_err(|error| foreign(error.to_string()))?;
        Ok(LoadedState { setup, sim, goal: moving.goal })
    }
}

impl From<PhysicsError> for SceneError {
    fn from(error: PhysicsError) -> Self {
        Self::Reason(error.to_string())
    }
}

/// The goal that an episode samples: fresh samples of the start factors' spaces, and the start velocity.
fn sampled_goal(spec: &EnvSpec, fov: &Fov, seed: EpisodeSeed) -> Result<PushTState, BatchError> {
    let sample = |factor: &str| -> Result<Vec<f64>, BatchError> {
        let spec = spec.factors.iter().find(|spec| spec.name == factor).expect("a factor of the table");
        spec.space.sample(&mut seed.stream(&format!("goal_state {factor}"))).to_f64s(factor)
    };
    let (agent, block) = (sample("agent.start_position")?, sample("block.start_position")?);
    let angle = sample("block.angle")?;
    let [vx, vy] = fov.vector("agent.velocity");
    Ok([agent[0], agent[1], block[0], block[1], angle[0], vx, vy])
}

/// All of the block's angle in a recorded row, if it has that: `state` holds the angle modulo a full turn.
fn whole_angle(row: &BTreeMap<String, Value>) -> Result<Option<f64>, BatchError> {
    let Some(pose) = row.get("block_pose") else { return Ok(None) };
    let pose = pose.cast("block_pose", Dtype::F64, &[3])?.to_f64s("block_pose")?;
    if pose.iter().any(|number| !number.is_finite()) {
        let (name, expected) = ("block_pose".to_owned(), "three finite numbers".to_owned());
        return Err(BatchError::WrongValue { name, expected, found: format!("{pose:?}") });
    }
    Ok(Some(pose[2]))
}

/// The column `state` of a recorded row.
fn recorded_state(row: &BTreeMap<String, Value>) -> Result<PushTState, SceneError> {
    let mut values = row.get("state").ok_or("start and goal need the column `state`")?.to_f64s("state")?;
    if values.len() == 5 {
        // Without a velocity the agent rests, as in the reference.
        values.extend([0.0, 0.0]);
    }
    let values = Value::vector(&values).cast("state", Dtype::F64, &[7])?.to_f64s("state")?;
    if values.iter().any(|number| !number.is_finite()) {
        return Err("the recorded `state` is not finite".into());
    }
    Ok(values.try_into().expect("cast to seven values"))
}

/// Bodies at the goal, after the reference's one substep there. Returns the number of contact points.
fn place_at_goal(sim: &mut impl Engine, goal: &PushTState) -> Result<u32, PhysicsError> {
    sim.place(&Placement::from(*goal))?;
    Ok(sim.substep())
}

impl<E: Engine, const IS_DISCRETE: bool> PushT<E, IS_DISCRETE> {
    /// The simulation as it is.
    pub fn sim(&self) -> &E {
        &self.sim
    }

    /// What the image of the goal shows: the recorded step, or, of a goal that was sampled, what the reference shows.
    fn sim_to_show(&self, moving: &Moving<E::State>) -> Result<E, PhysicsError> {
        let mut sim = E::new(&self.setup)?;
        match moving.goal_angle {
            None => place_at_goal(&mut sim, &moving.goal)?,
            Some(block_angle) => {
                sim.place_exactly(&Placement { block_angle, ..Placement::from(moving.goal) })?;
                // Images show contacts.
                sim.settle()
            }
        };
        Ok(sim)
    }

    fn outcome_at(&self, state: &PushTState, goal: &PushTState) -> Outcome {
        let success = goal::is_success(self.sim.shape(BodyId::Block), goal, state);
        Outcome { reward: goal::reward(goal, state), terminated: success, success: Some(success) }
    }
}

impl<E: Engine, const IS_DISCRETE: bool> Scene for PushT<E, IS_DISCRETE> {
    const ID: &'static str = if IS_DISCRETE { "swm/PushT-Discrete-v1" } else { E::PUSHT };
    type Settings = Settings;
    type State = Moving<E::State>;
    type Canvas = Canvas<Look>;

    fn settings(config: &EnvConfig) -> Result<Settings, EnvError> {
        let settings: Settings = config.parse_settings_of(Self::ID, known::<E>())?;
        if IS_DISCRETE && !settings.relative {
            let reason = "discrete actions are relative; remove `relative=false`".to_owned();
            return Err(EnvError::Setting { env: Self::ID.to_owned(), reason });
        }
        Ok(settings)
    }

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
        let episode = |name: &str, dim: usize| Field::episode(name, Dtype::F64, &[dim]);
        let fields = vec![
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
        let action =
            if IS_DISCRETE { discrete::space() } else { Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0) };
        EnvSpec::new(Self::ID, action, fields)
            .time_step_s(0.1)
            .start_columns(&["state", "block_pose"])
            .goal_columns(&["state"])
            .start_extras(&["n_contacts"])
            .goal_extras(&["block_pose"])
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Self::Canvas, SceneError> {
        Canvas::new(size, settings.render)
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        let setup = setup::<E>(fov, settings);
        let ([x, y], [bx, by]) = (setup.agent.position, setup.block.position);
        let ([vx, vy], [gx, gy]) = (fov.vector("agent.velocity"), fov.vector("goal.position"));
        Ok(Self {
            settings: settings.clone(),
            sim: E::new(&setup)?,
            start: [x, y, bx, by, setup.block.angle, vx, vy],
            goal_pose: [gx, gy, fov.f64("goal.angle")],
            setup,
        })
    }

    /// The reference's order: goal state and one substep, then start state and one substep. What the goal pose
    /// leaves in contacts acts in the second. A recorded start is taken over exactly instead.
    fn start(&mut self, spec: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Self::State, SceneError> {
        let options = episode.options;
        let goal = match &options.goal {
            Some(row) => recorded_state(row)?,
            None => sampled_goal(spec, fov, episode.seed)?,
        };
        let goal_angle = options.goal.as_ref().map(whole_angle).transpose()?.flatten();
        let mut contact_points = place_at_goal(&mut self.sim, &goal)?;
        if let Some(start) = &options.start {
            let mut placement = Placement::from(recorded_state(start)?);
            placement.block_angle = whole_angle(start)?.unwrap_or(placement.block_angle);
            self.sim.place_exactly(&placement)?;
            contact_points = self.sim.settle();
            let recorded = start.get("n_contacts").and_then(|value| value.to_f64s("n_contacts").ok());
            if let Some(&[count]) = recorded.as_deref() {
                contact_points = (count as u32).saturating_mul(SUBSTEPS);
            }
        } else {
            self.sim.place(&Placement::from(self.start))?;
            contact_points += self.sim.substep();
        }
        Ok(Moving { goal, contact_points, target: None, sim: self.sim.state().clone(), goal_angle })
    }

    fn restore(&mut self, moving: &Self::State) -> Result<(), SceneError> {
        Ok(self.sim.restore(&moving.sim)?)
    }

    fn is_same_goal(a: &Self::State, b: &Self::State) -> bool {
        a.goal == b.goal && a.goal_angle == b.goal_angle
    }

    fn step(&mut self, moving: &mut Self::State, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let (action, mode) = match action {
            Slice::F32(&[x, y]) if self.settings.relative => ([x, y], ActionMode::Relative),
            Slice::F32(&[x, y]) => ([x, y], ActionMode::Absolute),
            Slice::I64(&[radius, angle]) => (discrete::to_continuous([radius, angle]), ActionMode::Relative),
            other => return Err(format!("{} values of {} are no action", other.len(), other.dtype()).into()),
        };
        let start = self.sim.position(BodyId::Agent);
        moving.target = Some(match mode {
            ActionMode::Relative => [0, 1].map(|axis| start[axis] + 100.0 * f64::from(action[axis])),
            ActionMode::Absolute => action.map(f64::from),
        });
        moving.contact_points = self.sim.control_step(action, mode);
        moving.sim.clone_from(self.sim.state());
        let state = observed_state(&self.sim);
        if state.iter().any(|value| !value.is_finite()) {
            return Err(format!("the state is not finite after the action {action:?}").into());
        }
        Ok(self.outcome_at(&state, &moving.goal))
    }

    fn outcome(&self, moving: &Self::State) -> Outcome {
        self.outcome_at(&observed_state(&self.sim), &moving.goal)
    }

    fn write_episode(&self, moving: &Self::State, out: &mut RowsMut<'_>) {
        out.write(GOAL_POSE, &self.goal_pose);
        out.write(GOAL_STATE, &moving.goal);
        let [x, y, .., vx, vy] = moving.goal;
        out.write(GOAL_PROPRIO, &[x, y, vx, vy]);
    }

    fn observe(&self, moving: &Self::State, out: &mut RowsMut<'_>) {
        let state = observed_state(&self.sim);
        let [x, y, bx, by, _, vx, vy] = state;
        out.write(STATE, &state);
        out.write(PROPRIO, &[x, y, vx, vy]);
        out.write(POS_AGENT, &[x, y]);
        out.write(VEL_AGENT, &[vx, vy]);
        out.write(BLOCK_POSE, &[bx, by, self.sim.angle(BodyId::Block)]);
        out.write(N_CONTACTS, &[i64::from(contact_count(moving.contact_points))]);
    }

    fn dress(&self, _: &Self::State, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError> {
        canvas.set_look(Look::new(look, self.sim.shape(BodyId::Block), &self.settings));
        Ok(())
    }

    fn render(&self, moving: &Self::State, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        let target = moving.target.filter(|_| self.settings.render_action);
        canvas.render(pixels, |look, painter| look.render(&self.sim, target, painter));
    }

    fn render_goal(&self, moving: &Self::State, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        if let Ok(sim) = self.sim_to_show(moving) {
            canvas.render(pixels, |look, painter| look.render(&sim, None, painter));
        }
    }

    fn task_cost(&self, moving: &Self::State) -> Option<f64> {
        Some(goal::task_cost(&self.sim, &moving.goal))
    }

    fn keypoints(&self, _: &Self::State) -> Vec<Keypoint> {
        let at = |name, [x, y]: [f64; 2]| Keypoint { name, at: [x / WORLD_SIDE, y / WORLD_SIDE] };
        vec![
            at("agent", self.sim.position(BodyId::Agent)),
            at("block", self.sim.center_of_gravity(BodyId::Block)),
        ]
    }
}
