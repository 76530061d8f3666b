//! Programs that exit while another thread records, as after a signal.

use std::fs;
use std::path::Path;
use std::process::exit;
use std::time::Duration;

use swm_data::WriteMode;
use swm_data::recording::end_all;
use swm_data::testing::kills::{TARGET, child};

use crate::support::{assert_alike, contents, episode, metadata, record, schema};
use crate::{FORMATS, create};

/// How far the recording of the child has come when it exits.
const STAGE: &str = "SWM_DATA_TEST_STAGE";
const STAGES: [&str; 4] = ["created", "begun", "in the first episode", "in the second episode"];

#[test]
fn exit_while_a_writer_waits() {
    let (Some(path), Ok(stage)) = (std::env::var_os(TARGET), std::env::var(STAGE)) else { return };
    let stage = STAGES.iter().position(|name| *name == stage).unwrap();
    let mut writer = create(Path::new(&path), WriteMode::Append, None).unwrap();
    if stage > 0 {
        writer.begin(&schema(), &metadata()).unwrap();
    }
    if stage > 2 {
        writer.write_episode(&episode(&schema(), 0, 5)).unwrap();
    }
    if stage > 1 {
        writer.write_rows(&episode(&schema(), 1, 3)).unwrap();
    }
    // The policy of the next step takes long, and nobody drops the writer.
    let ended = std::thread::spawn(|| end_all(Duration::from_secs(60))).join().unwrap();
    let waits = std::thread::spawn(move || writer.begin(&schema(), &metadata()).is_ok());
    std::thread::sleep(Duration::from_millis(100));
    assert!(!waits.is_finished());
    exit(if ended { 7 } else { 8 });
}

#[test]
fn in_every_format_an_exit_leaves_what_was_committed_and_nothing_else() {
    for format in FORMATS {
        for stage in STAGES {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("data").with_extension(format.extensions[0]);
            let status =
                child(&path, "exits::exit_while_a_writer_waits", "").env(STAGE, stage).status().unwrap();
            assert_eq!(status.code(), Some(7), "{}, {stage}", format.name);
            let left: Vec<_> =
                fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
            if stage != STAGES[3] {
                assert!(left.is_empty(), "{}, {stage}: {left:?}", format.name);
                continue;
            }
            assert_eq!(left, std::slice::from_ref(&path), "{}, {stage}", format.name);
            assert_eq!(record(&path, WriteMode::Append, 1..2).unwrap(), 1, "{}", format.name);
            let read = contents(&path);
            assert_eq!(read.len(), 2);
            assert_alike(&episode(&schema(), 0, 5), &read[0]);
        }
    }
}
