//! What the suite's environments promise beyond conformance: settings, starts, limits, bad input.

use std::collections::BTreeMap;

use serde_json::json;
use swm_core::{
    Batch, Env, EnvConfig, EnvState, Episode, EpisodeSeed, ImageSize, Outcome, ResetOptions, Schema, Slice,
    Value,
};
use swm_envs_mujoco::{CHEETAH, ENVS, FINGER, REACHER};

fn make(settings: &serde_json::Value) -> Result<Box<dyn Env>, String> {
    let settings = settings.as_object().cloned().unwrap_or_default();
    CHEETAH.make(&EnvConfig { image: None, settings }).map_err(|error| error.to_string())
}

fn reset(env: &mut dyn Env, seed: u64, options: &ResetOptions) -> Result<Outcome, String> {
    env.reset(&Episode::new(EpisodeSeed::new(seed), options)).map_err(|error| error.to_string())
}

fn row(env: &mut dyn Env) -> Batch {
    let mut row = Batch::new(Schema::new(env.spec().fields.clone()).expect("names are unique"), 1);
    env.write_episode(&mut row.rows_mut());
    env.observe(&mut row.rows_mut());
    row
}

/// Steps by actions that depend on the step alone.
fn step(env: &mut dyn Env, index: usize) -> Outcome {
    let action: Vec<f64> = (0..6).map(|joint| ((index * 7 + joint * 3) % 11) as f64 / 5.0 - 1.0).collect();
    env.step(Slice::F64(&action)).expect("the action is valid")
}

fn start_columns(env: &dyn Env, row: &Batch) -> BTreeMap<String, Value> {
    let column = |name: &&str| {
        let index = row.schema().index(name).expect("start columns are fields");
        let shape = &row.schema().fields()[index].shape;
        ((*name).to_owned(), Value::from_slice(shape, row.column(index)))
    };
    env.spec().start_columns.iter().map(column).collect()
}

fn fixed(name: &str, value: Value) -> ResetOptions {
    ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() }.set(name, value)
}

#[test]
fn an_episode_continues_from_a_recorded_row_with_the_same_bits() {
    let mut env = make(&json!({})).unwrap();
    reset(env.as_mut(), 3, &ResetOptions::default()).unwrap();
    for index in 0..30 {
        step(env.as_mut(), index);
    }
    let recorded = row(env.as_mut());
    let start = start_columns(env.as_ref(), &recorded);
    let mut other = make(&json!({})).unwrap();
    reset(other.as_mut(), 8, &ResetOptions { start: Some(start.clone()), ..ResetOptions::default() })
        .unwrap();
    for index in 30..60 {
        let (a, b) = (step(env.as_mut(), index), step(other.as_mut(), index));
        assert_eq!(a.reward.to_bits(), b.reward.to_bits(), "step {index}");
        let (a, b) = (row(env.as_mut()), row(other.as_mut()));
        for name in ["qpos", "qvel", "observation", "time"] {
            let index = a.schema().index(name).unwrap();
            assert_eq!(a.column(index), b.column(index), "{name}");
        }
    }
    let mut incomplete = start;
    incomplete.remove("qvel");
    let message =
        reset(other.as_mut(), 8, &ResetOptions { start: Some(incomplete), ..ResetOptions::default() })
            .unwrap_err();
    assert!(message.contains("needs the column `qvel`"), "{message}");
}

#[test]
fn factors_of_one_episode_leave_nothing_to_the_next() {
    let trajectory = |env: &mut dyn Env| {
        reset(env, 5, &ResetOptions::default()).unwrap();
        (0..20)
            .map(|index| {
                step(env, index);
                row(env)
            })
            .collect::<Vec<_>>()
    };
    let mut env = make(&json!({})).unwrap();
    let plain = trajectory(env.as_mut());
    for (name, value) in [
        ("agent.torso_density", Value::vector(&[600f32])),
        ("floor.friction", Value::vector(&[0.1f32])),
        ("agent.back_foot_locked", Value::scalar(0i64)),
    ] {
        reset(env.as_mut(), 5, &fixed(name, value)).unwrap();
        let varied: Vec<Batch> = (0..20)
            .map(|index| {
                step(env.as_mut(), index);
                row(env.as_mut())
            })
            .collect();
        let qpos = plain[0].schema().index("qpos").unwrap();
        assert_ne!(varied[19].column(qpos), plain[19].column(qpos), "{name} acts");
        assert_eq!(trajectory(env.as_mut()), plain, "{name} is undone");
    }
}

#[test]
fn a_locked_joint_stays() {
    let mut env = make(&json!({})).unwrap();
    reset(env.as_mut(), 1, &fixed("agent.back_foot_locked", Value::scalar(0i64))).unwrap();
    let qpos = env.spec().fields.iter().position(|field| field.name == "qpos").unwrap();
    let angle = |env: &mut dyn Env| match row(env).column(qpos) {
        Slice::F64(values) => values[5],
        other => panic!("{other:?}"),
    };
    let start = angle(env.as_mut());
    for index in 0..100 {
        step(env.as_mut(), index);
        assert!((angle(env.as_mut()) - start).abs() < 1e-3, "step {index}");
    }
}

#[test]
fn the_time_limit_cuts_and_never_crashes() {
    let mut env = make(&json!({})).unwrap();
    reset(env.as_mut(), 0, &ResetOptions::default()).unwrap();
    for index in 0..1250 {
        assert!(!env.is_truncated(), "step {index}");
        assert!(!step(env.as_mut(), index).terminated);
    }
    assert!(env.is_truncated());
    assert!(step(env.as_mut(), 0).reward.is_finite());
    reset(env.as_mut(), 0, &ResetOptions::default()).unwrap();
    assert!(!env.is_truncated());
}

#[test]
fn planners_see_minus_the_return_across_saved_states() {
    let mut env = make(&json!({})).unwrap();
    reset(env.as_mut(), 2, &ResetOptions::default()).unwrap();
    let mut total = 0.0;
    for index in 0..20 {
        total += step(env.as_mut(), index).reward;
    }
    let mut state = EnvState::new();
    env.snapshot(&mut state).unwrap();
    step(env.as_mut(), 20);
    env.restore(&state).unwrap();
    assert_eq!(env.task_cost(), Some(-total));
}

#[test]
fn a_simulation_that_diverges_is_an_error_or_an_end() {
    let wild = |env: &mut dyn Env| {
        let start = BTreeMap::from([
            ("qpos".to_owned(), Value::vector(&[0.0; 9])),
            ("qvel".to_owned(), Value::vector(&[1e12; 9])),
        ]);
        reset(env, 0, &ResetOptions { start: Some(start), ..ResetOptions::default() }).unwrap();
        env.step(Slice::F64(&[0.0; 6]))
    };
    let mut env = make(&json!({})).unwrap();
    let message = wild(env.as_mut()).unwrap_err().to_string();
    for part in ["swm/CheetahDMControl-v0", "diverged", "at 0.000 s", "is not finite or huge"] {
        assert!(message.contains(part), "{message}");
    }
    reset(env.as_mut(), 0, &ResetOptions::default()).unwrap();
    assert!(step(env.as_mut(), 0).reward.is_finite());
    let outcome = wild(make(&json!({"on_divergence": "end"})).unwrap().as_mut()).unwrap();
    assert_eq!(outcome, Outcome { reward: 0.0, terminated: true, success: None });
    assert!(!std::path::Path::new("MUJOCO_LOG.TXT").exists());
}

#[test]
fn every_task_rewards_within_its_range() {
    for task in [
        "run",
        "run-backward",
        "stand-front",
        "stand-back",
        "jump",
        "run-front",
        "run-back",
        "lie-down",
        "legs-up",
        "flip",
        "flip-backward",
    ] {
        let mut env = make(&json!({"task": task, "action_repeat": 1})).unwrap();
        reset(env.as_mut(), 4, &ResetOptions::default()).unwrap();
        let mut stream = EpisodeSeed::new(4).stream("actions");
        let mut reward = || {
            let action = env.spec().action.sample(&mut stream);
            env.step(action.data.as_slice()).unwrap().reward
        };
        let rewards: Vec<f64> = (0..400).map(|_| reward()).collect();
        assert!(rewards.iter().all(|reward| (0.0..=1.0).contains(reward)), "{task}: {rewards:?}");
        assert!(rewards.iter().any(|reward| *reward > 0.0), "{task} gives no reward at all");
    }
}

#[test]
fn bad_settings_and_actions_say_what_is_allowed() {
    let says = |settings: &serde_json::Value, parts: &[&str]| {
        let message = make(settings).err().unwrap();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    says(&json!({"task": "fly"}), &["fly", "run-backward", "legs-up"]);
    says(&json!({"action_repeat": 0}), &["action_repeat 0", "1 to 1000"]);
    says(&json!({"on_divergence": "ignore"}), &["ignore", "error", "end"]);
    says(&json!({"renderer": "vulkan"}), &["vulkan", "software", "gl"]);
    let mut env = make(&json!({})).unwrap();
    reset(env.as_mut(), 0, &ResetOptions::default()).unwrap();
    let bad: [&[f64]; 3] = [&[0.0; 5], &[f64::NAN; 6], &[f64::INFINITY, 0.0, 0.0, 0.0, 0.0, 0.0]];
    for action in bad {
        let message = env.step(Slice::F64(action)).unwrap_err().to_string();
        assert!(message.contains("6 finite"), "{message}");
    }
}

#[test]
fn a_spinner_slows_down_by_its_friction_and_against_its_mass() {
    let turning = BTreeMap::from([
        ("qpos".to_owned(), Value::vector(&[0.0, 0.0, 0.0])),
        ("qvel".to_owned(), Value::vector(&[0.0, 0.0, 8.0])),
    ]);
    let speed_after = |name: &str, value: f32| {
        let mut env = FINGER.make(&EnvConfig::default()).unwrap();
        let options = ResetOptions { start: Some(turning.clone()), ..fixed(name, Value::vector(&[value])) };
        reset(env.as_mut(), 0, &options).unwrap();
        // One step: the hinge is damped so much that it soon stands still whatever it weighs.
        env.step(Slice::F64(&[0.0, 0.0])).unwrap();
        let row = row(env.as_mut());
        let column = row.column(row.schema().index("qvel").unwrap());
        column.as_f64(2).unwrap()
    };
    let plain = speed_after("spinner.friction", 0.1);
    assert!(speed_after("spinner.friction", 1.0) < plain, "friction");
    assert!(speed_after("spinner.density", 1500.0) > plain, "density");
}

/// `tests/golden/suite/friction.json`: see the script beside it.
#[derive(serde::Deserialize)]
struct Slipping {
    env: String,
    friction: f32,
    action: Vec<f64>,
    steps: usize,
    start: BTreeMap<String, Vec<f64>>,
    end: BTreeMap<String, Vec<f64>>,
}

#[test]
fn friction_of_the_floor_is_the_references_to_the_bit() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/suite/friction.json");
    let cases: Vec<Slipping> =
        serde_json::from_str(&std::fs::read_to_string(path).expect("it is committed")).expect("as recorded");
    assert_eq!(cases.len(), 3);
    for case in cases {
        let entry = ENVS.iter().find(|entry| entry.id == case.env).expect("a known environment");
        let mut env = entry.make(&EnvConfig::default()).expect("it is made");
        let start = case.start.iter().map(|(name, values)| (name.clone(), Value::vector(values)));
        let options = ResetOptions {
            start: Some(start.collect()),
            ..fixed("floor.friction", Value::vector(&[case.friction]))
        };
        reset(env.as_mut(), 3, &options).expect("a start of the reference");
        for _ in 0..case.steps {
            env.step(Slice::F64(&case.action)).expect("the action is valid");
        }
        let row = row(env.as_mut());
        for (name, expected) in &case.end {
            assert_eq!(row.get::<f64>(name).expect("a column"), expected, "{}: {name}", case.env);
        }
    }
}

#[test]
fn a_goal_of_angles_is_shown_and_leaves_the_episode_as_it_is() {
    let make = |image| {
        let settings = json!({ "task": "qpos_match" }).as_object().cloned().unwrap_or_default();
        REACHER.make(&EnvConfig { image, settings }).expect("the task exists")
    };
    let push = |env: &mut dyn Env| env.step(Slice::F64(&[0.5, -1.0])).expect("the action is valid");
    let column = |row: &Batch, name: &str| {
        let index = row.schema().index(name).unwrap_or_else(|| panic!("there is no `{name}`"));
        Value::from_slice(&row.schema().fields()[index].shape, row.column(index))
    };
    let size = ImageSize { height: 32, width: 32 };
    let mut env = make(Some(size));
    reset(env.as_mut(), 3, &ResetOptions::default()).unwrap();
    let first = row(env.as_mut());
    for _ in 0..20 {
        push(env.as_mut());
    }
    let last = row(env.as_mut());
    let start = Some(start_columns(env.as_ref(), &first));
    let goal = Some(BTreeMap::from([("qpos".to_owned(), column(&last, "qpos"))]));
    let options = ResetOptions { start, goal, ..ResetOptions::default() };

    // The image is that of the recorded row, and not of the start.
    reset(env.as_mut(), 3, &options).unwrap();
    let shown = row(env.as_mut());
    assert_eq!(column(&shown, "goal"), column(&last, "pixels"));
    assert_eq!(column(&shown, "pixels"), column(&first, "pixels"));
    assert_ne!(column(&shown, "goal"), column(&shown, "pixels"));

    // An environment that draws nothing goes the same way.
    let mut blind = make(None);
    assert!(blind.spec().fields.iter().all(|field| field.name != "goal"));
    reset(blind.as_mut(), 3, &options).unwrap();
    for _ in 0..10 {
        push(env.as_mut());
        push(blind.as_mut());
        let (seen, unseen) = (row(env.as_mut()), row(blind.as_mut()));
        for name in ["qpos", "qvel", "qacc_warmstart"] {
            assert_eq!(column(&seen, name), column(&unseen, name), "{name}");
        }
    }

    // A restored episode has its goal.
    let mut state = EnvState::default();
    env.snapshot(&mut state).unwrap();
    let mut other = make(Some(size));
    reset(other.as_mut(), 8, &ResetOptions::default()).unwrap();
    assert_ne!(column(&row(other.as_mut()), "goal"), column(&shown, "goal"));
    other.restore(&state).unwrap();
    assert_eq!(column(&row(other.as_mut()), "goal"), column(&shown, "goal"));
}
