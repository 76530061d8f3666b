//! `swm/Piecewise-v0` as an environment: reset, step, observation, saved states.

use swm_core::{Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Outcome, Place, RowsMut, Slice};
use swm_fov::{Fov, FovSpace};

use super::PIECEWISE;
use super::factors::factors;
use super::rendering::Look;
use super::settings::Settings;
use super::zones::Zones;
use crate::dot_room::{
    DISTANCE, FACTORS, GOAL_STATE, Image, OBSERVATION, PROPRIO, STATE, Saved, finite_action, recorded, spec,
    target,
};
use crate::tworoom_v2::dot::Dot;
use crate::tworoom_v2::room::{IMAGE_PX, SIDE, SUCCESS_PX, distance_f32};

/// Walk to a target over zones that push. See the module's documentation.
pub struct Piecewise {
    spec: EnvSpec,
    settings: Settings,
    space: FovSpace,
    fov: Fov,
    zones: Zones,
    agent: [f32; 2],
    target: [f32; 2],
    image: Option<Image<Look, Dot>>,
}

/// The zones of a state that [`Env::snapshot`] saved.
pub(super) fn saved_zones(settings: &Settings, state: &EnvState) -> Result<Zones, EnvError> {
    let (_, fov) = Saved::load(PIECEWISE.id, SIDE, &factors(settings.grid_n), state)?;
    Ok(Zones::new(&fov, settings.grid_n))
}

impl Piecewise {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let id = PIECEWISE.id;
        let settings: Settings = config.parse_settings(id)?;
        let wrong = |reason: String| EnvError::Setting { env: id.to_owned(), reason };
        settings.check().map_err(wrong)?;
        let space = factors(settings.grid_n).with_defaults(id, &settings.init_value)?;
        let fov = space.defaults();
        let image = config.image.map(|size| Image::new(size, settings.render)).transpose().map_err(wrong)?;
        let mut env = Self {
            spec: spec(id, 4, 1.0, config.image, &space),
            zones: Zones::new(&fov, settings.grid_n),
            agent: fov.vector("agent.position"),
            target: fov.vector("target.position"),
            settings,
            space,
            fov,
            image,
        };
        env.refresh_look()?;
        Ok(env)
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
        let look = Look::new(&self.fov, &self.zones, self.target);
        image.set_look(&self.spec.id, Dot::new(&self.fov, self.agent), look)
    }
}

impl Env for Piecewise {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        self.zones = Zones::new(&self.fov, self.settings.grid_n);
        let start = recorded(&self.spec.id, SIDE, &episode.options.start)?;
        self.agent = start.unwrap_or_else(|| self.fov.vector("agent.position"));
        self.target = match recorded(&self.spec.id, SIDE, &episode.options.goal)? {
            Some(goal) => goal,
            None => {
                let least_px = |steps: i64| f64::from(steps as f32 * self.zones.speed);
                let way_to = |target| f64::from(distance_f32(self.agent, target));
                target(&self.spec, &self.fov, &self.settings.init_value, episode, least_px, way_to)
            }
        };
        self.refresh_look()?;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        self.agent = self.zones.step(self.agent, finite_action(&self.spec.id, action)?);
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
        let ([x, y], [to_x, to_y]) = (self.agent, self.target);
        out.write(OBSERVATION, &[x, y, to_x, to_y]);
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
        let is_same_look = fov == self.fov && saved.target == self.target;
        (self.fov, self.agent, self.target) = (fov, saved.agent, saved.target);
        if !is_same_look {
            self.zones = Zones::new(&self.fov, self.settings.grid_n);
            self.refresh_look()?;
        }
        Ok(())
    }

    /// Pixels to the target.
    fn task_cost(&self) -> Option<f64> {
        Some(f64::from(self.distance()))
    }

    fn places(&self) -> Vec<Place> {
        let at = self.agent.map(|c| (f64::from(c) + 0.5) / IMAGE_PX as f64);
        vec![Place { name: "agent", at }]
    }
}
