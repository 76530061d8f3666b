//! `swm/TwoRoom-v2` as an environment: reset, step, observation, saved states.

use std::collections::BTreeMap;

use swm_core::{Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Outcome, RowsMut, Slice, Value};
use swm_fov::{Fov, FovSpace};

use super::TWO_ROOM_V2;
use super::dot::Dot;
use super::factors::factors;
use super::rendering::Look;
use super::room::{Room, SIDE, SUCCESS_PX, distance_f32};
use super::route;
use super::settings::Settings;
use crate::dot_room::{
    DISTANCE, FACTORS, GOAL_STATE, Image, OBSERVATION, PROPRIO, STATE, Saved, recorded, spec, target,
};

/// Walk from one room to a target in either. See the module's documentation.
pub struct TwoRoom {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    room: Room,
    agent: [f32; 2],
    target: [f32; 2],
    image: Option<Image<Look, Dot>>,
    /// Values of visual factors that images show in place of those of the episode.
    look: BTreeMap<String, Value>,
}

/// The factor table as the settings have it.
pub(super) fn factors_with(settings: &Settings) -> Result<FovSpace, EnvError> {
    factors().with_defaults(TWO_ROOM_V2.id, &settings.init_value)
}

/// The rooms of a state that [`Env::snapshot`] saved.
pub(super) fn saved_room(space: &FovSpace, state: &EnvState) -> Result<Room, EnvError> {
    let (_, fov) = Saved::load(TWO_ROOM_V2.id, SIDE, space, state)?;
    Ok(Room::new(&fov))
}

impl TwoRoom {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = TWO_ROOM_V2.id;
        let settings: Settings = config.parse_settings(id)?;
        let wrong = |reason: String| EnvError::Setting { env: id.to_owned(), reason };
        let space = factors_with(&settings)?;
        let fov = space.defaults();
        let (agent, target) = (fov.vector("agent.position"), fov.vector("target.position"));
        let image = config.image.map(|size| Image::new(size, settings.render)).transpose().map_err(wrong)?;
        let mut env = Self {
            spec: spec(id, 10, 1.0, config.image, &space),
            room: Room::new(&fov),
            settings,
            space,
            fov,
            agent,
            target,
            image,
            look: BTreeMap::new(),
        };
        env.refresh_look()?;
        Ok(env)
    }

    /// Pixels to walk to a target, through a door if need be.
    fn way_to(&self, target: [f32; 2]) -> f64 {
        let [from, to] = [self.agent, target].map(|position| position.map(f64::from));
        route::way(&self.room, from, to).length
    }

    fn distance(&self) -> f32 {
        distance_f32(self.agent, self.target)
    }

    fn outcome(&self) -> Outcome {
        let success = f64::from(self.distance()) < SUCCESS_PX;
        Outcome { reward: 0.0, terminated: success, success: Some(success) }
    }

    fn refresh_look(&mut self) -> Result<(), EnvError> {
        let Some(image) = &mut self.image else { return Ok(()) };
        let dressed = self.space.dressed(&self.spec.id, &self.fov, &self.look)?;
        let look = Look::new(&dressed, self.target, &self.settings);
        image.set_look(&self.spec.id, Dot::new(&dressed, self.agent), look)
    }
}

impl Env for TwoRoom {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let options = episode.options;
        self.fov = match self.space.sample(&self.spec.id, episode) {
            // A recorded start stands elsewhere than the factor says: what counts is whether it can stand there.
            Err(EnvError::Constraint { .. }) if options.start.is_some() => {
                let start = recorded(&self.spec.id, SIDE, &options.start)?;
                let in_use = start.map(|at| ("agent.position", Value::vector(&at)));
                self.space.sample_in_use(&self.spec.id, episode, in_use.as_slice())?
            }
            drawn => drawn?,
        };
        self.room = Room::new(&self.fov);
        let start = recorded(&self.spec.id, SIDE, &options.start)?;
        self.agent = start.unwrap_or_else(|| self.fov.vector("agent.position"));
        self.target = match recorded(&self.spec.id, SIDE, &options.goal)? {
            Some(goal) => goal,
            None => {
                let least_px = |steps: i64| steps as f64 * f64::from(self.room.speed);
                let way_to = |target| self.way_to(target);
                target(&self.spec, &self.fov, &self.settings.init_value, episode, least_px, way_to)
            }
        };
        self.refresh_look()?;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let Slice::F32(&[x, y]) = action else {
            let reason = format!("{} values of {} are no action", action.len(), action.dtype());
            return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
        };
        self.agent = self.room.step(self.agent, [x, y]);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &self.target);
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            image.write_goal(self.target, &self.spec, out);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let observation: &mut [f32] = out.at(OBSERVATION);
        observation.fill(0.0);
        observation[..2].copy_from_slice(&self.agent);
        observation[2..4].copy_from_slice(&self.target);
        for (pair, door) in observation[4..].chunks_exact_mut(2).zip(self.room.doors()) {
            pair.copy_from_slice(
                &self.room.position(super::room::WALL_CENTER_PX, door.center).map(|c| c as f32),
            );
        }
        out.write(STATE, &self.agent);
        out.write(PROPRIO, &self.agent);
        out.write(DISTANCE, &[f64::from(self.distance())]);
        if let Some(image) = &mut self.image {
            image.render(self.agent, out.at(self.spec.fields.len() - 2));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), agent: self.agent, target: self.target };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let (saved, fov) = Saved::load(&self.spec.id, SIDE, &self.space, state)?;
        let same_look = fov == self.fov && saved.target == self.target;
        (self.fov, self.agent, self.target) = (fov, saved.agent, saved.target);
        if !same_look {
            self.room = Room::new(&self.fov);
            self.refresh_look()?;
        }
        Ok(())
    }

    fn dress(&mut self, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        self.space.dressed(&self.spec.id, &self.fov, look)?;
        if *look != self.look {
            self.look.clone_from(look);
            self.refresh_look()?;
        }
        Ok(())
    }

    /// Pixels to walk to the target, through a door if need be.
    fn task_cost(&self) -> Option<f64> {
        Some(self.way_to(self.target))
    }
}
