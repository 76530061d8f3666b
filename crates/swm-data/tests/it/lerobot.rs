//! LeRobot folders, as pyarrow and PyAV write them: values, images, damage.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Batch;
use swm_data::format::built_in;
use swm_data::tools::copy::{all, copy};
use swm_data::{DataError, FORMATS, Steps, WriteMode, WriteOptions, create, create_in, open};

use crate::support::{assert_alike, bits, contents, episode, metadata, record, rows_of, schema};
use swm_data::testing::mutations::{files, mutate};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets").join(name)
}

fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copied(&entry.path(), &target),
            false => drop(fs::copy(entry.path(), target).unwrap()),
        }
    }
}

#[test]
fn both_versions_hold_the_values_that_were_written() {
    let expected: serde_json::Value =
        serde_json::from_slice(&fs::read(golden("expected_lerobot.json")).unwrap()).unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = golden(&format!("lerobot_{version}"));
        let mut dataset = open(&path).unwrap();
        assert_eq!(
            (dataset.info().format, dataset.num_episodes(), dataset.info().skipped.len()),
            ("lerobot", 2, 0)
        );
        assert_eq!([dataset.episode_len(0), dataset.episode_len(1)], [4, 6]);
        let episodes = contents(&path);
        let all = |name: &str| -> Vec<u8> {
            let at = dataset.schema().require(name).unwrap();
            episodes.iter().flat_map(|batch: &Batch| bits(&batch.column(at).to_column())).collect()
        };
        assert_eq!(u64::from(crc32fast::hash(&all("proprio"))), expected["state_crc32"], "{version}");
        assert_eq!(u64::from(crc32fast::hash(&all("action"))), expected["action_crc32"], "{version}");
        let means = expected["frame_means"].as_array().unwrap();
        for (row, (frame, mean)) in all("pixels").chunks_exact(32 * 48 * 3).zip(means).enumerate() {
            let found = frame.iter().map(|&value| f64::from(value)).sum::<f64>() / frame.len() as f64;
            assert!(
                (found - mean.as_f64().unwrap()).abs() < 2.0,
                "{version}, row {row}: {found}, not {mean}"
            );
        }
        assert_eq!(episodes[1].get::<i64>("step_idx").unwrap(), [0, 1, 2, 3, 4, 5]);
        assert_eq!(episodes[1].get::<i32>("ep_idx").unwrap(), [1; 6]);
        assert_eq!(episodes[1].get::<i64>("frame_index").unwrap(), [0, 1, 2, 3, 4, 5]);
        assert_eq!(episodes[1].get::<bool>("next.done").unwrap()[4..], [false, true]);
        // A window, and a jump back.
        let pixels = dataset.schema().index("pixels").unwrap();
        for (first, stride) in [(3, 2), (0, 5)] {
            let mut out = vec![0; 2 * 32 * 48 * 3];
            let steps = Steps { first, count: 2, stride };
            dataset.read_column(pixels, 1, steps, swm_core::SliceMut::U8(&mut out)).unwrap();
            for (frame, row) in out.chunks_exact(32 * 48 * 3).zip([first, first + stride]) {
                assert!(
                    frame == &episodes[1].get::<u8>("pixels").unwrap()[row * frame.len()..][..frame.len()]
                );
            }
        }
    }
}

/// Videos in AV1 are what LeRobot itself writes: the same images, encoded by SVT-AV1 at LeRobot's settings.
#[test]
fn videos_in_av1_hold_the_images_that_were_encoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    copied(&golden("lerobot_v3.0"), &path);
    let video = path.join("videos/observation.images.top/chunk-000/file-000.mp4");
    fs::copy(golden("lerobot_av1_top.mp4"), &video).unwrap();
    let in_av1 = contents(&path);
    let in_h264 = contents(&golden("lerobot_v3.0"));
    for (av1, h264) in in_av1.iter().zip(&in_h264) {
        assert_eq!(av1.get::<f32>("proprio").unwrap(), h264.get::<f32>("proprio").unwrap());
        let (av1, h264) = (av1.get::<u8>("pixels").unwrap(), h264.get::<u8>("pixels").unwrap());
        assert_eq!(av1.len(), h264.len());
        let squares: f64 = av1.iter().zip(h264).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
        let error = (squares / av1.len() as f64).sqrt();
        assert!((0.1..8.0).contains(&error), "{error}");
    }
    // Damage in the video is an error or other images, and the numbers stay.
    let bytes = fs::read(&video).unwrap();
    let mut errors = 0;
    for at in (0..bytes.len()).step_by(bytes.len() / 60) {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x24;
        fs::write(&video, bytes).unwrap();
        let Ok(mut dataset) = open(&path) else { continue };
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        errors += (0..2).filter(|&episode| dataset.read(episode, 0..4, &mut batch).is_err()).count();
    }
    assert!(errors > 5, "{errors}");
}

#[test]
fn other_programs_folders_are_not_continued_and_read_only_inside() {
    let folder = tempfile::tempdir().unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = folder.path().join(version);
        copied(&golden(&format!("lerobot_{version}")), &path);
        let message = record(&path, WriteMode::Append, 0..1).unwrap_err().to_string();
        assert!(message.contains("another program"), "{message}");
        let info = path.join("meta/info.json");
        let text = fs::read_to_string(&info).unwrap();
        for (from, to) in [("\"data/", "\"../data/"), ("\"videos/", "\"/videos/"), ("\"v", "\"v1")] {
            fs::write(&info, text.replace(from, to)).unwrap();
            assert!(open(&path).is_err(), "{from} {to}");
        }
    }
}

#[test]
fn a_video_that_cannot_be_decoded_is_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    copied(&golden("lerobot_v3.0"), &path);
    let video = path.join("videos/observation.images.top/chunk-000/file-000.mp4");
    let mut bytes = fs::read(&video).unwrap();
    let at = bytes.windows(4).position(|window| window == b"avc1").unwrap();
    let at = bytes[at + 4..].windows(4).position(|window| window == b"avc1").map_or(at, |next| at + 4 + next);
    bytes[at..at + 4].copy_from_slice(b"vp09");
    fs::write(&video, bytes).unwrap();
    let dataset = open(&path).unwrap();
    assert!(dataset.schema().index("pixels").is_none() && dataset.schema().index("proprio").is_some());
    let (name, reason) = &dataset.info().skipped[0];
    assert!(name == "observation.images.top" && reason.contains("`vp09`"), "{name}: {reason}");
}

#[test]
fn no_mutation_makes_it_trip() {
    let folder = tempfile::tempdir().unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = folder.path().join(version);
        copied(&golden(&format!("lerobot_{version}")), &path);
        mutate(version, &path);
    }
}

#[test]
fn what_is_written_is_read_again_and_continued() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    assert_eq!(record(&path, WriteMode::Error, 0..3).unwrap(), 0);
    assert!(record(&path, WriteMode::Error, 0..1).unwrap_err().to_string().contains("exists already"));
    assert_eq!(record(&path, WriteMode::Append, 3..5).unwrap(), 3);
    let dataset = open(&path).unwrap();
    assert_eq!((dataset.info().format, dataset.metadata()), ("lerobot", Some(&metadata())));
    assert_eq!(dataset.schema().fields()[..10], *schema().fields());
    let read = contents(&path);
    assert_eq!(read.len(), 5);
    for (index, batch) in read.iter().enumerate() {
        assert_alike(&episode(&schema(), index, rows_of(index)), batch);
        assert!(batch.get::<i32>("ep_idx").unwrap().iter().all(|&number| number == index as i32));
    }
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(path.join(name)).unwrap()).unwrap()
    };
    let info = json("meta/info.json");
    let rows: usize = (0..5).map(rows_of).sum();
    assert_eq!((&info["total_episodes"], &info["total_frames"]), (&5.into(), &rows.into()));
    assert_eq!(info["features"]["observation.images.pixels"]["dtype"], "video");
    assert_eq!(info["features"]["observation.state"]["shape"], serde_json::json!([7]));
    // As if recorded at once; not finite values do not count.
    let values: Vec<f64> =
        read.iter().flat_map(|batch| batch.get::<f64>("reward").unwrap().to_vec()).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let spread =
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
    let found = json("meta/stats.json");
    for (name, expected) in [("mean", mean), ("std", spread)] {
        let found = found["reward"][name][0].as_f64().unwrap();
        assert!((found - expected).abs() < 1e-9 * expected.abs(), "{name}: {found}, not {expected}");
    }
    assert_eq!(found["reward"]["count"][0], rows);
    assert!(found["action"]["max"][0].as_f64().unwrap() > 0.0);
    assert_eq!(record(&path, WriteMode::Overwrite, 1..2).unwrap(), 0);
    assert_eq!(contents(&path).len(), 1);
}

#[test]
fn a_folder_that_is_no_dataset_is_not_replaced_and_misfits_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let private = folder.path().join("private.lerobot");
    fs::create_dir(&private).unwrap();
    fs::write(private.join("letter.txt"), "dear").unwrap();
    let message = record(&private, WriteMode::Overwrite, 0..1).unwrap_err().to_string();
    assert!(message.contains("no dataset to replace"), "{message}");
    assert!(private.join("letter.txt").exists());

    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..1).unwrap();
    let mut writer = create(&path, WriteMode::Append, None).unwrap();
    assert!(matches!(create(&path, WriteMode::Append, None).err(), Some(DataError::Busy { .. })));
    let other = swm_core::Metadata { env: "swm/Other-v1".into(), ..metadata() };
    assert!(writer.begin(&schema(), &other).unwrap_err().to_string().contains("swm/Other-v1"));
    drop(writer);
    let own =
        swm_core::Schema::new(vec![swm_core::Field::step("timestamp", swm_core::Dtype::Str, &[])]).unwrap();
    let mut writer = create(&folder.path().join("new.lerobot"), WriteMode::Append, None).unwrap();
    assert!(writer.begin(&own, &metadata()).unwrap_err().to_string().contains("LeRobot's own"));
}

#[test]
fn repair_counts_again_and_bit_flips_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..2).unwrap();
    let format = FORMATS.iter().find(|format| format.name == "lerobot").unwrap();
    let repair = |apply| format.repair(&path, apply).unwrap();
    assert!(repair(true).is_empty());
    // A kill between the list and what follows it, and in the middle of the next episode.
    let info = path.join("meta/info.json");
    let text = fs::read_to_string(&info).unwrap();
    fs::write(&info, text.replace("\"total_episodes\": 2", "\"total_episodes\": 1")).unwrap();
    fs::remove_file(path.join("meta/swm-stats.json")).unwrap();
    fs::write(path.join("data/chunk-000/file-002.parquet"), "half").unwrap();
    let stats = fs::read_to_string(path.join("meta/stats.json")).unwrap();
    assert_eq!(contents(&path).len(), 2);
    assert_eq!(repair(false).len(), 3);
    assert_eq!(repair(true).len(), 3);
    assert!(repair(false).is_empty());
    assert_eq!(fs::read_to_string(&info).unwrap(), text);
    let again: serde_json::Value =
        serde_json::from_slice(&fs::read(path.join("meta/stats.json")).unwrap()).unwrap();
    let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
    assert_eq!(again["reward"], stats["reward"]);
    assert!(!path.join("data/chunk-000/file-002.parquet").exists());

    for file in ["data/chunk-000/file-001.parquet", "videos/observation.images.goal/chunk-000/file-001.mp4"] {
        let file = path.join(file);
        let mut bytes = fs::read(&file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        fs::write(&file, &bytes).unwrap();
        let mut dataset = open(&path).unwrap();
        assert!(dataset.info().has_checksums && dataset.check_episode(0).is_ok());
        assert!(dataset.check_episode(1).unwrap_err().to_string().contains("checksum"));
        bytes[middle] ^= 4;
        fs::write(&file, bytes).unwrap();
    }
}

/// Nothing is deleted that `meta/info.json` counts: a list that is gone was not interrupted, but lost.
#[test]
fn episodes_that_the_list_lost_are_found_again_and_never_removed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..3).unwrap();
    let (whole, before) = (contents(&path), files(&path));
    let format = FORMATS.iter().find(|format| format.name == "lerobot").unwrap();
    let list = path.join("meta/episodes/chunk-000/file-000.parquet");
    let bytes = fs::read(&list).unwrap();
    let lose = || fs::remove_dir_all(path.join("meta/episodes")).unwrap();

    lose();
    let said = open(&path).err().unwrap().to_string();
    assert!(said.contains("lists 0 of the 3 episodes") && said.contains("--fix"), "{said}");
    let continued = create(&path, WriteMode::Append, None).err().unwrap().to_string();
    assert!(continued.contains("lists 0 of the 3 episodes"), "{continued}");
    assert_eq!(
        format.repair(&path, false).unwrap(),
        ["list 3 of 3 episodes again, which `meta/episodes` lacks"]
    );
    assert!(!list.exists());
    assert_eq!(format.repair(&path, true).unwrap().len(), 1);
    contents(&path).iter().zip(&whole).for_each(|(found, whole)| assert_alike(found, whole));
    assert_eq!(files(&path), before);
    assert_eq!(fs::read(&list).unwrap(), bytes);
    let mut dataset = open(&path).unwrap();
    (0..3).for_each(|episode| dataset.check_episode(episode).unwrap());

    // What is damaged too stays as it is.
    let table = path.join("data/chunk-000/file-001.parquet");
    let cut = fs::read(&table).unwrap().split_off(100);
    fs::write(&table, &cut).unwrap();
    lose();
    let before = files(&path);
    let said = format.repair(&path, true).unwrap_err().to_string();
    assert!(
        said.contains("episode 1, which `meta/episodes` does not list, cannot be listed again"),
        "{said}"
    );
    assert_eq!(files(&path), before);
}

/// As another program leaves it that rewrites a folder of ours.
#[test]
fn columns_that_are_made_up_for_others_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..2).unwrap();
    fs::remove_file(path.join("meta/swm.json")).unwrap();
    let mut dataset = open(&path).unwrap();
    let skipped: Vec<&str> = dataset.info().skipped.iter().map(|(name, _)| name.as_str()).collect();
    let has = |name: &str| dataset.schema().fields().iter().any(|field| field.name == name);
    assert!(has("step_idx") && has("ep_idx") && has("action"), "{skipped:?}");
    assert_eq!(dataset.num_episodes(), 2);
    (0..2).for_each(|episode| dataset.check_episode(episode).unwrap());
}

fn fps(folder: &Path) -> serde_json::Value {
    let info = fs::read(folder.join("meta/info.json")).unwrap();
    serde_json::from_slice::<serde_json::Value>(&info).unwrap()["fps"].clone()
}

#[test]
fn rows_keep_their_rate() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, rows_per_second, options: WriteOptions| {
        let path = folder.path().join(name);
        let mut writer = create_in(built_in(), &path, &options, None).unwrap();
        writer.begin(&schema(), &swm_core::Metadata { rows_per_second, ..metadata() }).unwrap();
        writer.write_episode(&episode(&schema(), 0, 3)).unwrap();
        writer.finish().unwrap();
        fps(&path)
    };
    let options = WriteOptions::default();
    assert_eq!(write("pusht.lerobot", Some(10.0), options.clone()), 10);
    assert_eq!(write("third.lerobot", Some(1.0 / 0.03), options.clone()), 33);
    assert_eq!(write("unknown.lerobot", None, options.clone()), 25);
    assert_eq!(write("asked.lerobot", Some(10.0), options.frames_per_second(Some(50.0))), 50);

    // Of another program's folder, there and back.
    let [there, back] = ["there.h5", "back.lerobot"].map(|name| folder.path().join(name));
    for (from, to) in [(&golden("lerobot_v3.0"), &there), (&there, &back)] {
        let mut sources = vec![open(from).unwrap()];
        let pieces = all(&sources);
        copy(&mut sources, &pieces, to, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    }
    assert_eq!(fps(&back), fps(&golden("lerobot_v3.0")));
}

/// A folder of version 3.0 with its images in its table, `file(row)` each; the table's row groups cut through its episodes of 4 and 6 rows.
fn with_images_in_tables(path: &Path, shape: [usize; 3], file: impl Fn(usize) -> Option<Vec<u8>>) {
    use parquet::basic::{ConvertedType, Repetition, Type as Physical};
    use parquet::data_type::{ByteArray, ByteArrayType, Int64Type};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::types::Type;

    const CAMERA: &str = "observation.images.top";
    copied(&golden("lerobot_v3.0"), path);
    let info = fs::read_to_string(path.join("meta/info.json")).unwrap();
    let mut info: serde_json::Value = serde_json::from_str(&info).unwrap();
    info["features"] = serde_json::json!({
        CAMERA: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]},
        "frame_index": {"dtype": "int64", "shape": [1], "names": null},
    });
    fs::write(path.join("meta/info.json"), info.to_string()).unwrap();
    let leaf = |name: &str, physical, converted| {
        let leaf = Type::primitive_type_builder(name, physical).with_converted_type(converted);
        std::sync::Arc::new(leaf.with_repetition(Repetition::OPTIONAL).build().unwrap())
    };
    let bytes = leaf("bytes", Physical::BYTE_ARRAY, ConvertedType::NONE);
    let name = leaf("path", Physical::BYTE_ARRAY, ConvertedType::UTF8);
    let image =
        Type::group_type_builder(CAMERA).with_repetition(Repetition::OPTIONAL).with_fields(vec![bytes, name]);
    let step = leaf("frame_index", Physical::INT64, ConvertedType::NONE);
    let schema = Type::group_type_builder("schema").with_fields(vec![image.build().unwrap().into(), step]);
    let out = fs::File::create(path.join("data/chunk-000/file-000.parquet")).unwrap();
    let mut writer =
        SerializedFileWriter::new(out, schema.build().unwrap().into(), std::sync::Arc::default()).unwrap();
    for rows in [0..3, 3..10] {
        let mut group = writer.next_row_group().unwrap();
        let files: Vec<Option<Vec<u8>>> = rows.clone().map(&file).collect();
        let depths: Vec<i16> = files.iter().map(|file| if file.is_some() { 2 } else { 1 }).collect();
        let files: Vec<ByteArray> = files.into_iter().flatten().map(ByteArray::from).collect();
        let names: Vec<ByteArray> = rows.clone().map(|row| format!("{row}.png").as_str().into()).collect();
        for (values, depths) in [(&files, depths), (&names, vec![2; rows.len()])] {
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<ByteArrayType>().write_batch(values, Some(&depths), None).unwrap();
            column.close().unwrap();
        }
        let mut column = group.next_column().unwrap().unwrap();
        let steps: Vec<i64> = rows.map(|row| row as i64).collect();
        column.typed::<Int64Type>().write_batch(&steps, Some(&vec![1; steps.len()]), None).unwrap();
        column.close().unwrap();
        group.close().unwrap();
    }
    writer.close().unwrap();
}

/// An image of 6 x 8 pixels in one color.
fn plain(row: usize) -> Vec<u8> {
    [20 * row as u8, 100, 7].repeat(6 * 8)
}

#[test]
fn images_in_tables_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    with_images_in_tables(&path, [6, 8, 3], |row| {
        Some(match row % 2 {
            0 => swm_media::png::encode(6, 8, &plain(row)).unwrap(),
            _ => swm_media::jpeg::encode(6, 8, 3, &plain(row), 100).unwrap(),
        })
    });
    let mut dataset = open(&path).unwrap();
    assert!(dataset.info().skipped.is_empty(), "{:?}", dataset.info().skipped);
    let pixels = dataset.schema().index("pixels").expect("the first camera");
    assert_eq!(dataset.schema().fields()[pixels].shape, [6, 8, 3]);
    let is_near = |found: &[u8], row: usize| {
        let apart = found.iter().zip(plain(row)).map(|(&a, b)| a.abs_diff(b)).max();
        assert!(apart <= Some(if row.is_multiple_of(2) { 0 } else { 3 }), "row {row}: {apart:?}");
    };
    for (episode, first, rows) in [(0, 0, 4), (1, 4, 6), (0, 0, 4)] {
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        dataset.read(episode, 0..rows, &mut batch).unwrap();
        let images = batch.get::<u8>("pixels").unwrap().chunks_exact(6 * 8 * 3);
        images.enumerate().for_each(|(at, image)| is_near(image, first + at));
        assert_eq!(batch.get::<i64>("frame_index").unwrap()[0], first as i64);
    }
    let mut out = vec![0; 2 * 6 * 8 * 3];
    let steps = Steps { first: 1, count: 2, stride: 3 };
    dataset.read_column(pixels, 1, steps, swm_core::SliceMut::U8(&mut out)).unwrap();
    out.chunks_exact(6 * 8 * 3).zip([5, 8]).for_each(|(image, row)| is_near(image, row));
    mutate("images in tables", &path);
}

#[test]
fn images_in_tables_that_cannot_be_read_are_left_out_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let left_out = |name: &str, shape, file: &dyn Fn(usize) -> Option<Vec<u8>>| {
        let path = folder.path().join(name);
        with_images_in_tables(&path, shape, file);
        let skipped = open(&path).unwrap().info().skipped.clone();
        assert_eq!((skipped.len(), skipped[0].0.as_str()), (1, "observation.images.top"));
        skipped[0].1.clone()
    };
    let png = |row| Some(swm_media::png::encode(6, 8, &plain(row)).unwrap());
    let reason = left_out("size", [8, 8, 3], &png);
    assert!(reason.contains("[6, 8, 3], not [8, 8, 3]"), "{reason}");
    let reason = left_out("depth", [6, 8, 1], &png);
    assert!(reason.contains("not 3 colors"), "{reason}");
    let reason = left_out("outside", [6, 8, 3], &|_| None);
    assert!(reason.contains("some values are missing"), "{reason}");
    let reason = left_out("damaged", [6, 8, 3], &|_| Some(b"no image".to_vec()));
    assert!(reason.contains("PNG") || reason.contains("png"), "{reason}");
}
