//! Recordings of the reference: trajectories, images, the expert; and requests that cannot be met.

use std::fs::File;

use ndarray::{Array1, Array2};
use ndarray_npy::NpzReader;
use swm_core::{
    Batch, Env, EnvConfig, Episode, EpisodeSeed, Evaluation, ImageSize, Registry, ResetOptions, Rollout,
    Schema, Slice, Value, World, WorldOptions,
};

use super::factors::setup;
use super::settings::Settings;
use super::{TWO_ROOM, factors};

/// Positions follow the reference to this, pixels.
const PIXELS: f64 = 1e-9;

fn golden(path: &str) -> NpzReader<File> {
    let path = format!("{}/../../tests/golden/{path}", env!("CARGO_MANIFEST_DIR"));
    NpzReader::new(File::open(&path).expect(&path)).unwrap()
}

fn env(config: &EnvConfig) -> (Box<dyn Env>, Batch) {
    let env = TWO_ROOM.make(config).unwrap();
    let row = Batch::new(Schema::new(env.spec().fields.clone()).unwrap(), 1);
    (env, row)
}

fn reset(env: &mut Box<dyn Env>, options: &ResetOptions) -> Result<(), String> {
    let episode = Episode::new(EpisodeSeed::new(0), options);
    env.reset(&episode).map(|_| ()).map_err(|error| error.to_string())
}

fn values<const N: usize>(env: &mut Box<dyn Env>, row: &mut Batch, column: &str) -> [f64; N] {
    env.observe(&mut row.rows_mut());
    let values: &[f64] = row.row(0).get(column).unwrap();
    values.try_into().unwrap()
}

fn fixed(values: &[(&str, Value)]) -> ResetOptions {
    values.iter().fold(ResetOptions::default().vary(["none"]), |options, (name, value)| {
        options.set(name, value.clone())
    })
}

/// The recorded factors of a trajectory with one factor set, as reset options.
fn recorded_options(npz: &mut NpzReader<File>) -> ResetOptions {
    let meta: Array1<u8> = npz.by_name("meta").unwrap();
    let meta: serde_json::Value = serde_json::from_slice(&meta.to_vec()).unwrap();
    let mut options = ResetOptions::default().vary(["none"]);
    if let Some(values) = meta["options"]["variation_values"].as_object() {
        for (name, json) in values {
            options.variation_values.insert(name.clone(), Value::from_json(name, json).unwrap());
        }
    }
    options
}

#[test]
fn trajectories_with_known_factors_follow_the_reference() {
    let names = [
        "default",
        "agent.position",
        "agent.speed",
        "door.position",
        "door3",
        "goal.radius",
        "wall.thickness",
    ];
    let mut touches = 0;
    for name in names {
        let mut npz = golden(&format!("trajectories/TwoRoom__{name}.npz"));
        let options = recorded_options(&mut npz);
        let (mut env, mut row) = env(&EnvConfig::default());
        reset(&mut env, &options).unwrap();
        let actions: Array2<f32> = npz.by_name("actions").unwrap();
        let states: Array2<f64> = npz.by_name("obs_state").unwrap();
        let contacts: Array1<f64> = npz.by_name("info_n_contacts").unwrap();
        let rewards: Array1<f64> = npz.by_name("reward").unwrap();
        for step in 0..=actions.nrows() {
            let state: [f64; 6] = values(&mut env, &mut row, "state");
            for (column, (ours, theirs)) in state.iter().zip(states.row(step)).enumerate() {
                assert!(
                    (ours - theirs).abs() < PIXELS,
                    "{name}, step {step}, {column}: {ours}, not {theirs}"
                );
            }
            let count: &[i64] = row.row(0).get("n_contacts").unwrap();
            assert_eq!(count[0] as f64, contacts[step], "{name}, step {step}: contacts");
            touches += count[0];
            if step < actions.nrows() {
                let outcome = env.step(Slice::F32(actions.row(step).as_slice().unwrap())).unwrap();
                assert_eq!(outcome.reward, rewards[step], "{name}, step {step}: reward");
            }
        }
    }
    assert!(touches > 20, "only {touches} contacts");
}

/// A decoded image: height, width, `[H, W, 3]`.
fn decoded(npz: &mut NpzReader<File>, name: &str) -> (usize, usize, Vec<u8>) {
    let bytes: Array1<u8> = npz.by_name(name).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes.to_vec())).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    (info.height as usize, info.width as usize, rgb)
}

/// All factors of the scene that an image shows.
fn imaged_options(npz: &mut NpzReader<File>) -> ResetOptions {
    let json: Array1<u8> = npz.by_name("variation_json").unwrap();
    let factors: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(&json.to_vec()).unwrap();
    let mut options = ResetOptions::default().vary(["none"]);
    for (name, json) in factors {
        options.variation_values.insert(name.clone(), Value::from_json(&name, &json).unwrap());
    }
    options
}

#[test]
fn the_references_expert_is_followed_through_its_doors() {
    for seed in 0..2 {
        // Recordings of one seed have the same doors; that of images says which. Its other factors may be its own.
        let mut options = imaged_options(&mut golden(&format!("render/image/TwoRoom_resize_seed{seed}.npz")));
        options.variation_values.retain(|name, _| name == "door.position" || name == "door.size");
        let mut npz = golden(&format!("tworoom_v1/TwoRoom_expert_noise0_seed{seed}.npz"));
        let actions: Array2<f32> = npz.by_name("actions").unwrap();
        let bodies: Array2<f64> = npz.by_name("state_body_state").unwrap();
        let terminated: Array1<bool> = npz.by_name("terminated").unwrap();
        let place =
            |column: usize| Value::vector(&[bodies[[0, column]] as f32, bodies[[0, column + 1]] as f32]);
        options.variation_values.insert("agent.position".to_owned(), place(0));
        options.variation_values.insert("goal.position".to_owned(), place(6));
        let (mut env, mut row) = env(&EnvConfig::default());
        reset(&mut env, &options).unwrap();
        for (step, action) in actions.rows().into_iter().enumerate() {
            let outcome = env.step(Slice::F32(action.as_slice().unwrap())).unwrap();
            let [x, y, .., energy, _]: [f64; 6] = values(&mut env, &mut row, "state");
            for (ours, column) in [(x, 0), (y, 1), (energy, 8)] {
                let theirs = bodies[[step + 1, column]];
                assert!((ours - theirs).abs() < PIXELS, "seed {seed}, step {step}: {ours}, not {theirs}");
            }
            assert_eq!(outcome.terminated, terminated[step], "seed {seed}, step {step}");
        }
        assert_eq!(terminated.last(), Some(&true));
    }
}

#[test]
fn images_of_every_size_are_the_references() {
    for seed in 0..2 {
        let mut npz = golden(&format!("render/image/TwoRoom_resize_seed{seed}.npz"));
        let options = imaged_options(&mut npz);
        for size in ["32", "64", "84", "96", "128", "224", "256", "48x64_hw"] {
            let name =
                if size == "224" { "render224_png".into() } else { format!("pil_bilinear_{size}_png") };
            let (height, width, theirs) = decoded(&mut npz, &name);
            let image = Some(ImageSize { height, width });
            let (mut env, mut row) = env(&EnvConfig { image, ..EnvConfig::default() });
            reset(&mut env, &options).unwrap();
            env.observe(&mut row.rows_mut());
            let ours: &[u8] = row.row(0).get("pixels").unwrap();
            let unequal = ours.chunks(3).zip(theirs.chunks(3)).filter(|(a, b)| a != b).count();
            assert_eq!(unequal, 0, "seed {seed}, {size}: pixels differ");
        }
    }
}

#[test]
fn images_of_trajectories_are_the_references() {
    let names = [
        "agent.color",
        "agent.position",
        "agent.speed",
        "default",
        "door.color",
        "door.position",
        "door3",
        "goal.color",
        "goal.radius",
        "wall.border_color",
        "wall.thickness",
    ];
    for name in names {
        let mut npz = golden(&format!("trajectories/TwoRoom__{name}.npz"));
        let options = recorded_options(&mut npz);
        let image = Some(ImageSize { height: 224, width: 224 });
        let (mut env, mut row) = env(&EnvConfig { image, ..EnvConfig::default() });
        reset(&mut env, &options).unwrap();
        env.write_episode(&mut row.rows_mut());
        let actions: Array2<f32> = npz.by_name("actions").unwrap();
        let differ = |row: &Batch, column: &str, theirs: &[u8]| {
            let ours: &[u8] = row.row(0).get(column).unwrap();
            ours.chunks(3).zip(theirs.chunks(3)).filter(|(a, b)| a != b).count()
        };
        assert_eq!(differ(&row, "goal", &decoded(&mut npz, "goal_png").2), 0, "{name}: goal");
        for step in 0..=actions.nrows() {
            if let Ok(bytes) = npz.by_name::<ndarray::OwnedRepr<u8>, ndarray::Ix1>(&format!("img_{step}_png"))
            {
                drop(bytes);
                env.observe(&mut row.rows_mut());
                let (.., theirs) = decoded(&mut npz, &format!("img_{step}_png"));
                assert_eq!(differ(&row, "pixels", &theirs), 0, "{name}: step {step}");
            }
            if step < actions.nrows() {
                env.step(Slice::F32(actions.row(step).as_slice().unwrap())).unwrap();
            }
        }
    }
}

#[test]
fn fast_images_are_close_to_exact_ones() {
    for side in [64, 96, 224] {
        let image = Some(ImageSize { height: side, width: side });
        let options = ResetOptions::default().vary(["all"]);
        let frames = ["exact", "fast"].map(|style| {
            let settings = serde_json::Map::from_iter([("render".to_owned(), style.into())]);
            let (mut env, mut row) = env(&EnvConfig { image, settings });
            reset(&mut env, &options).unwrap();
            env.observe(&mut row.rows_mut());
            row.row(0).get::<u8>("pixels").unwrap().to_vec()
        });
        let total: u64 = frames[0].iter().zip(&frames[1]).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        let mean = total as f64 / frames[0].len() as f64;
        assert!(mean < 3.0, "{side}: mean difference {mean} of 255");
    }
}

#[test]
fn constraints_that_cannot_be_met_say_which_and_why() {
    let (mut env, _) = env(&EnvConfig::default());
    let narrow = fixed(&[
        ("agent.radius", Value::vector(&[30.0f32])),
        ("door.number", Value::scalar(2i64)),
        ("door.size", Value::vector(&[74i64, 10, 99])),
    ]);
    let message = reset(&mut env, &narrow).unwrap_err();
    for part in
        ["`door.size`", "2.5 times agent.radius", "agent.radius = [30.0]", "door.number = 2", "[74,10,99]"]
    {
        assert!(message.contains(part), "{part} is missing: {message}");
    }
    // The default doors fit a radius of 30, but not where the first of them is made shorter.
    let drawn =
        ResetOptions::default().vary(["agent.radius"]).set("door.size", Value::vector(&[36i64, 99, 99]));
    let message = reset(&mut env, &drawn).unwrap_err();
    assert!(message.contains("`door.size`") && message.contains("agent.radius"), "{message}");

    let same_side = fixed(&[("agent.position", Value::vector(&[400.0f32, 100.0]))]);
    let message = reset(&mut env, &same_side).unwrap_err();
    for part in [
        "`goal.position`",
        "other side of the wall",
        "sample or set it too",
        "agent.position = [400.0,100.0]",
    ] {
        assert!(message.contains(part), "{part} is missing: {message}");
    }
    let in_the_wall = fixed(&[("agent.position", Value::vector(&[247.0f32, 100.0]))]);
    let message = reset(&mut env, &in_the_wall).unwrap_err();
    assert!(message.contains("`agent.position`") && message.contains("clear of wall"), "{message}");
}

#[test]
fn drawing_agent_position_alone_fails_about_every_other_time() {
    let (mut env, _) = env(&EnvConfig::default());
    let options = ResetOptions::default().vary(["agent.position"]);
    let failures =
        (0..60).filter(|&seed| env.reset(&Episode::new(EpisodeSeed::new(seed), &options)).is_err()).count();
    assert!((15..45).contains(&failures), "{failures} of 60");
    let both = ResetOptions::default().vary(["agent.position", "goal.position"]);
    for seed in 0..60 {
        env.reset(&Episode::new(EpisodeSeed::new(seed), &both)).unwrap();
    }
}

#[test]
fn energy_cuts_the_episode_off() {
    let (mut env, mut row) = env(&EnvConfig::default());
    reset(&mut env, &fixed(&[("agent.max_energy", Value::scalar(50i64))])).unwrap();
    for step in 1..=50 {
        assert!(!env.is_truncated(), "before step {step}");
        env.step(Slice::F32(&[0.1, 0.0])).unwrap();
    }
    assert!(env.is_truncated());
    assert_eq!(values::<6>(&mut env, &mut row, "state")[4], 0.0);
}

#[test]
fn recorded_rows_restore_moments_and_goals() {
    let (mut env, mut row) = env(&EnvConfig::default());
    reset(&mut env, &ResetOptions::default()).unwrap();
    env.write_episode(&mut row.rows_mut());
    let mut rows = Vec::new();
    let push = [-0.9_f32, -0.4];
    for _ in 0..30 {
        rows.push((values::<6>(&mut env, &mut row, "state"), values::<2>(&mut env, &mut row, "pos_agent")));
        env.step(Slice::F32(&push)).unwrap();
    }
    let last: [f64; 6] = values(&mut env, &mut row, "state");
    // Pressed into the border, the correction that is due is part of the state.
    let (state, place) = rows[20];
    let columns = |state: [f64; 6], place: [f64; 2]| {
        Some(
            [("state".to_owned(), Value::vector(&state)), ("pos_agent".to_owned(), Value::vector(&place))]
                .into(),
        )
    };
    let mut variation_values = std::collections::BTreeMap::new();
    for name in ["door.size", "door.position"] {
        let drawn: &[i64] = row.row(0).get(&format!("variation.{name}")).unwrap();
        variation_values.insert(name.to_owned(), Value::vector(drawn));
    }
    let options = ResetOptions {
        variation: Some(Vec::new()),
        variation_values,
        start: columns(state, place),
        ..ResetOptions::default()
    };
    reset(&mut env, &options).unwrap();
    assert_eq!(values::<6>(&mut env, &mut row, "state"), state);
    for _ in 20..30 {
        env.step(Slice::F32(&push)).unwrap();
    }
    for (ours, theirs) in values::<6>(&mut env, &mut row, "state").iter().zip(last) {
        assert!((ours - theirs).abs() < 1e-6, "{ours}, not {theirs}");
    }
    let ahead = ResetOptions { goal: columns(rows[25].0, rows[25].1), ..options };
    reset(&mut env, &ahead).unwrap();
    assert_eq!(values::<2>(&mut env, &mut row, "pos_goal"), rows[25].1);
    let nan = ResetOptions { start: columns([f64::NAN; 6], [1.0, 1.0]), ..ResetOptions::default() };
    assert!(reset(&mut env, &nan).unwrap_err().contains("not finite"));
}

fn evaluate(policy: &str, solid: bool, options: &ResetOptions) -> Evaluation {
    let settings = serde_json::Map::from_iter([("solid_walls".to_owned(), solid.into())]);
    let config = EnvConfig { image: None, settings };
    let world_options = WorldOptions::new(4).env(config.clone()).threads(1).max_episode_steps(200);
    let mut world = World::new(&TWO_ROOM, world_options).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..100).seed(42).options(options.clone());
    world.evaluate(&rollout).unwrap()
}

#[test]
fn the_expert_reaches_the_goal() {
    let (default, all) = (ResetOptions::default(), ResetOptions::default().vary(["all"]));
    for (policy, options, least) in [
        ("expert", &default, 98.0),
        ("noisy-expert:1.3", &default, 98.0),
        ("expert", &all, 95.0),
        ("noisy-expert:1.3", &all, 95.0),
    ] {
        let rate = evaluate(policy, false, options).success_rate;
        assert!(rate >= least, "{policy}: {rate} %");
    }
}

#[test]
fn between_solid_walls_the_expert_fails_only_where_no_door_leads_through() {
    for options in [ResetOptions::default(), ResetOptions::default().vary(["all"])] {
        let result = evaluate("expert", true, &options);
        for (&seed, success) in result.seeds.iter().zip(&result.episode_successes) {
            let episode = Episode::new(EpisodeSeed::new(seed as u64), &options);
            let fov = factors().sample(TWO_ROOM.id, &episode).unwrap();
            let setup = setup(&fov, &Settings::default());
            // A door may reach beyond the wall's end, which leaves a part of it.
            let fits = setup.plan.openings().any(|opening| opening.length() > 2.0 * setup.radius);
            assert_eq!(*success, fits, "seed {seed}");
        }
        assert!(result.success_rate > 90.0, "{} %", result.success_rate);
    }
}
