//! What Fetch promises beyond conformance: rewards, restarts from rows, goals, the time limit, experts. That steps are the
//! reference's is checked by its golden trajectories (`cargo xtask golden`).

use std::collections::BTreeMap;

use serde_json::json;
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, Episode, EpisodeSeed, Evaluation, Registry, ResetOptions, Rollout,
    Schema, Slice, Value, World, WorldOptions,
};
use swm_envs_mujoco::{
    FETCH_PICK_AND_PLACE, FETCH_PICK_AND_PLACE_DENSE, FETCH_PICK_AND_PLACE_DICT, FETCH_PUSH, FETCH_REACH,
    FETCH_SLIDE,
};

struct Bench {
    env: Box<dyn Env>,
    row: Batch,
}

impl Bench {
    fn new(entry: &EnvEntry, settings: &serde_json::Value) -> Self {
        let settings = settings.as_object().cloned().unwrap_or_default();
        let env = entry.make(&EnvConfig { image: None, settings }).expect("settings are valid");
        let row = Batch::new(Schema::new(env.spec().fields.clone()).expect("fields differ in name"), 1);
        Self { env, row }
    }

    fn reset(&mut self, seed: u64, options: &ResetOptions) {
        self.env.reset(&Episode::new(EpisodeSeed::new(seed), options)).expect("options are valid");
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
    }

    fn step(&mut self, action: [f32; 4]) -> f64 {
        let reward = self.env.step(Slice::F32(&action)).expect("the action is finite").reward;
        self.env.observe(&mut self.row.rows_mut());
        reward
    }

    fn values(&self, column: &str) -> Vec<f64> {
        self.row.get::<f64>(column).expect("a column").to_vec()
    }

    fn columns(&self, names: &[&str]) -> BTreeMap<String, Value> {
        names.iter().map(|name| ((*name).to_owned(), Value::vector(&self.values(name)))).collect()
    }
}

/// Some action of step `t`.
fn swing(t: u32) -> [f32; 4] {
    let phase = f64::from(t);
    [(phase * 0.9).sin(), (phase * 0.7).cos(), -(phase * 0.5).sin(), (phase * 0.4).sin()].map(|v| v as f32)
}

#[test]
fn rewards_and_observations_follow_from_the_goal() {
    let variants = [&FETCH_PICK_AND_PLACE, &FETCH_PICK_AND_PLACE_DENSE, &FETCH_PICK_AND_PLACE_DICT];
    let mut benches = variants.map(|entry| Bench::new(entry, &json!({})));
    benches.iter_mut().for_each(|bench| bench.reset(4, &ResetOptions::default()));
    for t in 0..12 {
        let [sparse, dense, dict] = benches.each_mut().map(|bench| bench.step(swing(t)));
        let [flat, _, parts] = &benches;
        let (achieved, desired) = (flat.values("achieved_goal"), flat.values("desired_goal"));
        let distance = achieved.iter().zip(&desired).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert_eq!(dense, -distance);
        assert_eq!([sparse, dict], [if distance > 0.05 { -1.0 } else { 0.0 }; 2]);
        let proprio = flat.values("proprio");
        assert_eq!(parts.values("observation"), proprio);
        assert_eq!(proprio[3..6], achieved);
        let expected: Vec<f32> = proprio.iter().chain(&desired).map(|value| *value as f32).collect();
        assert_eq!(flat.row.get::<f32>("observation").unwrap(), expected);
        assert_eq!(flat.row.get::<f32>("state").unwrap(), expected);
    }
}

#[test]
fn a_recorded_row_is_a_start() {
    for entry in [&FETCH_REACH, &FETCH_PUSH, &FETCH_SLIDE, &FETCH_PICK_AND_PLACE] {
        let mut first = Bench::new(entry, &json!({}));
        first.reset(7, &ResetOptions::default());
        (0..8).for_each(|t| {
            first.step(swing(t));
        });
        let start = first.columns(first.env.spec().start_columns);
        let mut second = Bench::new(entry, &json!({}));
        let colors = ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() };
        second.reset(99, &ResetOptions { start: Some(start), ..colors });
        for t in 8..16 {
            assert_eq!(first.step(swing(t)), second.step(swing(t)));
            for column in ["qpos", "qvel", "qacc_warmstart", "proprio", "desired_goal"] {
                assert_eq!(first.values(column), second.values(column), "{}: {column}, step {t}", entry.id);
            }
        }
    }
}

#[test]
fn a_recorded_row_is_a_goal() {
    let mut bench = Bench::new(&FETCH_PUSH, &json!({}));
    bench.reset(1, &ResetOptions::default());
    let goal = bench.columns(&["achieved_goal", "qpos"]);
    bench.reset(2, &ResetOptions { goal: Some(goal.clone()), ..ResetOptions::default() });
    assert_eq!(Value::vector(&bench.values("desired_goal")), goal["achieved_goal"]);
    let mut refused = |name: &str, options: ResetOptions| {
        let episode = Episode::new(EpisodeSeed::new(3), &options);
        let message = bench.env.reset(&episode).unwrap_err().to_string();
        assert!(message.contains(name), "{message}");
    };
    let row = |name: &str, values: &[f64]| Some(BTreeMap::from([(name.to_owned(), Value::vector(values))]));
    let options = ResetOptions::default;
    refused("`achieved_goal`", ResetOptions { goal: row("qpos", &[0.0; 22]), ..options() });
    refused("`qvel` is no goal", ResetOptions { goal: row("qvel", &[0.0; 21]), ..options() });
    refused("needs the column `qpos`", ResetOptions { start: row("qvel", &[0.0; 21]), ..options() });
    refused("achieved_goal", ResetOptions { goal: row("achieved_goal", &[0.0; 2]), ..options() });
}

#[test]
fn episodes_are_cut_off_after_their_time() {
    for (settings, expected) in
        [(json!({}), Some(50)), (json!({"time_limit": 3}), Some(3)), (json!({"time_limit": 0}), None)]
    {
        let mut bench = Bench::new(&FETCH_REACH, &settings);
        bench.reset(1, &ResetOptions::default());
        let mut steps = (0..60).take_while(|&t| {
            bench.step(swing(t));
            !bench.env.is_truncated()
        });
        let last = steps.by_ref().count() + 1;
        assert_eq!((last <= 60).then_some(last), expected, "{settings}");
    }
    let message = FETCH_REACH
        .make(&EnvConfig { image: None, settings: json!({"reward": "dense"}).as_object().cloned().unwrap() })
        .err()
        .expect("refused")
        .to_string();
    assert!(message.contains("setting `reward`: unknown") && message.contains("time_limit"), "{message}");
}

fn evaluate(entry: &'static EnvEntry, policy: &str, episodes: u64, vary: &[&str]) -> Evaluation {
    let mut world = World::new(entry, WorldOptions::new(4).max_episode_steps(50)).expect("it was set up");
    world.set_policy(Registry::new().policy(policy, &world).expect("one")).expect("it begins");
    let rollout = Rollout::new(0..episodes).seed(7);
    let rollout = if vary.is_empty() { rollout } else { rollout.vary(vary.iter().copied()) };
    let evaluation = world.evaluate(&rollout).expect("it runs");
    println!("{} {policy} {vary:?}: {} % of {episodes}", entry.id, evaluation.success_rate);
    evaluation
}

#[test]
fn experts_reach_push_and_place() {
    for entry in [&FETCH_REACH, &FETCH_PUSH, &FETCH_PICK_AND_PLACE] {
        assert!(evaluate(entry, "expert", 40, &[]).success_rate >= 95.0, "{}", entry.id);
        assert!(evaluate(entry, "random", 40, &[]).success_rate <= 25.0, "{}", entry.id);
    }
}

#[test]
fn the_expert_of_slide_plans_its_strike() {
    assert!(evaluate(&FETCH_SLIDE, "expert", 8, &[]).success_rate >= 70.0);
}
