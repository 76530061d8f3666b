//! Rows of episodes are those that the tables say, and not those that the list counts; and types of others' tables.

use std::fs;
use std::path::Path;

use swm_core::{Batch, Column};
use swm_data::WriteMode;
use swm_data::testing::mutations::mutate_for;
use swm_data::tools::verify::verify;

use crate::copied;
use crate::support::{contents, record};
use crate::types::{assert_kept, others, reason, values};
use crate::{mutate, open};

fn problems(path: &Path) -> Vec<String> {
    let report = verify(open(path).unwrap().as_mut(), &mut |_| {});
    report.problems.into_iter().map(|problem| problem.reason).collect()
}

/// Every row says `[episode, row]`.
fn assert_right(path: &Path) {
    for (episode, batch) in contents(path).iter().enumerate() {
        let expected: Vec<f32> = (0..batch.rows()).flat_map(|row| [episode as f32, row as f32]).collect();
        assert_eq!(batch.get::<f32>("proprio").unwrap(), expected);
    }
}

/// As LeRobot's converter once left it: the episode at the border of two files has the number of the file before.
#[test]
fn an_episode_has_the_rows_that_say_so() {
    assert_right(&others("stale.lerobot"));
    let problems = problems(&others("stale.lerobot"));
    assert_eq!(problems.len(), 1, "{problems:?}");
    for part in [
        "places episode 1 in data/chunk-000/file-000.parquet from row 8 on",
        "its rows are in data/chunk-000/file-001.parquet from row 0 on",
        "places episode 2 in data/chunk-000/file-001.parquet from row 0 on",
        "from row 6 on, where they are read",
    ] {
        assert!(problems[0].contains(part), "{part}: {}", problems[0]);
    }
}

#[test]
fn rows_that_are_nowhere_are_an_error_that_names_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stale.lerobot");
    copied(&others("stale.lerobot"), &path);
    let data = path.join("data/chunk-000");
    // The tables change places: every row is still found.
    fs::rename(data.join("file-000.parquet"), data.join("a.parquet")).unwrap();
    fs::rename(data.join("file-001.parquet"), data.join("file-000.parquet")).unwrap();
    fs::rename(data.join("a.parquet"), data.join("file-001.parquet")).unwrap();
    assert_right(&path);
    // Two copies of a table contradict each other.
    fs::copy(data.join("file-000.parquet"), data.join("file-002.parquet")).unwrap();
    let message = read(&path, 2).unwrap_err();
    assert!(message.contains("the list places episode 2 in data/chunk-000/file-001.parquet"), "{message}");
    assert!(message.contains("not exactly one has its 7 rows"), "{message}");
    fs::remove_file(data.join("file-002.parquet")).unwrap();
    fs::remove_file(data.join("file-000.parquet")).unwrap();
    assert!(read(&path, 0).is_ok());
    let message = read(&path, 1).unwrap_err();
    assert!(message.contains("episode 1 in data/chunk-000/file-000.parquet"), "{message}");
}

fn read(path: &Path, episode: usize) -> Result<(), String> {
    let mut dataset = open(path).unwrap();
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    let rows = 0..dataset.episode_len(episode);
    dataset.read(episode, rows, &mut batch).map_err(|error| error.to_string())
}

/// Tables of ours that changed their places, which a checksum would only tell a verification.
#[test]
fn tables_of_ours_are_compared_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..3).unwrap();
    let expected = contents(&path);
    let data = path.join("data/chunk-000");
    fs::copy(data.join("file-000.parquet"), data.join("file-001.parquet")).unwrap();
    let message = read(&path, 1).unwrap_err();
    assert!(message.contains("file-001.parquet") && message.contains("are of episode 0"), "{message}");
    let again = contents_of(&path, 2);
    assert_eq!(again.get::<f64>("state").unwrap(), expected[2].get::<f64>("state").unwrap());
    assert!(!problems(&path).is_empty());
}

fn contents_of(path: &Path, episode: usize) -> Batch {
    let mut dataset = open(path).unwrap();
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    dataset.read(episode, 0..dataset.episode_len(episode), &mut batch).unwrap();
    batch
}

#[test]
fn numbers_are_kept_or_left_out_with_the_reason() {
    let path = others("types.lerobot");
    ["u32", "u64", "i16", "f16"].into_iter().for_each(|name| assert_kept(&path, name));
    for (name, part) in [
        ("too_large", "the u64 9223372036854775808"),
        ("holes", "1 of its values are missing (null), which only floats and texts may be"),
        ("date", "FIXED_LEN_BYTE_ARRAY"),
        ("events", "structures of 2 parts"),
    ] {
        let reason = reason(&path, name);
        assert!(reason.contains(part), "{name}: {reason}");
    }
    // The action of two rows is.
    let problems = problems(&path);
    assert!(problems.iter().all(|problem| problem.ends_with("holds NaN")), "{problems:?}");
}

/// What a NaN becomes where another program rewrites a table.
#[test]
fn a_null_is_a_nan() {
    let path = others("types.lerobot");
    let Column::F32(reward) = values(&path, "reward") else { panic!("no f32") };
    let Column::F32(half) = values(&path, "half") else { panic!("no f32") };
    for column in [reward, half] {
        assert!(column[4].is_nan());
        let others = column.iter().enumerate().filter(|(row, _)| *row != 4);
        assert!(others.into_iter().all(|(row, &value)| value == row as f32), "{column:?}");
    }
    let Column::F32(action) = values(&path, "action") else { panic!("no f32") };
    assert_eq!(action.len(), 24);
    let is_nan: Vec<usize> = (0..24).filter(|&at| action[at].is_nan()).collect();
    // A list that is missing, and a value of one.
    assert_eq!((is_nan, action[13], &action[22..]), (vec![8, 9, 12], 1.0, &[11.0, -11.0][..]));
}

#[test]
fn no_mutation_makes_it_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("types.lerobot");
    copied(&others("types.lerobot"), &path);
    mutate("types.lerobot", &path);
    // Its rows are found, and a verification does not call it sound.
    let path = folder.path().join("stale.lerobot");
    copied(&others("stale.lerobot"), &path);
    mutate_for("stale.lerobot", &path, &mut |path| {
        let Ok(mut dataset) = open(path) else { return false };
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        drop(dataset.check_whole());
        (0..dataset.num_episodes().min(20)).all(|episode| {
            let rows = 0..dataset.episode_len(episode).min(1000);
            dataset.read(episode, rows, &mut batch).is_ok()
        })
    });
}
