//! Episodes as users meet them: experts, starts from rows, wrong input.

use serde_json::json;
use swm_core::env::ResetOptions;
use swm_core::{
    Env, EnvConfig, Episode, EpisodeSeed, Evaluation, PolicyContext, Registry, Rollout, Slice, Value, World,
    WorldOptions,
};

use super::super::ROCKET_LANDING;
use super::super::body::STANDING_HEIGHT;
use swm_fov::FactorEnv;

use super::super::env::RocketLanding;
use super::super::state::State;
use crate::attitude::UPRIGHT;

fn evaluate(policy: &str, settings: &serde_json::Value, options: &ResetOptions, episodes: u64) -> Evaluation {
    let config = EnvConfig { image: None, settings: settings.as_object().unwrap().clone() };
    let mut world =
        World::new(&ROCKET_LANDING, WorldOptions::new(8).env(config).max_episode_steps(1200)).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    world.evaluate(&Rollout::new(0..episodes).seed(5).options(options.clone())).unwrap()
}

#[test]
fn the_expert_lands() {
    let everything = ResetOptions::default().vary(["all"]);
    let mut wanted = Vec::new();
    for (what, settings, options, episodes, least) in [
        ("default", json!({}), ResetOptions::default(), 300, 95.0),
        ("randomize_drop", json!({ "randomize_drop": true }), ResetOptions::default(), 300, 95.0),
        ("all factors", json!({}), everything.clone(), 100, 80.0),
        ("all factors, randomize_drop", json!({ "randomize_drop": true }), everything, 100, 80.0),
    ] {
        let result = evaluate("expert", &settings, &options, episodes);
        let mean = result.mean_success_steps.unwrap_or(f64::NAN);
        println!("{what}: {} % of {episodes}, {mean:.1} steps", result.success_rate);
        wanted.push((what, result.success_rate, least));
    }
    assert!(wanted.iter().all(|(_, rate, least)| rate >= least), "{wanted:?}");
}

fn reset(env: &mut FactorEnv<RocketLanding>, options: &ResetOptions) -> Result<(), String> {
    let episode = Episode::new(EpisodeSeed::new(3), options);
    env.reset(&episode).map(|_| ()).map_err(|error| error.to_string())
}

fn from_row(row: &[f64]) -> ResetOptions {
    let start = Some([("state".to_owned(), Value::vector(row))].into());
    ResetOptions { start, ..ResetOptions::default() }
}

#[test]
fn recorded_rows_start_episodes_exactly() {
    let mut env = FactorEnv::<RocketLanding>::new(&EnvConfig::default()).unwrap();
    reset(&mut env, &ResetOptions::default()).unwrap();
    for t in 0..50 {
        let level = f64::from(t) / 50.0;
        env.step(Slice::F64(&[level, -0.5, 0.3, 1.0, level, 0.2, -0.4])).unwrap();
    }
    let state = env.state().state;
    let mut again = FactorEnv::<RocketLanding>::new(&EnvConfig::default()).unwrap();
    reset(&mut again, &from_row(&state.to_row())).unwrap();
    assert_eq!(again.state().state, state);
    // Noise is of the episode: without it both go on alike.
    let action = [0.1, 0.2, 0.3, 1.0, 0.4, 0.5, 0.6];
    let [(scene, moving), (other, its)] = [&mut env, &mut again].map(FactorEnv::parts_mut);
    assert_eq!(scene.step_with(moving, &action, &[0.0; 6]), other.step_with(its, &action, &[0.0; 6]));
    assert_eq!(again.state().state, env.state().state);
}

#[test]
fn wrong_rows_actions_and_arguments_are_refused() {
    let mut env = FactorEnv::<RocketLanding>::new(&EnvConfig::default()).unwrap();
    let nothing = ResetOptions { start: Some(Default::default()), ..ResetOptions::default() };
    assert!(reset(&mut env, &nothing).unwrap_err().contains("column `state`"));
    let mut row = State::landed(0.5).to_row();
    row[2] = f64::NAN;
    assert!(reset(&mut env, &from_row(&row)).unwrap_err().contains("not finite"));
    row = State::landed(0.5).to_row();
    row[6] = 0.5;
    assert!(reset(&mut env, &from_row(&row)).unwrap_err().contains("unit quaternions"));
    reset(&mut env, &ResetOptions::default()).unwrap();
    let message = env.step(Slice::F32(&[0.0; 7])).unwrap_err().to_string();
    assert!(message.contains("no action"), "{message}");
    let config = EnvConfig::default();
    let context = PolicyContext::new(&ROCKET_LANDING, &config);
    for (policy, part) in [("noisy-expert:-1", "std -1"), ("expert:std=1", "std")] {
        let message = Registry::new().policy(policy, context).err().expect("it is wrong").to_string();
        assert!(message.contains(part), "{policy}: {message}");
    }
}

#[test]
fn episodes_end_where_the_reference_ends_them() {
    let last = |settings: serde_json::Value, state: State| {
        let config = EnvConfig { image: None, settings: settings.as_object().unwrap().clone() };
        let mut env = FactorEnv::<RocketLanding>::new(&config).unwrap();
        reset(&mut env, &from_row(&state.to_row())).unwrap();
        for step in 1.. {
            let outcome = env.step(Slice::F64(&[0.0; 7])).unwrap();
            if outcome.terminated || env.is_truncated() {
                return (step, outcome.terminated, outcome.success == Some(true));
            }
        }
        unreachable!("an episode ends")
    };
    let falling = |position: [f64; 3], speed: f64| {
        let mut state = State::at_rest(position, UPRIGHT, 0.05);
        state.velocity[2] = -speed;
        state
    };
    assert_eq!(last(json!({}), falling([0.0, 0.0, 2.65], 1.0)), (3, false, true), "a landing truncates");
    assert!(last(json!({}), falling([0.0, 0.0, 2.9], 8.0)).1, "too fast for the pad");
    assert!(last(json!({}), falling([6.0, 0.0, 2.7], 1.0)).1, "beside the pad");
    assert_eq!(last(json!({}), falling([200.5, 0.0, 50.0], 0.0)), (1, true, false), "out of bounds");
    assert_eq!(last(json!({ "time_limit": 7 }), falling([0.0, 0.0, 400.0], 0.0)), (7, false, false));
}

#[test]
fn a_rocket_that_lands_softly_rests_on_its_legs() {
    let mut env = FactorEnv::<RocketLanding>::new(&EnvConfig::default()).unwrap();
    let mut state = State::landed(0.05);
    state.position[2] += 0.02;
    reset(&mut env, &from_row(&state.to_row())).unwrap();
    for _ in 0..80 {
        env.step(Slice::F64(&[0.0; 7])).unwrap();
    }
    let State { position, velocity, .. } = env.state().state;
    assert!((position[2] - STANDING_HEIGHT).abs() < 5e-3, "{position:?}");
    assert!(velocity.iter().all(|speed| speed.abs() < 0.05), "{velocity:?}");
}

#[test]
fn a_sparse_reward_is_of_the_pad_alone() {
    let config = json!({ "sparse_reward": true });
    let mut env = FactorEnv::<RocketLanding>::new(&EnvConfig {
        image: None,
        settings: config.as_object().unwrap().clone(),
    })
    .unwrap();
    let mut state = State::landed(0.05);
    state.position[2] = 2.8;
    reset(&mut env, &from_row(&state.to_row())).unwrap();
    let mut rewards: Vec<f64> = Vec::new();
    while !env.is_truncated() {
        rewards.push(env.step(Slice::F64(&[0.0; 7])).unwrap().reward);
    }
    let (last, before) = rewards.split_last().unwrap();
    assert!(before.iter().all(|reward| *reward == 0.0) && *last > 7.0, "{rewards:?}");
}
