//! The data format of this crate by what every format must stand: all types come back, recordings are continued, replaced or
//! refused, and neither kills nor foreign bytes do harm.

use std::fs;
use std::path::{Path, PathBuf};

use ice_rink::{JSONL, registry};
use swm::data::testing::{
    assert_same, contents_in, episode, metadata, mutations, record_in, rows_of, schema,
};
use swm::data::{DataError, DatasetWriter, WriteMode};
use swm_core::{BoxError, Metadata};

fn dataset(folder: &tempfile::TempDir) -> PathBuf {
    folder.path().join("data.jsonl")
}

fn record(path: &Path, mode: WriteMode, episodes: std::ops::Range<usize>) -> Result<u64, BoxError> {
    record_in(&registry(), path, mode, episodes)
}

fn append(path: &Path) -> Result<Box<dyn DatasetWriter>, DataError> {
    JSONL.create(path, &WriteMode::Append.into())
}

fn check(path: &Path, episodes: usize) {
    let read = contents_in(&registry(), path);
    assert_eq!(read.len(), episodes);
    for (index, read) in read.iter().enumerate() {
        assert!(read.get::<i32>("ep_idx").unwrap().iter().all(|&number| number == index as i32));
        assert_same(&episode(&schema(), index, rows_of(index)), read);
    }
}

#[test]
fn every_type_comes_back_and_recordings_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(&folder);
    record(&path, WriteMode::Error, 0..2).unwrap();
    assert_eq!(record(&path, WriteMode::Append, 2..3).unwrap(), 2);
    check(&path, 3);
    let dataset = JSONL.open(&path).unwrap();
    assert_eq!((dataset.info().format, &*dataset.info().runs), ("jsonl", &[(0, metadata())][..]));
    assert!(record(&path, WriteMode::Error, 0..1).unwrap_err().to_string().contains("exists already"));
    record(&path, WriteMode::Overwrite, 0..1).unwrap();
    check(&path, 1);
    let writer = append(&path).unwrap();
    let message = append(&path).err().unwrap().to_string();
    assert!(message.contains("is being written by process"), "{message}");
    drop(writer);
}

/// A file only grows, so that a kill at any moment leaves some first part of it.
#[test]
fn a_recording_that_was_killed_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(&folder);
    record(&path, WriteMode::Error, 0..2).unwrap();
    let bytes = fs::read(&path).unwrap();
    for cut in (0..bytes.len()).step_by(bytes.len() / 23).chain([bytes.len() - 1]) {
        fs::write(&path, &bytes[..cut]).unwrap();
        let there = JSONL.open(&path).map_or(0, |dataset| dataset.num_episodes());
        assert!(there < 2, "an episode is seen that was not committed");
        assert_eq!(record(&path, WriteMode::Append, there..2).unwrap(), there as u64, "cut at {cut}");
        assert_eq!(fs::read(&path).unwrap(), bytes, "cut at {cut}");
    }
    fs::write(&path, &bytes[..bytes.len() - 7]).unwrap();
    assert!(JSONL.repair(&path, false).unwrap()[0].contains("unfinished"));
    assert!(JSONL.repair(&path, true).unwrap()[0].contains("unfinished"));
    assert!(JSONL.repair(&path, true).unwrap().is_empty());
    check(&path, 1);
}

/// A run without episodes is forgotten, whatever it was.
#[test]
fn a_run_that_ended_before_its_first_episode_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(&folder);
    let begin = |metadata: &Metadata| append(&path).unwrap().begin(&schema(), metadata).unwrap();
    let runs = || JSONL.open(&path).unwrap().info().runs.to_vec();
    let other = Metadata { seed: 8, ..metadata() };
    assert_eq!(begin(&other), 0);
    assert!(!path.exists(), "a file without episodes is removed with its writer");
    record(&path, WriteMode::Append, 0..2).unwrap();
    let bytes = fs::read(&path).unwrap();
    assert_eq!(runs(), [(0, metadata())]);
    assert_eq!(begin(&other), 2);
    assert_eq!(runs(), [(0, metadata()), (2, other)]);
    assert_eq!(begin(&metadata()), 2);
    assert_eq!(fs::read(&path).unwrap(), bytes);
}

#[test]
fn a_file_of_somebody_else_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(&folder);
    fs::write(&path, "notes without an end of line").unwrap();
    assert!(record(&path, WriteMode::Append, 0..1).is_err());
    assert_eq!(fs::read(&path).unwrap(), b"notes without an end of line");
}

#[test]
fn changed_files_are_refused_or_read_but_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(&folder);
    mutations::seed_in(&registry(), &path);
    mutations::mutate_for("jsonl", &path, &mut |path| mutations::play_in(&registry(), path));
}
