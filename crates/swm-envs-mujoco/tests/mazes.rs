//! What OGBench's mazes promise beyond conformance: the reference's steps, experts, tasks, goals from rows, teleporters. That steps
//! of the humanoid and of AntSoccer are the reference's is checked by their golden trajectories (`cargo xtask golden`).

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::json;
use swm_core::testing::assert_conforms_with;
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, Episode, EpisodeSeed, Evaluation, ImageSize, Registry, ResetOptions,
    Rollout, Schema, Slice, Value, World, WorldOptions,
};
use swm_envs_mujoco::{OGB_ANT_MAZE, OGB_ANT_SOCCER, OGB_HUMANOID_MAZE, OGB_POINT_MAZE};

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
        env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
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
    world.set_policy(Registry::new().policy("expert", &world).expect("one")).expect("it begins");
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

/// How much nearer to its goal the ball is after `steps` steps of a policy, m, by episode.
fn ball_progress(policy: &str, episodes: u64, steps: u64) -> Vec<f64> {
    let options = WorldOptions::new(episodes as usize)
        .max_episode_steps(steps)
        .env(config(&json!({"terminate_at_goal": false})));
    let mut world = World::new(&OGB_ANT_SOCCER, options).expect("it was set up");
    world.set_policy(Registry::new().policy(policy, &world).expect("one")).expect("it begins");
    world.reset(7, &ResetOptions::default()).expect("a start");
    let left = |world: &World| -> Vec<f64> {
        let infos = world.infos();
        let (ball, goal) = (
            infos.get::<f64>("ball_xy").expect("it has a ball"),
            infos.get::<f64>("goal_xy").expect("and a goal"),
        );
        ball.chunks(2).zip(goal.chunks(2)).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).collect()
    };
    let before = left(&world);
    (0..steps - 1).for_each(|_| world.step().expect("it steps"));
    before.iter().zip(left(&world)).map(|(before, after)| before - after).collect()
}

#[test]
fn the_weak_policy_takes_the_ball_towards_its_goal() {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (weak, random) = (ball_progress("weak", 8, 600), ball_progress("random", 8, 600));
    assert!(mean(&weak) > 1.0, "{weak:?}");
    assert!(mean(&random).abs() < 0.5, "{random:?}");
}

#[test]
fn mazes_in_other_settings_conform() {
    let image = Some(ImageSize { height: 48, width: 48 });
    for (entry, settings) in [
        (&OGB_POINT_MAZE, json!({"maze_type": "teleport", "terminate_at_goal": false})),
        (&OGB_POINT_MAZE, json!({"maze_type": "medium", "mode": "task", "camera": "top"})),
        (&OGB_HUMANOID_MAZE, json!({"maze_type": "teleport", "camera": "egocentric"})),
        (&OGB_ANT_SOCCER, json!({"maze_type": "medium", "mode": "task", "task": 2, "camera": "top"})),
    ] {
        let settings = settings.as_object().cloned().expect("settings");
        assert_conforms_with(entry, &EnvConfig { image, settings }, &[]);
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
        env.reset(&Episode::new(EpisodeSeed::new(seed), &options)).unwrap();
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

/// An environment with a row.
struct Bench {
    env: Box<dyn Env>,
    row: Batch,
}

impl Bench {
    fn new(entry: &EnvEntry, settings: &serde_json::Value) -> Self {
        let env = entry.make(&config(settings)).expect("it was set up");
        let row = Batch::new(Schema::new(env.spec().fields.clone()).expect("distinct names"), 1);
        Self { env, row }
    }

    fn reset(&mut self, seed: u64, options: &ResetOptions) {
        self.env.reset(&Episode::new(EpisodeSeed::new(seed), options)).expect("valid options");
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
    }

    fn values(&self, column: &str) -> Vec<f64> {
        self.row.get::<f64>(column).expect("a column").to_vec()
    }
}

fn cell(place: &[f64]) -> [i64; 2] {
    [place[1], place[0]].map(|along| ((along + 6.0) / 4.0) as i64)
}

#[test]
fn tasks_of_ant_soccer_place_ant_ball_and_goal() {
    for (maze, task, cells) in [
        ("arena", 1, [[1, 6], [2, 3], [5, 2]]),
        ("arena", 4, [[6, 6], [1, 1], [6, 1]]),
        ("medium", 3, [[5, 3], [4, 2], [6, 5]]),
    ] {
        let settings = json!({"maze_type": maze, "mode": "task", "task": task});
        let mut bench = Bench::new(&OGB_ANT_SOCCER, &settings);
        bench.reset(3, &ResetOptions::default());
        let found = ["xy", "ball_xy", "goal_xy"].map(|column| cell(&bench.values(column)));
        assert_eq!(found, cells, "{maze} {task}");
        assert_eq!(bench.row.get::<i64>("task_id").unwrap(), [task]);
        let (qpos, goal) = (bench.values("qpos"), bench.values("goal_observation"));
        assert_eq!(bench.values("ball_xy"), qpos[15..17]);
        // In the goal's observation both are there.
        assert_eq!((&goal[..2], &goal[15..17]), (&bench.values("goal_xy")[..], &bench.values("goal_xy")[..]));
        let outcome = bench.env.step(Slice::F32(&[0.0; 8])).unwrap();
        assert_eq!((outcome.reward, outcome.terminated, outcome.success), (-1.0, false, Some(false)));
    }
}

#[test]
fn the_ball_counts_and_not_the_ant() {
    let mut bench = Bench::new(&OGB_ANT_SOCCER, &json!({}));
    bench.reset(0, &ResetOptions::default());
    let (mut start, qvel) = (bench.values("qpos"), vec![0.0; 20]);
    start[15..17].copy_from_slice(&[8.0, 8.0]);
    start[17] = 0.25;
    let mut goal = start.clone();
    let mut success_at = |ball: f64| {
        goal[15] = ball;
        let options = ResetOptions {
            start: row(&[("qpos", &start), ("qvel", &qvel)]),
            goal: row(&[("qpos", &goal)]),
            ..ResetOptions::default()
        };
        bench.reset(0, &options);
        assert_eq!(bench.values("goal_xy"), [ball, 8.0]);
        let outcome = bench.env.step(Slice::F32(&[0.0; 8])).unwrap();
        assert_eq!(outcome.terminated, outcome.reward == 1.0);
        outcome.success
    };
    assert_eq!(success_at(8.4), Some(true));
    // The ant still stands where it did in the goal.
    assert_eq!(success_at(8.6), Some(false));
}

#[test]
fn the_humanoid_starts_untouched_and_observes_its_place() {
    let mut bench = Bench::new(&OGB_HUMANOID_MAZE, &json!({"maze_type": "medium"}));
    let mut postures = Vec::new();
    for seed in 0..4 {
        bench.reset(seed, &ResetOptions::default());
        let (qpos, observation) = (bench.values("qpos"), bench.values("observation"));
        assert_eq!(qpos[2], 1.5);
        assert_eq!(observation[..2], qpos[..2]);
        assert_eq!(observation[2..23], qpos[7..]);
        assert_eq!(observation[42..], bench.values("qvel"));
        assert_eq!(bench.values("goal_observation")[..2], bench.values("goal_xy"));
        postures.push(qpos);
    }
    assert!(postures.windows(2).all(|pair| pair[0][7..] != pair[1][7..]));
    // The teleporters of the point and the ant are there too.
    Bench::new(&OGB_HUMANOID_MAZE, &json!({"maze_type": "teleport"})).reset(0, &ResetOptions::default());
}

#[test]
fn wrong_settings_and_goals_are_told() {
    let message = |settings: serde_json::Value| {
        OGB_ANT_MAZE.make(&config(&settings)).err().expect("refused").to_string()
    };
    assert!(message(json!({"maze_type": "huge"})).contains("huge"));
    assert!(message(json!({"mode": "task", "task": 6})).contains("1 to 5"));
    assert!(message(json!({"maze": "large"})).contains("maze_type"));
    let soccer = OGB_ANT_SOCCER.make(&config(&json!({"maze_type": "large"}))).err().expect("refused");
    assert!(soccer.to_string().contains("`arena` and `medium`"), "{soccer}");
    let mut env = OGB_ANT_MAZE.make(&EnvConfig::default()).unwrap();
    let options = ResetOptions { goal: row(&[("qvel", &[0.0; 14])]), ..ResetOptions::default() };
    let error = env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap_err();
    assert!(error.to_string().contains("`qvel` is no goal"), "{error}");
}
