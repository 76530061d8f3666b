//! What TablePush3D promises beyond conformance: what factors do to the motion, what the expert reaches, wrong input.

use serde_json::json;
use swm_core::{
    Env as _, EnvConfig, Episode, EpisodeSeed, Registry, ResetOptions, Rollout, Slice, Value, World,
    WorldOptions,
};
use swm_fov::FactorEnv;

use super::state::State;
use super::{TABLE_PUSH, TablePush};

fn evaluate(policy: &str, episodes: u64, vary: &[&str], threads: usize) -> (f64, Vec<f64>) {
    let options = WorldOptions::new(4).max_episode_steps(200).threads(threads);
    let mut world = World::new(&TABLE_PUSH, options).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..episodes).seed(3);
    let rollout = if vary.is_empty() { rollout } else { rollout.vary(vary.iter().copied()) };
    let evaluation = world.evaluate(&rollout).unwrap();
    (evaluation.success_rate, evaluation.episode_returns)
}

#[test]
fn the_expert_brings_objects_to_their_goals() {
    let (rate, _) = evaluate("expert", 300, &[], 2);
    assert!(rate >= 95.0, "{rate}");
    let (rate, _) = evaluate("expert", 100, &["all"], 2);
    assert!(rate >= 85.0, "with all factors varied: {rate}");
    let (rate, _) = evaluate("noisy-expert", 60, &[], 2);
    assert!(rate >= 80.0, "with noise: {rate}");
    let (rate, _) = evaluate("random", 60, &[], 2);
    assert!(rate < 20.0, "at random: {rate}");
}

#[test]
fn threads_do_not_change_a_bit() {
    assert_eq!(evaluate("expert", 12, &["all"], 1), evaluate("expert", 12, &["all"], 3));
}

/// The state after `steps` steps of full speed along x, from a pusher on the left of an object in the middle.
fn pushed(factors: &[(&str, f64)], steps: usize) -> State {
    let mut env = FactorEnv::<TablePush>::new(&EnvConfig::default()).unwrap();
    let mut options = ResetOptions::default()
        .vary(["none"])
        .set("pusher.position", Value::vector(&[-0.1, 0.0]))
        .set("goal.position", Value::vector(&[0.0, 0.25]));
    for (name, value) in factors {
        options = options.set(name, Value::scalar(*value));
    }
    env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
    for _ in 0..steps {
        env.step(Slice::F32(&[1.0, 0.0])).unwrap();
    }
    env.state().state
}

#[test]
fn a_push_moves_the_object_as_its_factors_say() {
    let plain = pushed(&[], 12);
    assert!(plain.position[0] > 0.02 && plain.position[1].abs() < 0.01, "{plain:?}");
    // In contact, upright, on the table: the face of the box lies at the surface of the pusher.
    let gap = plain.position[0] - plain.pusher[0] - 0.06;
    assert!((-2e-3..0.02).contains(&gap) && (plain.position[2] - 0.024).abs() < 2e-3, "{plain:?}");
    // A heavy object on a rough table slows a weak motor; a bouncing one runs ahead; speed and radius show at once.
    let heavy =
        [("object.mass", 0.4), ("table.friction", 1.0), ("object.friction", 1.0), ("pusher.force", 4.0)];
    assert!(pushed(&heavy, 12).position[0] < plain.position[0] - 1e-3);
    let fastest = |restitution: f64| {
        let speeds = (1..8).map(|steps| pushed(&[("object.restitution", restitution)], steps).velocity[0]);
        speeds.fold(0.0, f64::max)
    };
    let [dull, bouncing] = [fastest(0.0), fastest(0.8)];
    assert!(bouncing > dull + 0.05, "{bouncing} m/s is hardly more than {dull}");
    assert!(pushed(&[("pusher.speed", 0.6)], 12).position[0] > plain.position[0] + 0.02);
    assert!(pushed(&[("pusher.radius", 0.03)], 12).position[0] > plain.position[0] + 5e-3);
}

#[test]
fn objects_slide_to_rest_and_fall_off_the_edge() {
    let mut env = FactorEnv::<TablePush>::new(&EnvConfig::default()).unwrap();
    let mut state = State::at_rest([0.0, 0.0, 0.024], 0.0, [-0.4, -0.4]);
    state.velocity[0] = 0.5;
    let mut run = |state: State, steps: usize| {
        let start = Some([("state".to_owned(), Value::vector(&state.to_row()))].into());
        let goal = State::at_rest([-0.2, 0.2, 0.024], 0.0, [0.0, 0.0]);
        let goal = Some([("state".to_owned(), Value::vector(&goal.to_row()))].into());
        let options = ResetOptions { start, goal, ..ResetOptions::default() }.vary(["none"]);
        env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
        let mut ended = false;
        for _ in 0..steps {
            ended |= env.step(Slice::F32(&[0.0, 0.0])).unwrap().terminated;
        }
        (env.state().state, ended)
    };
    // v² / (2 μ g) with μ 0.5 and g 9.81: 2.5 cm.
    let (stopped, ended) = run(state, 30);
    assert!(
        stopped.velocity == [0.0; 3] && (stopped.position[0] - 0.0255).abs() < 6e-3 && !ended,
        "{stopped:?}"
    );
    state.position[0] = 0.46;
    state.velocity[0] = 1.5;
    let (fallen, ended) = run(state, 30);
    assert!(fallen.position[2] < -0.05 && ended, "{fallen:?}");
}

#[test]
fn every_row_of_an_episode_starts_one() {
    let mut env = FactorEnv::<TablePush>::new(&EnvConfig::default()).unwrap();
    let pushed = pushed(&[], 12);
    for goal in [[0.0, 0.0], [0.2, 0.1]] {
        let state = State { position: [goal[0], goal[1], 0.024], ..pushed };
        let start = Some([("state".to_owned(), Value::vector(&state.to_row()))].into());
        let options = ResetOptions { start, ..ResetOptions::default() }.vary(["none"]);
        env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
        assert_eq!(env.state().state, state);
    }
}

#[test]
fn wrong_settings_starts_and_actions_are_refused() {
    let settings = json!({"time_limit": -1});
    let config = EnvConfig { settings: settings.as_object().unwrap().clone(), ..EnvConfig::default() };
    assert!(TABLE_PUSH.make(&config).is_err());
    let mut env = FactorEnv::<TablePush>::new(&EnvConfig::default()).unwrap();
    let mut message = |options: &ResetOptions| {
        env.reset(&Episode::new(EpisodeSeed::new(1), options)).unwrap_err().to_string()
    };
    let row = [("state".to_owned(), Value::vector(&[0.0; 17]))];
    let start = ResetOptions { start: Some(row.into()), ..ResetOptions::default() };
    assert!(message(&start).contains("no unit quaternion"));
    let near = ResetOptions::default().vary(["none"]).set("pusher.position", Value::vector(&[0.05, 0.0]));
    assert!(message(&near).contains("clear of the object"));
    let close = ResetOptions::default().vary(["none"]).set("goal.position", Value::vector(&[0.05, 0.0]));
    assert!(message(&close).contains("at least 0.1 m from object.position"));
    assert!(env.step(Slice::F32(&[f32::NAN, 0.0])).is_err());
}
