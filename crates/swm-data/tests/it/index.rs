//! An index of episodes that does not fit the rows: the labels of the rows are compared with it.

use std::fs;
use std::path::Path;

use swm_core::Batch;
use swm_data::tools::verify::verify;
use swm_data::{WriteMode, open};

use crate::support::record;
use crate::types::others;

/// Reads an episode.
fn read(path: &Path, episode: usize) -> Result<(), String> {
    let mut dataset = open(path).unwrap();
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    let rows = 0..dataset.episode_len(episode);
    dataset.read(episode, rows, &mut batch).map_err(|error| error.to_string())
}

fn set_index(path: &Path, lengths: &[i32], offsets: &[i64]) {
    let file = hdf5_metno::File::open_rw(path).unwrap();
    file.dataset("ep_len").unwrap().write(&ndarray::arr1(lengths)).unwrap();
    file.dataset("ep_offset").unwrap().write(&ndarray::arr1(offsets)).unwrap();
}

#[test]
fn rows_of_another_episode_are_refused_in_hdf5() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Error, 0..3).unwrap();
    set_index(&path, &[5, 1, 300], &[0, 0, 6]);
    assert!(read(&path, 0).is_ok() && read(&path, 2).is_ok());
    let message = read(&path, 1).unwrap_err();
    assert!(message.contains("episode 1: its rows are of episode 0"), "{message}");
    // A row too early.
    set_index(&path, &[5, 1, 300], &[0, 5, 5]);
    let message = read(&path, 2).unwrap_err();
    assert!(message.contains("its first row is of episode 1 and its last of episode 2"), "{message}");
    let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
    let told = report.problems.iter().filter(|problem| problem.reason.contains("the index of episodes"));
    let episodes: Vec<Option<usize>> = told.map(|problem| problem.episode).collect();
    assert!(!episodes.is_empty() && episodes.iter().all(|&episode| episode == Some(2)), "{report:?}");
}

#[test]
fn steps_that_do_not_count_are_a_problem() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Error, 0..2).unwrap();
    let wrong = |first: [i64; 5]| -> Vec<String> {
        let steps: Vec<i64> = first.into_iter().chain([0]).collect();
        let file = hdf5_metno::File::open_rw(&path).unwrap();
        file.dataset("step_idx").unwrap().write(&ndarray::arr1(&steps)).unwrap();
        file.close().unwrap();
        let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
        let steps = report.problems.into_iter().filter(|found| found.column.as_deref() == Some("step_idx"));
        steps.map(|found| format!("{:?}: {}", found.episode, found.reason)).collect()
    };
    // From 0 on, from elsewhere, and with frames between the rows.
    for steps in [[0, 1, 2, 3, 4], [7, 8, 9, 10, 11], [0, 5, 10, 15, 20]] {
        assert_eq!(wrong(steps), [""; 0]);
    }
    assert_eq!(wrong([0, 1, 1, 2, 3]), ["Some(0): it does not count: row 2 holds 1 after 1"]);
    assert_eq!(wrong([0, 1, 5, 6, 7]), ["Some(0): it does not count: row 2 holds 5 after 1"]);
}

/// Files of other programs: their episodes may have any numbers, and any order.
#[test]
fn rows_of_two_episodes_are_refused_in_files_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let make = |numbers: &[i32], steps: Option<&[i64]>| {
        let file = hdf5_metno::File::create(&path).unwrap();
        file.new_dataset_builder().with_data(&ndarray::arr1(&[3i32, 2])).create("ep_len").unwrap();
        file.new_dataset_builder().with_data(&ndarray::arr1(&[2i64, 0])).create("ep_offset").unwrap();
        if !numbers.is_empty() {
            file.new_dataset_builder().with_data(&ndarray::arr1(numbers)).create("episode_index").unwrap();
        }
        if let Some(steps) = steps {
            file.new_dataset_builder().with_data(&ndarray::arr1(steps)).create("step_idx").unwrap();
        }
        file.new_dataset_builder().with_data(&ndarray::arr1(&[0f32; 5])).create("state").unwrap();
    };
    make(&[7, 7, 4, 4, 4], None);
    assert!(read(&path, 0).is_ok() && read(&path, 1).is_ok());
    make(&[7, 7, 7, 4, 4], None);
    let message = read(&path, 0).unwrap_err();
    assert!(message.contains("its first row is of episode 7 and its last of episode 4"), "{message}");
    assert!(read(&path, 1).is_ok());
    make(&[], Some(&[0, 1, 0, 1, 2]));
    assert!(read(&path, 0).is_ok() && read(&path, 1).is_ok());
    make(&[], Some(&[0, 1, 2, 0, 1]));
    let message = read(&path, 0).unwrap_err();
    assert!(message.contains("its 3 rows begin at step 2 and end at step 1"), "{message}");
}

#[test]
fn rows_of_two_episodes_are_refused_in_folders() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.folder");
    record(&path, WriteMode::Error, 0..3).unwrap();
    for ours in ["ep_len.json", "ep_len.index"] {
        fs::remove_file(path.join(ours)).unwrap();
    }
    assert!((0..3).all(|episode| read(&path, episode).is_ok()));
    // An index of other rows.
    for name in ["ep_len.npz", "ep_offset.npz"] {
        fs::copy(others("types.folder").join(name), path.join(name)).unwrap();
    }
    assert!(read(&path, 0).is_ok());
    let message = read(&path, 1).unwrap_err();
    assert!(message.contains("its first row is of episode 1 and its last of episode 2"), "{message}");
}
