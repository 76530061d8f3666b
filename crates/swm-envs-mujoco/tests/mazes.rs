//! What OGBench's mazes promise beyond conformance: the reference's steps, experts, tasks, goals from rows, teleporters.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::json;
use swm_core::testing::assert_conforms_with;
use swm_core::{
    Batch, EnvConfig, EnvEntry, Episode, EpisodeSeed, Evaluation, ImageSize, Registry, ResetOptions, Rollout,
    Schema, Slice, Value, World, WorldOptions,
};
use swm_envs_mujoco::{OGB_ANT_MAZE, OGB_POINT_MAZE};

fn config(settings: &serde_json::Value) -> EnvConfig {
    EnvConfig { image: None, settings: settings.as_object().cloned().unwrap_or_default() }
}

/// A run of the published package, ogbench 1.2.2 with MuJoCo 3.17.0.
#[derive(Deserialize)]
struct Recorded {
    maze: String,
    goal: [f64; 2],
    qpos: Vec<Vec<f64>>,
    qvel: Vec<Vec<f64>>,
    warmstart: Vec<f64>,
    actions: Vec<Vec<f32>>,
    success: Vec<f64>,
}

fn row(columns: &[(&str, &[f64])]) -> Option<BTreeMap<String, Value>> {
    Some(columns.iter().map(|(name, values)| ((*name).to_owned(), Value::vector(values))).collect())
}

#[test]
fn steps_are_the_references() {
    for (entry, file) in [(&OGB_POINT_MAZE, "point-large"), (&OGB_ANT_MAZE, "ant-large")] {
        let path = format!("{}/../../tests/golden/mazes/{file}.json", env!("CARGO_MANIFEST_DIR"));
        let recorded: Recorded = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let settings = json!({"maze_type": recorded.maze, "terminate_at_goal": false});
        let mut env = entry.make(&config(&settings)).unwrap();
        let mut goal = recorded.qpos[0].clone();
        goal[..2].copy_from_slice(&recorded.goal);
        let (qpos, qvel) = (&recorded.qpos[0], &recorded.qvel[0]);
        let options = ResetOptions {
            start: row(&[("qpos", qpos), ("qvel", qvel), ("qacc_warmstart", &recorded.warmstart)]),
            goal: row(&[("qpos", &goal)]),
            ..ResetOptions::default()
        };
        env.reset(&Episode { seed: EpisodeSeed::new(1), options: &options }).unwrap();
        let mut batch = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
        let mut met = 0;
        for (step, action) in recorded.actions.iter().enumerate() {
            let outcome = env.step(Slice::F32(action)).unwrap();
            env.observe(&mut batch.rows_mut());
            let off = |name: &str, expected: &[f64]| {
                let found = batch.get::<f64>(name).unwrap();
                found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            assert!(off("qpos", &recorded.qpos[step + 1]) < 1e-9, "{file}, step {step}");
            assert!(off("qvel", &recorded.qvel[step + 1]) < 1e-7, "{file}, step {step}");
            assert_eq!(outcome.success, Some(recorded.success[step] == 1.0), "{file}, step {step}");
            met += usize::from(outcome.success == Some(true));
        }
        assert!(met > 0 && met < recorded.actions.len(), "{file}: {met}");
    }
}

fn evaluate(entry: &'static EnvEntry, settings: &serde_json::Value, episodes: u64, steps: u64) -> Evaluation {
    let config = config(settings);
    let options = WorldOptions::new(4).max_episode_steps(steps).env(config.clone());
    let mut world = World::new(entry, options).expect("it was set up");
    world.set_policy(Registry::new().policy("expert", &world).expect("one"));
    let rollout = Rollout::new(0..episodes).seed(7);
    let evaluation = world.evaluate(&rollout).expect("it runs");
    println!(
        "{} {settings}: {} % of {episodes}, {:?} steps",
        entry.id, evaluation.success_rate, evaluation.mean_success_steps
    );
    evaluation
}

#[test]
fn the_point_finds_every_goal() {
    for maze in ["arena", "medium", "large", "giant", "teleport"] {
        let found = evaluate(&OGB_POINT_MAZE, &json!({"maze_type": maze}), 20, 1000);
        assert_eq!(found.success_rate, 100.0, "{maze}");
    }
    for task in 1..=5 {
        let settings = json!({"maze_type": "giant", "mode": "task", "task": task});
        assert_eq!(evaluate(&OGB_POINT_MAZE, &settings, 3, 1000).success_rate, 100.0, "task {task}");
    }
}

#[test]
fn the_ant_walks_to_its_goal() {
    let found = evaluate(&OGB_ANT_MAZE, &json!({"maze_type": "medium"}), 8, 1000);
    assert!(found.success_rate >= 75.0, "{} %", found.success_rate);
}

#[test]
fn mazes_in_other_settings_conform() {
    let image = Some(ImageSize { height: 48, width: 48 });
    for settings in [
        json!({"maze_type": "teleport", "terminate_at_goal": false}),
        json!({"maze_type": "medium", "mode": "task", "camera": "top"}),
    ] {
        let settings = settings.as_object().cloned().expect("settings");
        assert_conforms_with(&OGB_POINT_MAZE, &EnvConfig { image, settings }, &[]);
    }
}

#[test]
fn a_teleporter_leads_to_one_of_three_exits_by_chance() {
    let settings = json!({"maze_type": "teleport", "terminate_at_goal": false});
    let mut env = OGB_POINT_MAZE.make(&config(&settings)).unwrap();
    let mut outs = BTreeMap::new();
    for seed in 0..24 {
        // Cell (5, 1), from 2 m above it.
        let options = ResetOptions {
            start: row(&[("qpos", &[0.0, 14.0]), ("qvel", &[0.0, 0.0])]),
            ..ResetOptions::default()
        };
        env.reset(&Episode { seed: EpisodeSeed::new(seed), options: &options }).unwrap();
        let mut batch = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
        for _ in 0..3 {
            env.step(Slice::F32(&[0.0, 1.0])).unwrap();
        }
        env.observe(&mut batch.rows_mut());
        let place = batch.get::<f64>("xy").unwrap();
        *outs.entry([place[0].round() as i64, place[1].round() as i64]).or_insert(0) += 1;
    }
    // Columns 7, 1 and 10 of rows 1, 6 and 6.
    let places: Vec<[i64; 2]> = outs.keys().copied().collect();
    assert_eq!(places, [[0, 20], [24, 0], [36, 20]], "{outs:?}");
    assert!(outs.values().all(|&count| count > 2), "{outs:?}");
}

#[test]
fn wrong_settings_and_goals_are_told() {
    let message = |settings: serde_json::Value| {
        OGB_ANT_MAZE.make(&config(&settings)).err().expect("refused").to_string()
    };
    assert!(message(json!({"maze_type": "huge"})).contains("huge"));
    assert!(message(json!({"mode": "task", "task": 6})).contains("1 to 5"));
    assert!(message(json!({"maze": "large"})).contains("maze_type"));
    let mut env = OGB_ANT_MAZE.make(&EnvConfig::default()).unwrap();
    let options = ResetOptions { goal: row(&[("qvel", &[0.0; 14])]), ..ResetOptions::default() };
    let error = env.reset(&Episode { seed: EpisodeSeed::new(1), options: &options }).unwrap_err();
    assert!(error.to_string().contains("`qvel` is no goal"), "{error}");
}
