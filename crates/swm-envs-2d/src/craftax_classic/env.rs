//! `swm/CraftaxClassicSymbolic-v1` and `swm/CraftaxClassicPixels-v1`: reset, step, observation, saved states.

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, Outcome, Place, RowsMut, Slice, Space,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use super::factors::{factors, params};
use super::observation::VALUES;
use super::rendering::Artist;
use super::rules::{ACHIEVEMENTS, ACTIONS, Params};
use super::state::State;
use super::{game, observation, rendering, world};
use crate::settings::FactorDefaults;

pub(super) const SYMBOLIC_ID: &str = "swm/CraftaxClassicSymbolic-v1";
pub(super) const PIXELS_ID: &str = "swm/CraftaxClassicPixels-v1";

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const ACHIEVED: usize = 1;
/// Of the symbolic environment only.
const OBSERVATION: usize = 2;

/// Values of the column `state`: row, column, direction, health, food, drink, energy, sleep, steps, and the inventory.
const STATE_DIM: usize = 9 + 12;

/// A world of blocks. See the module's documentation.
pub struct CraftaxClassic {
    spec: EnvSpec,
    is_symbolic: bool,
    space: FovSpace,
    fov: Fov,
    params: Params,
    state: State,
    artist: Option<Artist>,
}

/// A saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    state: State,
}

/// A saved state, borrowed: maps are long.
#[derive(Serialize)]
struct SavedRef<'a> {
    fov: SavedFov,
    state: &'a State,
}

/// The game of a state that [`Env::snapshot`] saved.
pub(super) fn saved_game(env: &str, state: &EnvState) -> Result<State, EnvError> {
    let saved: Saved = state.load(env)?;
    Ok(saved.state)
}

impl CraftaxClassic {
    /// Makes the environment with symbolic observations.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// drawn.
    pub fn symbolic(config: &EnvConfig) -> Result<Self, EnvError> {
        Self::new(SYMBOLIC_ID, config)
    }

    /// Makes the environment without symbolic observations.
    ///
    /// # Errors
    ///
    /// As [`CraftaxClassic::symbolic`].
    pub fn pixels(config: &EnvConfig) -> Result<Self, EnvError> {
        Self::new(PIXELS_ID, config)
    }

    fn new(id: &str, config: &EnvConfig) -> Result<Self, EnvError> {
        let settings: FactorDefaults = config.parse_settings(id)?;
        let space = factors().with_defaults(id, &settings.init_value)?;
        let fov = space.defaults();
        let artist = config.image.map(Artist::new).transpose();
        let artist =
            artist.map_err(|error| EnvError::Setting { env: id.to_owned(), reason: error.to_string() })?;
        let (seed, params) = params(&fov);
        let is_symbolic = id == SYMBOLIC_ID;
        let spec = spec(id, is_symbolic, config, &space);
        Ok(Self { spec, is_symbolic, space, fov, params, state: world::generate(seed, &params), artist })
    }

    fn outcome(&self, reward: f64) -> Outcome {
        Outcome { reward, terminated: game::is_over(&self.state), success: None }
    }
}

impl Env for CraftaxClassic {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        if episode.options.start.is_some() || episode.options.goal.is_some() {
            return Err(EnvError::Reset {
                env: self.spec.id.clone(),
                reason:
                    "a row of a dataset does not hold a whole world: episodes start at the world's start, \
                         without a goal"
                        .to_owned(),
            });
        }
        self.fov = self.space.sample(&self.spec.id, episode)?;
        let (seed, params) = params(&self.fov);
        (self.params, self.state) = (params, world::generate(seed, &params));
        Ok(self.outcome(f64::NAN))
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let chosen = match action {
            Slice::I64(&[chosen]) if (0..ACTIONS as i64).contains(&chosen) => chosen,
            _ => {
                let reason = format!("{action:?} is no action: they are 0 to {}", ACTIONS - 1);
                return Err(EnvError::Diverged { env: self.spec.id.clone(), reason });
            }
        };
        let reward = game::step(&mut self.state, chosen, &self.params);
        Ok(self.outcome(reward.into()))
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.fov.write(self.first_factor(), out);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let State { player: [row, column], direction, vitals, inventory, steps, .. } = &self.state;
        let mut values = [0_i64; STATE_DIM];
        let levels =
            [*row, *column, *direction as i32, vitals.health, vitals.food, vitals.drink, vitals.energy];
        for (value, level) in values.iter_mut().zip(levels) {
            *value = level.into();
        }
        (values[7], values[8]) = (vitals.is_sleeping.into(), (*steps).into());
        for (value, count) in values[9..].iter_mut().zip(inventory.counts()) {
            *value = count.into();
        }
        out.write(STATE, &values);
        let achieved: [u8; ACHIEVEMENTS] = std::array::from_fn(|i| (self.state.achievements >> i & 1) as u8);
        out.write(ACHIEVED, &achieved);
        if self.is_symbolic {
            observation::write(&self.state, out.at(OBSERVATION));
        }
        if let Some(artist) = &mut self.artist {
            let rendered = artist.render(&self.state, out.at(self.spec.fields.len() - 1));
            rendered.expect("the pixel field has the artist's size");
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(&self.spec.id, &SavedRef { fov: self.fov.save(), state: &self.state })
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        let foreign = |reason: String| EnvError::State { env: self.spec.id.clone(), reason };
        saved.state.check().map_err(foreign)?;
        self.fov = self.space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        (_, self.params) = params(&self.fov);
        self.state = saved.state;
        Ok(())
    }

    /// What an episode can still gain: achievements, and 0.1 for each point of health.
    fn task_cost(&self) -> Option<f64> {
        let missing = ACHIEVEMENTS as f64 - f64::from(self.state.achievements.count_ones());
        Some(missing + 0.1 * f64::from(9 - self.state.vitals.health))
    }

    fn places(&self) -> Vec<Place> {
        // The view moves with the player.
        vec![Place { name: "agent", at: rendering::PLAYER_AT }]
    }
}

impl CraftaxClassic {
    fn first_factor(&self) -> usize {
        if self.is_symbolic { OBSERVATION + 1 } else { OBSERVATION }
    }
}

fn spec(id: &str, is_symbolic: bool, config: &EnvConfig, space: &FovSpace) -> EnvSpec {
    let mut fields = vec![
        Field::step("state", Dtype::I64, &[STATE_DIM]),
        Field::step("achievements", Dtype::U8, &[ACHIEVEMENTS]),
    ];
    if is_symbolic {
        fields.push(Field::step("observation", Dtype::F32, &[VALUES]));
    }
    fields.extend(space.fields());
    fields.extend(config.image.map(|size| size.field(PIXELS)));
    EnvSpec::new(id, Space::Discrete { n: ACTIONS as i64, start: 0 }, fields).factors(space.specs())
}
