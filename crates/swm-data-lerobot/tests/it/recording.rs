//! Folders of ours: recorded, continued, repaired, copied.

use std::fs;
use std::path::Path;

use swm_data::testing::mutations::files;
use swm_data::tools::copy::all;
use swm_data::{DataError, WriteMode, WriteOptions, create_in};

use crate::golden;
use crate::support::{assert_alike, contents, episode, metadata, record, rows_of, schema};
use crate::{FORMATS, copy, create, open, registry};

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
    // The action of the second row is NaN in the episodes that have one; of images, every tenth counts.
    assert_eq!(found["action"]["count"][0], rows - 4);
    let frames: usize = (0..5).map(|episode| rows_of(episode).div_ceil(10)).sum();
    assert_eq!(found["observation.images.pixels"]["count"][0], frames);
    let all = found.as_object().unwrap().values().flat_map(|of| of.as_object().unwrap().values());
    assert!(all.flat_map(|list| list.as_array().unwrap()).all(|value| value.is_number() || value.is_array()));
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
    assert!(message.contains("no dataset in the format"), "{message}");
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
    assert!(said.contains("lists 0 of the 3 episodes") && said.contains("`swm verify` with `fix`"), "{said}");
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

fn fps(folder: &Path) -> serde_json::Value {
    let info = fs::read(folder.join("meta/info.json")).unwrap();
    serde_json::from_slice::<serde_json::Value>(&info).unwrap()["fps"].clone()
}

#[test]
fn rows_keep_their_rate() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, rows_per_second, options: WriteOptions| {
        let path = folder.path().join(name);
        let mut writer = create_in(registry(), &path, &options, None).unwrap();
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
