//! What Craftax-Classic promises beyond conformance: games equal to the original's.

use std::fs::File;

use ndarray::{ArrayD, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadableElement};
use serde_json::{Map, Value as Json};
use swm_core::{Batch, Env, EnvConfig, EnvState, Episode, EpisodeSeed, ResetOptions, Schema, Slice, Value};

use super::rules::{ACHIEVEMENTS, Params};
use super::{CRAFTAX_CLASSIC_PIXELS, CRAFTAX_CLASSIC_SYMBOLIC, expert, game, world};

const GAMES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/craftax/CraftaxClassic.npz");

fn list<T: ReadableElement + Clone>(npz: &mut NpzReader<File>, name: &str) -> Vec<T> {
    let array: ArrayD<T> = npz.by_name::<OwnedRepr<T>, IxDyn>(name).expect(name);
    array.iter().cloned().collect()
}

/// The factor of a constant of the original.
fn factor(constant: &str) -> &'static str {
    match constant {
        "day_length" => "day.length",
        "zombie_health" => "zombies.health",
        "cow_health" => "cows.health",
        "skeleton_health" => "skeletons.health",
        "mob_despawn_distance" => "mobs.despawn_distance",
        "spawn_cow_chance" => "cows.chance",
        "spawn_zombie_base_chance" => "zombies.chance",
        "spawn_zombie_night_chance" => "zombies.night_chance",
        "spawn_skeleton_chance" => "skeletons.chance",
        other => panic!("no factor for {other}"),
    }
}

/// An environment with a row, as a world has it.
struct Game {
    env: Box<dyn Env>,
    row: Batch,
}

impl Game {
    fn new(seed: i64, constants: &Map<String, Json>) -> Self {
        let mut env = CRAFTAX_CLASSIC_SYMBOLIC.make(&EnvConfig::default()).unwrap();
        let mut options = ResetOptions::default().vary(["none"]).set("world.seed", Value::scalar(seed));
        for (name, value) in constants {
            options = options.set(factor(name), Value::from_json(name, value).unwrap());
        }
        env.reset(&Episode::new(EpisodeSeed::new(0), &options)).unwrap();
        let row = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
        let mut game = Self { env, row };
        game.env.observe(&mut game.row.rows_mut());
        game
    }

    fn step(&mut self, action: u8) -> (f32, bool) {
        let outcome = self.env.step(Slice::I64(&[action.into()])).unwrap();
        self.env.observe(&mut self.row.rows_mut());
        (outcome.reward as f32, outcome.terminated)
    }

    /// The state, the achievements, the light, and the digest of all else that is observed.
    fn observed(&self) -> (Vec<i64>, u32, f32, u64) {
        const LIGHT: usize = 1343;
        let observation = self.row.get::<f32>("observation").unwrap();
        let others = observation.iter().enumerate().filter(|(index, _)| *index != LIGHT);
        let digest = others.fold(0_u64, |digest, (_, value)| {
            digest.wrapping_mul(0x100_0000_01b3).wrapping_add(value.to_bits().into())
        });
        let achieved = self.row.get::<u8>("achievements").unwrap();
        let achieved = achieved.iter().enumerate().map(|(i, &done)| u32::from(done) << i).sum();
        (self.row.get::<i64>("state").unwrap().to_vec(), achieved, observation[LIGHT], digest)
    }
}

#[test]
fn games_are_those_of_the_original() {
    let mut npz = NpzReader::new(File::open(GAMES).expect(GAMES)).unwrap();
    let names = npz.names().unwrap();
    let runs: Vec<&str> = names.iter().filter_map(|name| name.strip_suffix("/actions")).collect();
    assert_eq!(runs.len(), 9);
    let (mut steps, mut all) = (0, 0);
    for run in runs {
        let seed = list::<u32>(&mut npz, &format!("{run}/seed"))[0];
        let constants = list::<u8>(&mut npz, &format!("{run}/params"));
        let mut game = Game::new(seed.into(), &serde_json::from_slice(&constants).unwrap());
        let map: Vec<u8> = list(&mut npz, &format!("{run}/map"));
        assert_eq!(world::generate(seed, &Params::default()).map.blocks, map, "the world of {run}");
        let actions: Vec<u8> = list(&mut npz, &format!("{run}/actions"));
        let rewards: Vec<f32> = list(&mut npz, &format!("{run}/reward"));
        let ends: Vec<u8> = list(&mut npz, &format!("{run}/terminated"));
        let states: Vec<i32> = list(&mut npz, &format!("{run}/state"));
        let achieved: Vec<u32> = list(&mut npz, &format!("{run}/achievements"));
        let lights: Vec<f32> = list(&mut npz, &format!("{run}/light"));
        let digests: Vec<u64> = list(&mut npz, &format!("{run}/digest"));
        for t in 0..=actions.len() {
            if t > 0 {
                let wanted = (rewards[t - 1], ends[t - 1] != 0);
                assert_eq!(game.step(actions[t - 1]), wanted, "{run}, step {t}");
            }
            let (state, done, light, digest) = game.observed();
            let wanted: Vec<i64> = states[t * 21..(t + 1) * 21].iter().map(|&v| v.into()).collect();
            assert_eq!((state, done), (wanted, achieved[t]), "{run}, step {t}");
            assert_eq!(digest, digests[t], "{run}, step {t}: the observation");
            // The cosine is that of the C library.
            assert!((light - lights[t]).abs() < 1e-6, "{run}, step {t}: light {light} and {}", lights[t]);
        }
        steps += actions.len();
        all |= achieved[actions.len()];
    }
    assert_eq!((steps, all), (2835, (1 << ACHIEVEMENTS) - 1), "they hold every achievement");
}

#[test]
fn the_expert_gets_most_achievements() {
    let params = Params::default();
    let achieved = (100..106).map(|seed| {
        let mut state = world::generate(seed, &params);
        for _ in 0..1000 {
            let chosen = expert::choose(&state);
            game::step(&mut state, chosen, &params);
            if game::is_over(&state) {
                break;
            }
        }
        state.achievements.count_ones()
    });
    let achieved: Vec<u32> = achieved.collect();
    assert!(achieved.iter().sum::<u32>() >= 6 * 17, "{achieved:?}");
}

#[test]
fn foreign_states_and_actions_are_refused() {
    let mut env = CRAFTAX_CLASSIC_PIXELS.make(&EnvConfig::default()).unwrap();
    let error = env.step(Slice::I64(&[17])).unwrap_err().to_string();
    assert!(error.contains("0 to 16"), "{error}");
    let mut state = EnvState::new();
    env.snapshot(&mut state).unwrap();
    let mut bytes = state.bytes().to_vec();
    // A block in the middle of the map that does not exist.
    let middle = bytes.len() / 2;
    bytes[middle] = 99;
    assert!(env.restore(&EnvState::from_bytes(bytes)).is_err());
    assert!(env.restore(&state).is_ok());
    let row = [("state".to_owned(), Value::vector(&[0_i64; 21]))];
    let options = ResetOptions { start: Some(row.into()), ..ResetOptions::default() };
    let error = env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap_err().to_string();
    assert!(error.contains("without a goal"), "{error}");
}
