//! What Piecewise promises beyond conformance. That steps and images are the reference's is checked by its golden trajectories.

use serde_json::json;
use swm_core::testing::assert_conforms_with;
use swm_core::{
    Env as _, EnvConfig, Episode, EpisodeSeed, Registry, ResetOptions, Rollout, Slice, Value, World,
    WorldOptions,
};
use swm_fov::FactorEnv;

use super::{PIECEWISE, Piecewise};

fn config(settings: &serde_json::Value) -> EnvConfig {
    EnvConfig { image: None, settings: settings.as_object().cloned().unwrap_or_default() }
}

fn success(policy: &str, settings: &serde_json::Value, vary: &[&str]) -> f64 {
    let options = WorldOptions::new(8).max_episode_steps(150).env(config(settings));
    let mut world = World::new(&PIECEWISE, options).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..60).seed(3);
    let rollout = if vary.is_empty() { rollout } else { rollout.vary(vary.iter().copied()) };
    world.evaluate(&rollout).unwrap().success_rate
}

#[test]
fn the_expert_walks_against_every_push() {
    for settings in [json!({}), json!({"grid_n": 1}), json!({"grid_n": 5})] {
        assert_eq!(success("expert", &settings, &[]), 100.0, "{settings}");
    }
    assert!(success("random", &json!({}), &[]) < 50.0);
    assert!(success("noisy-expert:1", &json!({}), &[]) > 90.0);
}

#[test]
fn other_grids_conform() {
    let hidden = ["background.color", "border.color", "agent.color", "target.color", "target.radius"];
    let rendering = ["rendering.render_target", "rendering.render_zones", "rendering.render_bias_field"];
    let colors: Vec<String> = (0..9).map(|zone| format!("zones.color_{zone}")).collect();
    let only_in_images: Vec<&str> =
        hidden.into_iter().chain(rendering).chain(colors.iter().map(String::as_str)).collect();
    assert_conforms_with(&PIECEWISE, &config(&json!({"grid_n": 3})), &only_in_images);
}

#[test]
fn wrong_settings_and_starts_are_refused() {
    let message = PIECEWISE.make(&config(&json!({"grid_n": 20}))).err().unwrap().to_string();
    assert!(message.contains("grid_n 20"), "{message}");
    let mut env = FactorEnv::<Piecewise>::new(&EnvConfig::default()).unwrap();
    let row = [("state".to_owned(), Value::vector(&[300.0_f32, 20.0]))];
    let options = ResetOptions { start: Some(row.into()), ..ResetOptions::default() };
    let message = env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap_err().to_string();
    assert!(message.contains("`state`") && message.contains("224"), "{message}");
    assert!(env.step(Slice::F32(&[f32::NAN, 0.0])).is_err());
}

#[test]
fn a_target_is_as_far_as_the_task_asks() {
    let mut env = FactorEnv::<Piecewise>::new(&EnvConfig::default()).unwrap();
    for seed in 0..20 {
        let options = ResetOptions::default()
            .vary(["agent.position", "target.position"])
            .set("task.min_steps", Value::scalar(20_i64));
        env.reset(&Episode::new(EpisodeSeed::new(seed), &options)).unwrap();
        assert!(env.task_cost().unwrap() >= 100.0, "seed {seed}");
    }
}
