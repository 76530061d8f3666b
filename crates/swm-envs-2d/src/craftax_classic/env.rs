//! `swm/CraftaxClassicSymbolic-v1` and `swm/CraftaxClassicPixels-v1`: reset, step, observation, images.

use swm_core::{Dtype, EnvSpec, Episode, Field, ImageSize, Keypoint, Outcome, RowsMut, Slice, Space};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::{factors, params};
use super::observation::VALUES;
use super::rendering::Artist;
use super::rules::{ACHIEVEMENTS, ACTIONS, Params};
use super::state::State;
use super::{game, observation, rendering, world};
use crate::settings::FactorDefaults;

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const ACHIEVED: usize = 1;
/// Of the symbolic environment only.
const OBSERVATION: usize = 2;

/// Values of the column `state`: row, column, direction, health, food, drink, energy, sleep, steps, and the inventory.
const STATE_DIM: usize = 9 + 12;

/// A world of blocks, with symbolic observations or without. See the module's documentation.
pub(super) struct CraftaxClassic<const IS_SYMBOLIC: bool> {
    seed: u32,
    params: Params,
}

impl<const IS_SYMBOLIC: bool> Scene for CraftaxClassic<IS_SYMBOLIC> {
    const ID: &'static str =
        if IS_SYMBOLIC { "swm/CraftaxClassicSymbolic-v1" } else { "swm/CraftaxClassicPixels-v1" };
    const HAS_GOAL_IMAGE: bool = false;
    type Settings = FactorDefaults;
    type State = State;
    type Canvas = Artist;

    fn factors(settings: &FactorDefaults) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let mut fields = vec![
            Field::step("state", Dtype::I64, &[STATE_DIM]),
            Field::step("achievements", Dtype::U8, &[ACHIEVEMENTS]),
        ];
        if IS_SYMBOLIC {
            fields.push(Field::step("observation", Dtype::F32, &[VALUES]));
        }
        EnvSpec::new(Self::ID, Space::Discrete { n: ACTIONS as i64, start: 0 }, fields)
    }

    fn canvas(_: &FactorDefaults, size: ImageSize) -> Result<Artist, SceneError> {
        Artist::new(size).map_err(|error| error.to_string().into())
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        if episode.options.start.is_some() || episode.options.goal.is_some() {
            let reason = "a row of a dataset does not hold a whole world: episodes start at the world's start, \
                          without a goal";
            return Err(reason.into());
        }
        Ok(space.sample(Self::ID, episode)?)
    }

    fn new(_: &FactorDefaults, fov: &Fov) -> Result<Self, SceneError> {
        let (seed, params) = params(fov);
        Ok(Self { seed, params })
    }

    fn start(&mut self, _: &EnvSpec, _: &Fov, _: &Episode<'_>) -> Result<State, SceneError> {
        Ok(world::generate(self.seed, &self.params))
    }

    fn restore(&mut self, state: &State) -> Result<(), SceneError> {
        Ok(state.check()?)
    }

    fn step(&mut self, state: &mut State, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let chosen = match action {
            Slice::I64(&[chosen]) if (0..ACTIONS as i64).contains(&chosen) => chosen,
            _ => return Err(format!("{action:?} is no action: they are 0 to {}", ACTIONS - 1).into()),
        };
        let reward = game::step(state, chosen, &self.params).into();
        Ok(Outcome { reward, ..self.outcome(state) })
    }

    fn outcome(&self, state: &State) -> Outcome {
        Outcome { reward: f64::NAN, terminated: game::is_over(state), success: None }
    }

    fn observe(&self, state: &State, out: &mut RowsMut<'_>) {
        let State { player: [row, column], direction, vitals, inventory, steps, .. } = state;
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
        let achieved: [u8; ACHIEVEMENTS] = std::array::from_fn(|i| (state.achievements >> i & 1) as u8);
        out.write(ACHIEVED, &achieved);
        if IS_SYMBOLIC {
            observation::write(state, out.at(OBSERVATION));
        }
    }

    /// All that an image shows moves.
    fn dress(&self, _: &State, _: &Fov, _: &mut Artist) -> Result<(), SceneError> {
        Ok(())
    }

    fn render(&self, state: &State, artist: &mut Artist, pixels: &mut [u8]) {
        artist.render(state, pixels).expect("the pixel field has the artist's size");
    }

    /// What an episode can still gain: achievements, and 0.1 for each point of health.
    fn task_cost(&self, state: &State) -> Option<f64> {
        let missing = ACHIEVEMENTS as f64 - f64::from(state.achievements.count_ones());
        Some(missing + 0.1 * f64::from(9 - state.vitals.health))
    }

    fn keypoints(&self, _: &State) -> Vec<Keypoint> {
        // The view moves with the player.
        vec![Keypoint { name: "agent", at: rendering::PLAYER_AT }]
    }
}
