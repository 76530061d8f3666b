//! What Meta-World promises beyond conformance: recorded episodes of metaworld 3.1.1 replayed, rewards, experts, factors that
//! act on physics at their ends, the time limit.

use std::fs::File;
use std::path::PathBuf;

use ndarray::{Array1, Array2};
use ndarray_npy::{NpzReader, ReadNpzError, ReadableElement};
use serde_json::json;
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, Episode, EpisodeSeed, Evaluation, Registry, ResetOptions, Rollout,
    Schema, Slice, Value, World, WorldOptions,
};
use swm_envs_mujoco::ENVS;

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

    fn step(&mut self, action: [f32; 4]) -> swm_core::Outcome {
        let outcome = self.env.step(Slice::F32(&action)).expect("the action is finite");
        self.env.observe(&mut self.row.rows_mut());
        outcome
    }

    fn values(&self, column: &str) -> Vec<f64> {
        self.row.get::<f64>(column).expect("a column").to_vec()
    }
}

/// The ten environments, with the names of their tasks in the package.
fn tasks() -> Vec<(&'static EnvEntry, &'static str)> {
    let ours = ENVS.iter().filter(|entry| entry.id.starts_with("swm/MetaWorld"));
    let name = |alias: &'static str| alias.trim_start_matches("swm/MetaWorld-").trim_end_matches("-v0");
    let tasks: Vec<_> = ours.map(|entry| (entry, name(entry.aliases[0]))).collect();
    assert_eq!(tasks.len(), 10);
    tasks
}

/// An episode of the package: the arrays are those of `tests/golden/README.md`.
struct Recorded {
    npz: NpzReader<File>,
    seed: usize,
}

impl Recorded {
    fn of(task: &str, seed: usize) -> Self {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../../tests/golden/metaworld/{task}.npz"));
        Self { npz: NpzReader::new(File::open(path).expect("it is committed")).expect("an archive"), seed }
    }

    fn table<T: ReadableElement>(&mut self, name: &str) -> Array2<T> {
        self.npz.by_name(&format!("{}/{name}", self.seed)).expect("an array")
    }

    fn vector(&mut self, name: &str) -> Vec<f64> {
        let array: Result<Array1<f64>, ReadNpzError> = self.npz.by_name(&format!("{}/{name}", self.seed));
        array.expect("an array").to_vec()
    }
}

const STATE: [&str; 7] = ["qpos", "qvel", "qacc_warmstart", "mocap_pos", "mocap_quat", "ctrl", "time"];
const PARTS: [&str; 5] = ["near_object", "grasp_success", "grasp_reward", "in_place_reward", "obj_to_target"];

/// How far a part of a reward may be off: NumPy's square is that of `pow`, which rounds otherwise once in thousands of steps.
const PART: f64 = 1e-16;
/// How far rewards of window-close may be off: NumPy's exponential is not that of the system.
const EXPONENTIAL: f64 = 4e-15;

/// The factors that put everything where a random vector of the package does.
fn placed(bench: &Bench, vector: &[f64]) -> ResetOptions {
    let mut options = ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() };
    options.variation_values.insert("object.position".to_owned(), Value::vector(&vector[..2]));
    if let Some(goal) = bench.env.spec().factors.iter().find(|factor| factor.name == "goal.position") {
        let dim = goal.space.shape()[0];
        options.variation_values.insert("goal.position".to_owned(), Value::vector(&vector[3..3 + dim]));
    }
    options
}

#[test]
fn recorded_episodes_are_replayed_to_the_bit() {
    for (entry, name) in tasks() {
        let mut bench = Bench::new(entry, &json!({}));
        let (mut reward_off, mut part_off) = (0.0_f64, 0.0_f64);
        for seed in 0..3 {
            let mut recorded = Recorded::of(name, seed);
            let options = placed(&bench, &recorded.vector("rand_vec"));
            bench.reset(1, &options);
            assert_eq!(bench.values("desired_goal"), recorded.vector("target"), "{name} {seed}");
            let (observed, states) = (recorded.table::<f64>("observed"), recorded.table::<f64>("state"));
            let (actions, worths) = (recorded.table::<f32>("actions"), recorded.table::<f64>("worth"));
            let every = actions.nrows() / (states.nrows() - 1);
            for step in 0..=actions.nrows() {
                let place = format!("{name}, seed {seed}, row {step}");
                let row = bench.values("observation");
                assert_eq!(row[..11], observed.row(step).to_vec(), "{place}");
                assert_eq!(row[18..29], observed.row(step.saturating_sub(1)).to_vec(), "{place}");
                if step % every == 0 {
                    let state: Vec<f64> = STATE.iter().flat_map(|column| bench.values(column)).collect();
                    assert_eq!(state, states.row(step / every).to_vec(), "{place}");
                }
                if step == actions.nrows() {
                    break;
                }
                let outcome = bench.step(std::array::from_fn(|k| actions[[step, k]]));
                let worth = worths.row(step);
                assert_eq!(outcome.success, Some(worth[1] == 1.0), "{place}");
                reward_off = reward_off.max((outcome.reward - worth[0]).abs());
                for (k, part) in PARTS.iter().enumerate() {
                    let off = (bench.values(part)[0] - worth[2 + k]).abs();
                    let is_exponential = *part == "grasp_reward" && name == "window-close";
                    assert!(
                        off <= if is_exponential { EXPONENTIAL } else { PART },
                        "{place}: {part} by {off:e}"
                    );
                    part_off = part_off.max(off);
                }
            }
        }
        println!("{name}: rewards differ by up to {reward_off:e}, their parts by {part_off:e}");
        assert!(
            reward_off <= if name == "window-close" { EXPONENTIAL } else { 0.0 },
            "{name}: {reward_off:e}"
        );
    }
}

fn evaluate(
    entry: &'static EnvEntry,
    policy: &str,
    episodes: u64,
    (seed, options): (u64, ResetOptions),
) -> Evaluation {
    let mut world = World::new(entry, WorldOptions::new(2).max_episode_steps(350)).expect("it was set up");
    world.set_policy(Registry::new().policy(policy, &world).expect("one")).expect("it begins");
    let rollout = Rollout::new(0..episodes).seed(seed).options(options);
    let evaluation = world.evaluate(&rollout).expect("it runs");
    let slowest = evaluation.first_success_steps.iter().max();
    println!("{} {policy}: {} % of {episodes}, {slowest:?} steps", entry.id, evaluation.success_rate);
    evaluation
}

#[test]
fn experts_solve_every_task() {
    for (entry, _) in tasks() {
        let rate = evaluate(entry, "expert", 50, (7, ResetOptions::default())).success_rate;
        assert!(rate >= 98.0, "{}: {rate}", entry.id);
    }
}

#[test]
fn experts_hold_at_the_ends_of_every_factor_that_physics_feel() {
    let is_felt = |name: &str| {
        !["color", "texture", "light", "camera", "transparent", "position"]
            .iter()
            .any(|part| name.contains(part))
    };
    let mut failures = Vec::new();
    for (entry, _) in tasks() {
        let factors = Bench::new(entry, &json!({})).env.spec().factors.clone();
        for factor in
            factors.iter().filter(|factor| is_felt(&factor.name) || factor.name.starts_with("agent.start"))
        {
            let (low, high) = factor.space.bounds();
            for end in [low, high] {
                let values = ResetOptions::default().set(&factor.name, Value::vector(&end));
                let rate = evaluate(entry, "expert", 10, (3, values)).success_rate;
                if rate < 90.0 {
                    failures.push(format!("{} {} = {end:?}: {rate} %", entry.id, factor.name));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn settings_and_goals_do_what_they_name() {
    let entry = &swm_envs_mujoco::metaworld::DRAWER_CLOSE;
    let mut bench = Bench::new(entry, &json!({"time_limit": 3, "goal_observable": false}));
    bench.reset(1, &ResetOptions::default());
    assert_eq!(bench.values("observation")[36..], [0.0; 3]);
    let steps = (0..9).take_while(|_| {
        bench.step([0.0; 4]);
        !bench.env.is_truncated()
    });
    assert_eq!(steps.count() + 1, 3);
    // Where it is now is reached at once.
    let mut bench = Bench::new(entry, &json!({"terminate_on_success": true}));
    bench.reset(1, &ResetOptions::default());
    assert!(!bench.step([0.0; 4]).terminated);
    let row = |name: &str, values: &[f64]| Some([(name.to_owned(), Value::vector(values))].into());
    let goal = row("achieved_goal", &bench.values("achieved_goal"));
    bench.reset(1, &ResetOptions { goal: goal.clone(), ..ResetOptions::default() });
    assert_eq!(
        Some(bench.values("desired_goal")),
        goal.map(|goal| goal["achieved_goal"].to_f64s("goal").unwrap())
    );
    let outcome = bench.step([0.0; 4]);
    assert!(outcome.terminated && outcome.reward == 10.0, "{outcome:?}");
    let mut refused = |words: &str, options: ResetOptions| {
        let message = bench.env.reset(&Episode::new(EpisodeSeed::new(3), &options)).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    let none = ResetOptions::default;
    refused("`qvel` is no goal", ResetOptions { goal: row("qvel", &[0.0; 10]), ..none() });
    refused("needs the column `achieved_goal`", ResetOptions { goal: row("qpos", &[0.0; 10]), ..none() });
    refused("needs the column `qpos`", ResetOptions { start: row("qvel", &[0.0; 10]), ..none() });
}

#[test]
fn experts_bear_noise() {
    for (entry, _) in tasks() {
        let rate = evaluate(entry, "noisy-expert:0.1", 10, (5, ResetOptions::default())).success_rate;
        assert!(rate >= 80.0, "{}: {rate}", entry.id);
    }
}
