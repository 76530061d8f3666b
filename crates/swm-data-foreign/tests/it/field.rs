//! Published datasets of other programs, as their own packages wrote them. Beside each is what these packages read from it.

use std::fs;
use std::path::Path;

use swm_core::Column;
use swm_data::loader::{ClipOptions, Loader, Rewards};
use swm_data::testing::mutations::mutate_for;
use swm_data::tools::compare::compare;
use swm_data::tools::copy::{all, copy};
use swm_data::tools::verify::verify;
use swm_data::{DataError, Dataset, Flip, OpenOptions, WriteOptions};

use crate::open;
use crate::published::{check, column_of, golden, json_of, lengths, naturals, numbers, opened, rows};

/// Whether the last row of a column is missing in every episode, and no other is.
fn assert_only_last_is_missing(dataset: &mut dyn Dataset, name: &str) {
    let column = column_of(dataset, name);
    for (episode, length) in lengths(dataset).into_iter().enumerate() {
        let dim = dataset.schema().dim(column);
        let values = numbers(&rows(dataset, column, episode, 0, length));
        let (before, last) = values.split_at((length - 1) * dim);
        assert!(before.iter().all(|value| value.is_finite()), "{name} of episode {episode}");
        assert!(last.iter().all(|value| value.is_nan()), "{name} of episode {episode}: {last:?}");
    }
}

fn bools(dataset: &mut dyn Dataset, name: &str, episode: usize) -> Vec<bool> {
    let (column, length) = (column_of(dataset, name), dataset.episode_len(episode));
    let Column::Bool(values) = rows(dataset, column, episode, 0, length) else { panic!("{name}") };
    values
}

/// The options that a sample needs.
fn options_of(sample: &str) -> OpenOptions {
    match sample {
        "aloha_toy" => OpenOptions::default().camera(Some("top".to_owned())),
        _ => OpenOptions::default(),
    }
}

const SAMPLES: &[&str] = &[
    "dinowm_pusht_noise",
    "cube-single-play-v0.npz",
    "cube-single-play-v0-val.npz",
    "pointmaze-medium-navigate-v0.npz",
    "visual-cube-single-play-v0.npz",
    "pldm_maze.npz",
    "dreamer_toy",
    "vd4rl_toy",
    "aloha_toy",
    "robomimic_can.hdf5",
    "trajectory.rgbd.pd_ee_delta_pose.physx_cpu.h5",
    "minari_box_hdf5",
    "minari_hdf5",
    "minari_raw_hdf5",
    "halfcheetah-medium-v2.hdf5",
    "antmaze-large-play-v2.hdf5",
    "rlds_toy",
    "upstream_head.lance",
    #[cfg(feature = "lerobot")]
    "minari_parquet",
];

const OGBENCH: &[(&str, &str, f64)] = &[
    ("observations", "observation", 1.0),
    ("actions", "action", 1.0),
    ("qpos", "qpos", 1.0),
    ("qvel", "qvel", 1.0),
    ("button_states", "button_states", 1.0),
];

#[test]
fn folders_of_dinowm_are_pusht() {
    let names =
        [("rel_actions", "action", 100.0), ("states", "state", 1.0), ("velocities", "velocities", 1.0)];
    let expected = json_of("dinowm_pusht_noise");
    let mut dataset = opened(&golden("dinowm_pusht_noise"), &OpenOptions::default()).unwrap();
    assert_eq!(lengths(dataset.as_ref()), naturals(&expected["rows_per_episode"]));
    assert_eq!(dataset.metadata().unwrap().env, "swm/PushT-v1");
    for (theirs, ours, divisor) in names {
        let first = &expected["columns"][theirs]["first"];
        let (ours, from) = if ours == "velocities" { ("state", 5) } else { (ours, 0) };
        let column = column_of(dataset.as_ref(), ours);
        let row = numbers(&rows(dataset.as_mut(), column, 0, 0, 1));
        let last = numbers(&rows(dataset.as_mut(), column, 1, 8, 1));
        for (row, theirs) in [(row, first), (last, &expected["columns"][theirs]["last"])] {
            for (at, value) in theirs.as_array().unwrap().iter().enumerate() {
                let value = value.as_f64().unwrap() / divisor;
                assert!((row[from + at] - value).abs() <= value.abs() * 1e-7, "{ours} {at}");
            }
        }
    }
    let (state, proprio) = (column_of(dataset.as_ref(), "state"), column_of(dataset.as_ref(), "proprio"));
    let (state, proprio) = (rows(dataset.as_mut(), state, 1, 3, 1), rows(dataset.as_mut(), proprio, 1, 3, 1));
    let (state, proprio) = (numbers(&state), numbers(&proprio));
    assert_eq!(proprio, [state[0], state[1], state[5], state[6]]);
    let pixels = column_of(dataset.as_ref(), "pixels");
    let Column::U8(bytes) = rows(dataset.as_mut(), pixels, 1, 2, 1) else { panic!() };
    let mean = bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / bytes.len() as f64;
    assert!((mean - expected["images"]["pixels"]["mean_of_row"].as_f64().unwrap()).abs() < 0.5, "{mean}");
    let refused =
        opened(&golden("dinowm_pusht_noise"), &OpenOptions::default().split(Some("val".to_owned())));
    assert!(refused.err().unwrap().to_string().contains("no part `val`; it has train"));
}

#[test]
fn archives_of_ogbench_end_with_an_action_that_leads_nowhere() {
    for sample in
        ["cube-single-play-v0.npz", "cube-single-play-v0-val.npz", "pointmaze-medium-navigate-v0.npz"]
    {
        let mut dataset = check(sample, &OpenOptions::default(), OGBENCH);
        assert_eq!(lengths(dataset.as_ref()), naturals(&json_of(sample)["rows_per_episode"]), "{sample}");
        assert_only_last_is_missing(dataset.as_mut(), "action");
        assert!(dataset.schema().index("terminated").is_none(), "an end of a recording is no end of a task");
        let ends = bools(dataset.as_mut(), "truncated", 0);
        assert_eq!(ends.iter().filter(|&&end| end).count(), 1);
        assert!(ends[ends.len() - 1], "{ends:?}");
    }
    let visual = check("visual-cube-single-play-v0.npz", &OpenOptions::default(), OGBENCH);
    assert!(visual.schema().index("pixels").is_some());
    let val =
        opened(&golden("cube-single-play-v0.npz"), &OpenOptions::default().split(Some("val".to_owned())))
            .unwrap();
    let expected = json_of("cube-single-play-v0-val.npz");
    assert_eq!(lengths(val.as_ref()), naturals(&expected["rows_per_episode"]));
}

#[test]
fn archives_of_pldm_repeat_their_last_action() {
    let names =
        [("proprio_states", "proprio", 1.0), ("locations", "locations", 1.0), ("actions", "action", 1.0)];
    let mut dataset = check("pldm_maze.npz", &OpenOptions::default(), &names);
    assert_only_last_is_missing(dataset.as_mut(), "action");
}

#[test]
fn a_description_of_robomimic_in_a_damaged_heap_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    let mut bytes = fs::read(golden("robomimic_can.hdf5")).unwrap();
    let known = |path: &Path| opened(path, &OpenOptions::default()).unwrap().info().notes.to_vec();
    assert!(known(&golden("robomimic_can.hdf5")).iter().any(|note| note.contains("its environment is")));
    while let Some(at) = bytes.windows(4).position(|word| word == b"GCOL") {
        bytes[at + 3] = b'X';
    }
    fs::write(&path, bytes).unwrap();
    let notes = known(&path);
    let damaged =
        |note: &&String| note.contains("its attribute `env_args` cannot be read: the heap at byte ");
    assert_eq!(notes.iter().filter(damaged).count(), 1, "{notes:?}");
    assert!(!notes.iter().any(|note| note.contains("its environment is")), "{notes:?}");
}

#[test]
fn episodes_of_robomimic_are_sorted_by_their_numbers() {
    let names = [
        ("actions", "action", 1.0),
        ("obs/robot0_eef_pos", "obs.robot0_eef_pos", 1.0),
        ("obs/robot0_eef_quat", "obs.robot0_eef_quat", 1.0),
        ("obs/object", "obs.object", 1.0),
    ];
    let mut dataset = check("robomimic_can.hdf5", &OpenOptions::default(), &names);
    assert_eq!(lengths(dataset.as_ref()), [5, 7, 6]);
    assert_only_last_is_missing(dataset.as_mut(), "action");
    assert_eq!(dataset.info().rows_per_second, Some(20.0));
    assert!(dataset.schema().index("terminated").is_none());
    assert_eq!(bools(dataset.as_mut(), "success", 0), [false, false, false, true, false]);
    assert!(dataset.info().mapping.contains(&("pixels".to_owned(), "obs/agentview_image".to_owned())));
    let wrist = OpenOptions::default().camera(Some("robot0_eye_in_hand".to_owned()));
    let wrist = opened(&golden("robomimic_can.hdf5"), &wrist).unwrap();
    assert!(wrist.info().mapping.contains(&("pixels".to_owned(), "obs/robot0_eye_in_hand_image".to_owned())));
    let valid = OpenOptions::default().split(Some("valid".to_owned()));
    assert_eq!(lengths(opened(&golden("robomimic_can.hdf5"), &valid).unwrap().as_ref()), [6]);
}

/// All clips of one row, as stored and beside their actions.
fn rewards(path: &Path) -> [Vec<f64>; 2] {
    [Rewards::Recorded, Rewards::OfActions].map(|rewards| {
        let keys = Some(vec!["reward".to_owned()]);
        let options = ClipOptions::default().num_steps(1).keys(keys).rewards(rewards).threads(Some(1));
        let loader = Loader::new(open(path).unwrap(), &options).unwrap();
        let mut batch = loader.new_batch();
        loader.read(&(0..loader.len()).collect::<Vec<_>>(), &mut batch).unwrap();
        let of_row = |row| match batch.row(row).get::<f32>("reward") {
            Ok(values) => f64::from(values[0]),
            Err(_) => batch.row(row).get::<f64>("reward").unwrap()[0],
        };
        (0..loader.len()).map(of_row).collect()
    })
}

#[test]
fn rewards_of_other_programs_and_of_their_copies_are_beside_their_actions_already() {
    let folder = tempfile::tempdir().unwrap();
    for sample in ["robomimic_can.hdf5", "halfcheetah-medium-v2.hdf5"] {
        let copied = folder.path().join(sample).with_extension("h5");
        let mut sources = [open(&golden(sample)).unwrap()];
        let pieces = all(&sources);
        copy(&mut sources, &pieces, &copied, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
        for path in [golden(sample), copied] {
            let [stored, of_actions] = rewards(&path);
            assert!(stored.iter().any(|&reward| reward != 0.0 && !reward.is_nan()), "{stored:?}");
            let same = |(one, other): (&f64, &f64)| {
                one.to_bits() == other.to_bits() || one.is_nan() && other.is_nan()
            };
            assert!(stored.iter().zip(&of_actions).all(same), "{stored:?} {of_actions:?}");
        }
    }
}

#[test]
fn libero_writes_observations_a_step_late() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("demo.hdf5");
    // Joints before step s are s + 0.1, s + 0.2, …; the action of step s is s.
    let joints = |step: usize| (1..=7).map(move |joint| step as f64 + joint as f64 / 10.0);
    let write = |late: usize, moved: f64| {
        let file = hdf5_metno::File::create(&path).unwrap();
        for name in ["demo_0", "demo_1"] {
            let group = file.create_group(&format!("data/{name}/obs")).unwrap();
            let seen: Vec<f64> =
                (0..4).flat_map(|step| joints(step + late).map(|value| value + moved)).collect();
            let states: Vec<f64> = (0..4).flat_map(|step| std::iter::once(0.0).chain(joints(step))).collect();
            let actions = [0.0, 1.0, 2.0, 3.0];
            group
                .new_dataset::<f64>()
                .shape((4, 7))
                .create("joint_states")
                .unwrap()
                .write_raw(&seen)
                .unwrap();
            let group = file.group(&format!("data/{name}")).unwrap();
            group.new_dataset::<f64>().shape((4, 8)).create("states").unwrap().write_raw(&states).unwrap();
            group
                .new_dataset::<u8>()
                .shape(4)
                .create("rewards")
                .unwrap()
                .write_raw(&[0_u8, 0, 0, 1])
                .unwrap();
            group.new_dataset::<f64>().shape((4, 1)).create("actions").unwrap().write_raw(&actions).unwrap();
        }
    };
    let first = |options: &OpenOptions| {
        let mut dataset = opened(&path, options)?;
        let action = column_of(dataset.as_ref(), "action");
        let missing = numbers(&rows(dataset.as_mut(), action, 1, 3, 1))[0].is_nan();
        Ok::<_, DataError>((numbers(&rows(dataset.as_mut(), action, 1, 0, 1))[0], missing))
    };
    write(1, 0.0);
    assert_eq!(first(&OpenOptions::default()).unwrap(), (1.0, true));
    let mut dataset = opened(&path, &OpenOptions::default()).unwrap();
    let reward = column_of(dataset.as_ref(), "reward");
    assert_eq!(numbers(&rows(dataset.as_mut(), reward, 0, 0, 3)), [0.0, 0.0, 1.0]);
    assert_only_last_is_missing(dataset.as_mut(), "reward");
    drop(dataset);
    write(0, 0.0);
    assert_eq!(first(&OpenOptions::default()).unwrap(), (0.0, false));
    write(0, 0.5);
    assert!(first(&OpenOptions::default()).unwrap_err().to_string().contains("`shift`"));
    assert_eq!(first(&OpenOptions::default().shift(Some(1))).unwrap(), (1.0, true));
}

#[test]
fn trajectories_of_maniskill_have_one_observation_more() {
    let names = [("actions", "action", 1.0), ("env_states/actors/cube", "env_states.actors.cube", 1.0)];
    let sample = "trajectory.rgbd.pd_ee_delta_pose.physx_cpu.h5";
    let mut dataset = check(sample, &OpenOptions::default(), &names);
    assert_eq!(lengths(dataset.as_ref()), [5, 7]);
    assert_only_last_is_missing(dataset.as_mut(), "action");
}

#[test]
fn episodes_of_minari_are_sorted_by_their_numbers() {
    let names = [
        ("observations", "observation", 1.0),
        ("observation", "observations.observation", 1.0),
        ("desired_goal", "desired_goal", 1.0),
        ("pair/1", "observations.pair.1", 1.0),
        ("actions", "action", 1.0),
        ("rewards", "reward", 1.0),
        ("terminations", "terminated", 1.0),
        ("truncations", "truncated", 1.0),
    ];
    for sample in ["minari_box_hdf5", "minari_hdf5", "minari_raw_hdf5"] {
        let mut dataset = check(sample, &OpenOptions::default(), &names);
        assert_eq!(lengths(dataset.as_ref()), naturals(&json_of(sample)["rows_per_episode"]), "{sample}");
        assert_only_last_is_missing(dataset.as_mut(), "reward");
    }
}

#[cfg(feature = "lerobot")]
#[test]
fn tables_of_minari_are_padded() {
    let names = [
        ("observation", "observations.observation", 1.0),
        ("desired_goal", "desired_goal", 1.0),
        ("pair/1", "observations.pair.1", 1.0),
        ("actions", "action", 1.0),
        ("rewards", "reward", 1.0),
        ("terminations", "terminated", 1.0),
        ("truncations", "truncated", 1.0),
    ];
    for path in ["minari_parquet", "minari_parquet/data"] {
        let mut dataset = match path {
            "minari_parquet" => check(path, &OpenOptions::default(), &names),
            path => opened(&golden(path), &OpenOptions::default()).unwrap(),
        };
        assert_eq!(lengths(dataset.as_ref()), [5, 7]);
        assert_only_last_is_missing(dataset.as_mut(), "action");
        assert_only_last_is_missing(dataset.as_mut(), "reward");
        let pair = column_of(dataset.as_ref(), "observations.pair.1");
        assert_eq!(dataset.schema().fields()[pair].shape, [2, 2], "the shape is that of the space");
        let pixels = column_of(dataset.as_ref(), "pixels");
        assert_eq!(dataset.schema().fields()[pixels].shape, [32, 32, 3]);
        let Column::U8(image) = rows(dataset.as_mut(), pixels, 1, 2, 1) else { panic!() };
        assert!(image.iter().any(|&byte| byte != image[0]), "it holds an image");
    }
}

#[test]
fn files_with_addresses_of_four_bytes_are_read() {
    use hdf5_metno::plist::file_create::{Sizeof, SizeofInfo};

    let folder = tempfile::tempdir().unwrap();
    for is_new in [false, true] {
        let path = folder.path().join(format!("short-{is_new}.hdf5"));
        let mut builder = hdf5_metno::FileBuilder::new();
        builder.with_fcpl(|made| {
            made.sizes(SizeofInfo { sizeof_addr: Sizeof::Bytes4, sizeof_size: Sizeof::Bytes4 })
        });
        builder.with_fapl(|access| if is_new { access.libver_latest() } else { access.libver_earliest() });
        let file = builder.create(&path).unwrap();
        let values = ndarray::arr2(&[0, 1, 2, 3, 4, 5u8].map(|value| [f32::from(value)]));
        for name in ["observations", "actions"] {
            file.new_dataset_builder().with_data(&values).create(name).unwrap();
        }
        file.new_dataset_builder().with_data(&[0.0f32; 6]).create("rewards").unwrap();
        file.new_dataset_builder().with_data(&[false; 6]).create("terminals").unwrap();
        let ends = [false, false, true, false, false, true];
        file.new_dataset_builder().with_data(&ends).create("timeouts").unwrap();
        drop(file);
        let start = fs::read(&path).unwrap();
        assert_eq!(if is_new { start[9] } else { start[13] }, 4, "bytes of an address");
        let mut dataset = opened(&path, &OpenOptions::default()).unwrap();
        assert_eq!(lengths(dataset.as_ref()), [3, 3]);
        let state = column_of(dataset.as_ref(), "state");
        assert_eq!(numbers(&rows(dataset.as_mut(), state, 1, 0, 3)), [3.0, 4.0, 5.0]);
        // A superblock that was changed is damage, whatever it says about sizes.
        if is_new {
            let mut changed = start;
            changed[14] ^= 1;
            fs::write(&path, changed).unwrap();
            let message = opened(&path, &OpenOptions::default()).err().unwrap().to_string();
            assert!(message.contains("checksum"), "{message}");
        }
    }
}

#[test]
fn ends_of_d4rl_are_time_limits_or_ends_of_the_task() {
    let names = [("observations", "state", 1.0), ("actions", "action", 1.0), ("rewards", "reward", 1.0)];
    let mut cheetah = check("halfcheetah-medium-v2.hdf5", &OpenOptions::default(), &names);
    assert_eq!(lengths(cheetah.as_ref()), [8, 6, 7]);
    assert_only_last_is_missing(cheetah.as_mut(), "action");
    assert!(cheetah.schema().index("terminated").is_some());
    let ant = check("antmaze-large-play-v2.hdf5", &OpenOptions::default(), &names);
    assert_eq!(lengths(ant.as_ref()), [8, 6]);
    assert!(ant.schema().index("terminated").is_none());
    let refused = opened(&golden("antmaze-large-play-v2.hdf5"), &OpenOptions::default().max_steps(Some(5)));
    assert!(refused.err().unwrap().to_string().contains("leave it out"));
}

#[test]
fn options_name_what_a_file_does_not_hold() {
    let path = golden("visual-cube-single-play-v0.npz");
    let map = [("state".to_owned(), "qpos".to_owned())].into_iter().collect();
    let options = OpenOptions::default().map(map).fps(Some(20.0)).env(Some("swm/OGBCube-v0".to_owned()));
    let mut turned = opened(&path, &options.clone().flip(Some(Flip::Vertical))).unwrap();
    let mut plain = opened(&path, &options).unwrap();
    let info = plain.info().clone();
    assert!(info.mapping.contains(&("state".to_owned(), "qpos".to_owned())), "{:?}", info.mapping);
    assert_eq!(info.rows_per_second, Some(20.0));
    let run = plain.metadata().unwrap();
    assert_eq!(run.env, "swm/OGBCube-v0");
    assert_eq!(run.source.as_ref().unwrap()["options"]["fps"], 20.0);
    let pixels = column_of(plain.as_ref(), "pixels");
    let ([height, width, _], images) = (
        <[usize; 3]>::try_from(plain.schema().fields()[pixels].shape.clone()).unwrap(),
        [rows(plain.as_mut(), pixels, 0, 0, 1), rows(turned.as_mut(), pixels, 0, 0, 1)],
    );
    let [Column::U8(plain), Column::U8(turned)] = images else { panic!() };
    assert_eq!(plain[..width * 3], turned[(height - 1) * width * 3..]);
    for (options, word) in [
        (OpenOptions::default().camera(Some("wrist".to_owned())), "no camera is called `wrist`"),
        (OpenOptions::default().map([("a".to_owned(), "b".to_owned())].into_iter().collect()), "no `b`"),
        (OpenOptions::default().fps(Some(0.0)), "above 0"),
        (OpenOptions::default().max_steps(Some(10)), "no use for it"),
    ] {
        let refused = opened(&path, &options).err().unwrap().to_string();
        assert!(refused.contains(word), "{refused}");
    }
}

#[test]
fn copies_are_exact_and_keep_how_they_were_read() {
    let folder = tempfile::tempdir().unwrap();
    for sample in SAMPLES {
        let mut source = opened(&golden(sample), &options_of(sample)).unwrap();
        let target = folder.path().join(format!("{sample}.h5"));
        let report = verify(source.as_mut(), &mut |_| {});
        assert_eq!(report.problems, [], "{sample}");
        let record = source.metadata().unwrap().source.clone();
        let mut sources = [source];
        let pieces = all(&sources);
        copy(&mut sources, &pieces, &target, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
        let [mut source] = sources;
        let mut written = open(&target).unwrap();
        let found = compare(source.as_mut(), written.as_mut(), &|_| true, 0.0, &mut |_| {}).unwrap();
        assert!(found.equal, "{sample}: {found:?}");
        assert!(record.is_some() && written.metadata().unwrap().source == record, "{sample}");
    }
}

#[test]
fn no_reader_of_published_datasets_trips_over_foreign_bytes() {
    for sample in SAMPLES {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(sample);
        match golden(sample).is_dir() {
            true => crate::copied(&golden(sample), &path),
            false => drop(fs::copy(golden(sample), &path).unwrap()),
        }
        mutate_for(sample, &path, &mut |path| {
            let Ok(mut dataset) = opened(path, &options_of(sample)) else { return false };
            verify(dataset.as_mut(), &mut |_| {}).problems.is_empty()
        });
    }
}
