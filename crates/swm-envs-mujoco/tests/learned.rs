//! `learned-expert`: every one acts far better than chance, and says what it is not for.

use serde_json::json;
use swm_core::{EnvConfig, EnvEntry, PolicyContext, Registry, Rollout, World, WorldOptions};
use swm_envs_mujoco::{CHEETAH, ENVS};

/// A return that each reaches, and the task where it is not the first; chance is at most half of it.
const LEAST_RETURNS: &[(&str, Option<&str>, f64)] = &[
    ("swm/BallInCupDMControl-v0", None, 900.0),
    ("swm/CartpoleDMControl-v0", Some("swingup"), 750.0),
    ("swm/CheetahDMControl-v0", None, 500.0),
    ("swm/PendulumDMControl-v0", None, 700.0),
    ("swm/ReacherDMControl-v0", None, 900.0),
    ("swm/WalkerDMControl-v0", None, 900.0),
];

fn policy_of(entry: &'static EnvEntry, policy: &str, settings: &serde_json::Value) -> Result<String, String> {
    let config = EnvConfig { image: None, settings: settings.as_object().cloned().unwrap_or_default() };
    let made = Registry::new().policy(policy, PolicyContext::new(entry, &config));
    made.map(|policy| policy.describe()).map_err(|error| error.to_string())
}

#[test]
fn every_one_solves_its_task() {
    let learned: Vec<_> = ENVS
        .iter()
        .filter(|entry| entry.policies.iter().any(|policy| policy.name == "learned-expert"))
        .collect();
    assert_eq!(learned.len(), LEAST_RETURNS.len(), "a least return for every expert");
    for (id, task, least) in LEAST_RETURNS {
        let entry = ENVS.iter().find(|entry| entry.id == *id).expect("a known environment");
        let settings = task.map(|task| ("task".to_owned(), json!(task))).into_iter().collect();
        let options = WorldOptions::new(3).env(EnvConfig { image: None, settings }).max_episode_steps(500);
        let mut world = World::new(entry, options).expect("it is made");
        world.set_policy(Registry::new().policy("learned-expert", &world).expect("it has one")).unwrap();
        let evaluation = world.evaluate(&Rollout::new(0..3).seed(77)).expect("it runs");
        let returns = &evaluation.episode_returns;
        let mean = returns.iter().sum::<f64>() / returns.len() as f64;
        assert!(mean > *least, "{id}: {returns:?}, of which the mean should be above {least}");
    }
}

#[test]
fn it_says_which_weights_it_has_and_takes_no_others() {
    let described = policy_of(&CHEETAH, "learned-expert", &json!({})).unwrap();
    assert!(described.starts_with("learned-expert:weights="), "{described}");
    assert_eq!(policy_of(&CHEETAH, &described, &json!({})).unwrap(), described);
    let message = policy_of(&CHEETAH, "learned-expert:weights=0123456789ab", &json!({})).unwrap_err();
    assert!(message.contains("in this version, not 0123456789ab"), "{message}");
}

#[test]
fn it_refuses_a_task_that_it_was_not_trained_for() {
    assert!(policy_of(&CHEETAH, "learned-expert", &json!({ "task": "run" })).is_ok());
    let message = policy_of(&CHEETAH, "learned-expert", &json!({ "task": "flip" })).unwrap_err();
    assert!(message.contains("trained for the task `run`, not for `flip`"), "{message}");
}
