//! Datasets of several files, or records, of which some lack an array that others have.

use std::path::Path;

use swm_data::Dataset;
use swm_data::tools::verify::verify;

use crate::open;
use crate::published::{column_of, numbers, rows};
use crate::varied::{has_note, npz, put};

/// Values of a column in one episode; NaN is text, so that it is equal to itself.
pub(crate) fn values(dataset: &mut dyn Dataset, name: &str, episode: usize) -> Vec<String> {
    let (column, length) = (column_of(dataset, name), dataset.episode_len(episode));
    numbers(&rows(dataset, column, episode, 0, length)).iter().map(f64::to_string).collect()
}

/// Asserts that a column is missing in one of two episodes, with a note that names it by its path.
pub(crate) fn assert_partial(path: &Path, name: &str, old: &str, without: usize, missing: &str) {
    let mut dataset = open(path).unwrap();
    let note = format!("`{old}` is not in 1 of its 2 episodes, the first of which is {without}");
    assert!(has_note(dataset.as_ref(), &note), "{note}: {:?}", dataset.info().notes);
    let gone = values(dataset.as_mut(), name, without);
    assert!(!gone.is_empty() && gone.iter().all(|value| value == missing), "{name}: {gone:?}");
    let there = values(dataset.as_mut(), name, 1 - without);
    assert!(there.iter().any(|value| value != missing), "{name}: {there:?}");
    assert_eq!(verify(dataset.as_mut(), &mut |_| {}).problems, [], "{name}");
}

pub(crate) fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Name, type, shape and bytes of an array.
pub(crate) type Part<'a> = (&'a str, &'a str, &'a [usize], Vec<u8>);

fn whole(name: &str) -> Part<'_> {
    (name, "<i8", &[3], [7_i64, 8, 9].iter().flat_map(|value| value.to_le_bytes()).collect())
}

#[test]
fn archives_of_ogbench_may_lack_an_array() {
    let folder = tempfile::tempdir().unwrap();
    let sound = || -> Vec<Part<'_>> {
        vec![
            ("observations", "<f4", &[3, 1], floats(&[0.0, 1.0, 2.0])),
            ("actions", "<f4", &[3, 1], floats(&[3.0, 4.0, 5.0])),
            ("terminals", "|b1", &[3], vec![0, 0, 1]),
        ]
    };
    let path = |file: usize| folder.path().join(format!("cube-{file}.npz"));
    npz(&path(0), &[sound(), vec![whole("first")]].concat());
    npz(&path(1), &[sound(), vec![whole("later")]].concat());
    assert_partial(folder.path(), "first", "first", 1, "-1");
    assert_partial(folder.path(), "later", "later", 0, "-1");
    npz(&path(1), &sound()[1..]);
    let message = open(folder.path()).err().unwrap().to_string();
    assert!(message.contains("cube-1.npz") && message.contains("`observations`"), "{message}");
}

#[test]
fn episodes_of_dreamer_may_lack_an_array() {
    let folder = tempfile::tempdir().unwrap();
    let sound = || -> Vec<Part<'_>> {
        vec![
            ("action", "<f4", &[3, 1], floats(&[0.0, 1.0, 2.0])),
            ("reward", "<f4", &[3], floats(&[0.0, 4.0, 5.0])),
        ]
    };
    let marks = |name| -> Part<'_> { (name, "|b1", &[3], vec![1, 0, 0]) };
    let path = |file: usize| folder.path().join(format!("2026-{file}.npz"));
    npz(&path(0), &[sound(), vec![whole("first"), marks("is_first"), marks("is_terminal")]].concat());
    let none = ("discount", "<f4", &[3_usize][..], floats(&[1.0, 1.0, 0.0]));
    npz(&path(1), &[sound(), vec![whole("later"), none]].concat());
    assert_partial(folder.path(), "first", "first", 1, "-1");
    assert_partial(folder.path(), "later", "later", 0, "-1");
    // Each by the mark that it has.
    let mut dataset = open(folder.path()).unwrap();
    assert_eq!(values(dataset.as_mut(), "terminated", 0), ["1", "0", "0"]);
    assert_eq!(values(dataset.as_mut(), "terminated", 1), ["0", "0", "1"]);
    npz(&path(1), &[sound()[1..].to_vec(), vec![marks("is_first")]].concat());
    let message = open(folder.path()).err().unwrap().to_string();
    assert!(message.contains("2026-1.npz") && message.contains("`action`"), "{message}");
}

#[test]
fn files_of_aloha_may_lack_an_array() {
    let folder = tempfile::tempdir().unwrap();
    for (episode, extra) in ["observations/first", "observations/later"].into_iter().enumerate() {
        let file = hdf5_metno::File::create(folder.path().join(format!("episode_{episode}.hdf5"))).unwrap();
        file.create_group("observations").unwrap();
        for name in ["action", "observations/qpos", extra] {
            put(&file, name, &[3, 2], &[1_f32; 6]);
        }
    }
    assert_partial(folder.path(), "observations.first", "observations/first", 1, "NaN");
    assert_partial(folder.path(), "observations.later", "observations/later", 0, "NaN");
}

#[cfg(feature = "lerobot")]
#[test]
fn tables_of_minari_may_lack_a_column() {
    use std::fs;

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("minari");
    crate::copied(&crate::published::golden("minari_parquet"), &path);
    let table = path.join("data/1/part-0.parquet");
    let sound = fs::read(&table).unwrap();
    // Another name of the same length in all places.
    let renamed = |old: &[u8], new: &[u8]| {
        let mut bytes = sound.clone();
        while let Some(at) = bytes.windows(old.len()).position(|part| part == old) {
            bytes[at..at + old.len()].copy_from_slice(new);
        }
        fs::write(&table, bytes).unwrap();
    };
    renamed(b"desired_goal", b"desired_gaol");
    assert_partial(&path, "desired_goal", "observations/desired_goal", 1, "NaN");
    assert_partial(&path, "observations.desired_gaol", "observations/desired_gaol", 0, "NaN");
    renamed(b"actions", b"actoins");
    let message = open(&path).err().unwrap().to_string();
    assert!(message.contains("1/part-0.parquet") && message.contains("`actions`"), "{message}");
}
