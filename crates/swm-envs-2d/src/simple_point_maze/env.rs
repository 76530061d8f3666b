//! `swm/SimplePointMaze-v0` as an environment: reset, step, observation, saved states.

use std::sync::OnceLock;

use swm_core::{Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Outcome, Place, RowsMut, Slice};
use swm_fov::{Fov, FovSpace};

use super::SIMPLE_POINT_MAZE;
use super::factors::Factors;
use super::rendering::{Disc, Look};
use super::settings::Settings;
use super::walls::{MAX_ACTION, Room, SIDE};
use crate::dot_room::{
    DISTANCE, FACTORS, GOAL_STATE, Image, OBSERVATION, PROPRIO, STATE, Saved, finite_action, recorded, spec,
};
use crate::ways::{Ways, distance};

/// Move a disc past walls to a goal. See the module's documentation.
pub struct SimplePointMaze {
    spec: EnvSpec,
    settings: Settings,
    factors: Factors,
    fov: Fov,
    room: Room,
    agent: [f32; 2],
    goal: [f32; 2],
    /// Ways to the goal, found when first asked for.
    ways: OnceLock<Ways>,
    image: Option<Image<Look, Disc>>,
}

/// The room of a state that [`Env::snapshot`] saved.
pub(super) fn saved_room(space: &FovSpace, state: &EnvState) -> Result<Room, EnvError> {
    Saved::load(SIMPLE_POINT_MAZE.id, SIDE, space, state).map(|(_, fov)| Room::new(&fov))
}

impl SimplePointMaze {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = SIMPLE_POINT_MAZE.id;
        let settings: Settings = config.parse_settings(id)?;
        let factors = Factors::new(id, &settings.init_value)?;
        let fov = factors.space.defaults();
        let image = config.image.map(|size| Image::new(size, settings.render)).transpose();
        let image = image.map_err(|reason| EnvError::Setting { env: id.to_owned(), reason })?;
        let mut env = Self {
            spec: spec(id, 2, f64::from(MAX_ACTION), config.image, &factors.space),
            room: Room::new(&fov),
            agent: fov.vector("agent.position"),
            goal: fov.vector("goal.position"),
            settings,
            factors,
            fov,
            ways: OnceLock::new(),
            image,
        };
        env.refresh()?;
        Ok(env)
    }

    /// Euclidean distance to the goal, summed in f32 as in the reference.
    fn distance(&self) -> f32 {
        let [x, y] = [0, 1].map(|axis| self.agent[axis] - self.goal[axis]);
        (x * x + y * y).sqrt()
    }

    fn outcome(&self) -> Outcome {
        let success = self.distance() < self.fov.f32("goal.radius");
        Outcome { reward: if success { 1.0 } else { -0.01 }, terminated: success, success: Some(success) }
    }

    /// Takes over the factors and the goal of an episode.
    fn refresh(&mut self) -> Result<(), EnvError> {
        self.room = Room::new(&self.fov);
        self.ways = OnceLock::new();
        let Some(image) = &mut self.image else { return Ok(()) };
        let goal = self.settings.show_goal.then_some(self.goal);
        let disc = Disc { center: self.agent, radius: self.room.radius, color: self.fov.rgb("agent.color") };
        image.set_look(&self.spec.id, disc, Look::new(&self.fov, &self.room, goal))
    }
}

impl Env for SimplePointMaze {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let start = recorded(&self.spec.id, SIDE, &episode.options.start)?;
        let goal = recorded(&self.spec.id, SIDE, &episode.options.goal)?;
        self.fov = self.factors.sample(&self.spec.id, episode, start, goal)?;
        self.agent = start.unwrap_or_else(|| self.fov.vector("agent.position"));
        self.goal = goal.unwrap_or_else(|| self.fov.vector("goal.position"));
        self.refresh()?;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        self.agent = self.room.step(self.agent, finite_action(&self.spec.id, action)?);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &self.goal);
        self.fov.write(FACTORS, out);
        if let Some(image) = &mut self.image {
            image.write_goal(self.goal, &self.spec, out);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        for field in [OBSERVATION, STATE, PROPRIO] {
            out.write(field, &self.agent);
        }
        out.write(DISTANCE, &[f64::from(self.distance())]);
        if let Some(image) = &mut self.image {
            image.render(self.agent, out.at(self.spec.fields.len() - 2));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), agent: self.agent, target: self.goal };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let (saved, fov) = Saved::load(&self.spec.id, SIDE, &self.factors.space, state)?;
        // Planners return to states of one episode again and again: what does not change in it stays.
        let is_same_episode = fov == self.fov && saved.target == self.goal;
        (self.fov, self.agent, self.goal) = (fov, saved.agent, saved.target);
        if is_same_episode { Ok(()) } else { self.refresh() }
    }

    /// The length of the shortest way to the goal.
    fn task_cost(&self) -> Option<f64> {
        let ways = self.ways.get_or_init(|| self.room.ways(self.goal));
        let [agent, goal] = [self.agent, self.goal].map(|position| position.map(f64::from));
        let length = ways.leg(agent).length;
        // Where walls leave no way: as the crow flies, and worse than any way.
        Some(if length.is_finite() { length } else { distance(agent, goal) + f64::from(4.0 * SIDE) })
    }

    fn places(&self) -> Vec<Place> {
        let [x, y] = self.agent.map(|c| f64::from(c / SIDE));
        vec![Place { name: "agent", at: [x, 1.0 - y] }]
    }
}
