//! Descriptions that do not agree with the tables: what `swm verify` says of them.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};
use swm_data::WriteMode;
use swm_data::tools::verify::verify;

use crate::copied;
use crate::golden;
use crate::open;
use crate::support::record;

/// What is wrong with a folder as a whole.
fn told(path: &Path) -> String {
    let report = verify(open(path).unwrap().as_mut(), &mut |_| {});
    let whole = report.problems.into_iter().filter(|problem| problem.episode.is_none());
    whole.map(|problem| problem.reason).collect()
}

fn change(path: &Path, change: impl FnOnce(&mut Json)) {
    let file = path.join("meta/info.json");
    let mut info: Json = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    change(&mut info);
    fs::write(file, info.to_string()).unwrap();
}

/// What is told of a copy of a folder whose description was changed.
fn after(from: &Path, how: impl FnOnce(&mut Json)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("copy");
    copied(from, &path);
    assert_eq!(told(&path), "");
    change(&path, how);
    told(&path)
}

#[test]
fn descriptions_of_other_programs_are_compared_with_the_tables() {
    for version in ["v2.1", "v3.0"] {
        let from = golden(&format!("lerobot_{version}"));
        let says = |how: fn(&mut Json), parts: &[&str]| {
            let message = after(&from, how);
            assert!(parts.iter().all(|part| message.contains(part)), "{version}: {message}");
        };
        says(
            |info| info["fps"] = json!(30),
            &[
                "`meta/info.json`: `fps` is 30, and the timestamps of data/chunk-000/",
                "10.0000 rows per second",
            ],
        );
        says(
            |info| info["total_frames"] = json!(11),
            &["`total_frames` is 11, and the listed episodes have 10"],
        );
        says(|info| info["total_tasks"] = json!(4), &["`total_tasks` is 4, and `meta/tasks.", "has 1"]);
        says(
            |info| info["features"]["force"] = json!({ "dtype": "float32", "shape": [2] }),
            &["the feature `force` is listed, and data/chunk-000/", "has no such column"],
        );
        says(
            |info| info["features"]["action"]["shape"] = json!([5]),
            &["`features.action.shape` is [5], which is 5 values a row, and data/chunk-000/", " values in "],
        );
        says(
            |info| info["features"]["observation.images.top"]["shape"] = json!([32, 40, 3]),
            &[
                "`features.observation.images.top.shape` is [32,40,3], and videos/",
                "frames of 32 x 48 pixels",
            ],
        );
    }
    // Version 3 refuses to open where episodes are not listed.
    let message = after(&golden("lerobot_v2.1"), |info| info["total_episodes"] = json!(5));
    assert!(message.contains("`total_episodes` is 5, and 2 are listed"), "{message}");
    // Channels may come first.
    let turned = |info: &mut Json| info["features"]["observation.images.top"]["shape"] = json!([3, 32, 48]);
    assert_eq!(after(&golden("lerobot_v2.1"), turned), "");
}

#[test]
fn a_task_that_is_not_listed_is_damage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("copy");
    copied(&golden("lerobot_v2.1"), &path);
    fs::write(path.join("meta/tasks.jsonl"), "{\"task_index\": 7, \"task\": \"push\"}\n").unwrap();
    let message = told(&path);
    let part = "`task_index` is 0 in row 0, and `meta/tasks.jsonl` has the tasks 7";
    assert!(
        message.contains("data/chunk-000/episode_000000.parquet: ") && message.contains(part),
        "{message}"
    );
    fs::write(path.join("meta/tasks.jsonl"), "push\n").unwrap();
    assert!(told(&path).contains("`meta/tasks.jsonl`"));

    let path = folder.path().join("other");
    copied(&golden("lerobot_v3.0"), &path);
    fs::remove_file(path.join("meta/tasks.parquet")).unwrap();
    let message = told(&path);
    let part = "data/chunk-000/file-000.parquet: `task_index` is 0, and `meta/tasks.parquet` is not there";
    assert!(message.contains(part), "{message}");
}

#[test]
fn descriptions_of_ours_are_compared_with_the_columns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..4).unwrap();
    let message = after(&path, |info| info["fps"] = json!(50));
    assert!(message.contains("`fps` is 50, and `meta/swm.json` has 25 frames per second"), "{message}");
    assert!(message.contains("25.0000 rows per second"), "{message}");
    let message = after(&path, |info| info["features"]["reward"]["shape"] = json!([3]));
    assert!(message.contains("`features.reward.shape` is [3], and the column is [1]"), "{message}");
    let message = after(&path, |info| drop(info["features"].as_object_mut().unwrap().remove("reward")));
    assert!(
        message.contains("`features` is without `reward`, and `meta/swm.json` has that column"),
        "{message}"
    );
    let message = after(&path, |info| info["total_frames"] = json!(1));
    assert!(message.contains("`total_frames` is 1, and the listed episodes have "), "{message}");
    // As a kill between the list and the description leaves it.
    assert_eq!(after(&path, |info| info["total_episodes"] = json!(3)), "");
}
