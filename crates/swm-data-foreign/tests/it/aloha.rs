//! HDF5 files of ALOHA and ACT.

use std::fs;

use swm_core::{Column, Dtype};
use swm_data::{OpenOptions, Steps};

use crate::copied;
use crate::published::{check, column_of, golden, lengths, opened, rows};

const SAMPLE: &str = "aloha_toy";

fn top() -> OpenOptions {
    OpenOptions::default().camera(Some("top".to_owned()))
}

#[test]
fn a_file_is_an_episode_and_their_numbers_are_their_order() {
    let names = [
        ("action", "action", 1.0),
        ("observations/qpos", "observations.qpos", 1.0),
        ("observations/qvel", "observations.qvel", 1.0),
    ];
    let dataset = check(SAMPLE, &top(), &names);
    // Of the episodes 0, 2 and 10.
    assert_eq!(lengths(dataset.as_ref()), [4, 3, 5]);
    let info = dataset.info();
    assert_eq!((info.format, info.skipped.len(), info.rows_per_second), ("aloha", 0, Some(50.0)));
    column_of(dataset.as_ref(), "observations.images.angle");
    // Threads read the same files.
    let mut shared = dataset.share();
    let column = column_of(shared.as_ref(), "action");
    rows(shared.as_mut(), column, 2, 0, 5);
}

#[test]
fn several_cameras_are_an_error_that_lists_them() {
    let refused = opened(&golden(SAMPLE), &OpenOptions::default()).err().unwrap().to_string();
    for part in ["camera", "observations.images.angle", "observations.images.top"] {
        assert!(refused.contains(part), "{refused}");
    }
}

#[test]
fn an_episode_is_a_dataset_of_its_own() {
    let dataset = opened(&golden(SAMPLE).join("episode_10.hdf5"), &top()).unwrap();
    assert_eq!(lengths(dataset.as_ref()), [5]);
}

#[test]
fn a_file_of_another_layout_among_them_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mixed");
    copied(&golden(SAMPLE), &path);
    fs::copy(golden("halfcheetah-medium-v2.hdf5"), path.join("episode_3.hdf5")).unwrap();
    let refused = opened(&path, &top()).err().unwrap().to_string();
    assert!(refused.contains("episode_3.hdf5") && refused.contains("`action`"), "{refused}");
}

#[test]
fn a_file_that_changes_while_it_is_open_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changed");
    copied(&golden(SAMPLE), &path);
    let mut dataset = opened(&path, &top()).unwrap();
    fs::copy(path.join("episode_2.hdf5"), path.join("new")).unwrap();
    fs::rename(path.join("new"), path.join("episode_10.hdf5")).unwrap();
    let column = column_of(dataset.as_ref(), "action");
    let mut out = Column::zeros(Dtype::F32, 14);
    let steps = Steps { first: 0, count: 1, stride: 1 };
    let error = dataset.rows(column, 2, steps, out.as_slice_mut()).unwrap_err().to_string();
    assert!(error.contains("episode_10.hdf5") && error.contains("another array"), "{error}");
    dataset.rows(column, 0, steps, out.as_slice_mut()).unwrap();
}
