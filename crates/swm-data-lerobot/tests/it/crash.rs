//! Recordings that are killed.

use swm_data::testing::kills::{kill_in, record_until_stopped_in};
use swm_data::testing::rounds;

use crate::{open, registry};

/// The test that is the recording process.
const TEST: &str = "crash::record_until_stopped";

#[test]
fn record_until_stopped() {
    record_until_stopped_in(registry());
}

#[test]
fn a_killed_folder_keeps_what_it_committed_and_can_be_continued() {
    for _ in 0..rounds(1, 12) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.lerobot");
        let episodes = kill_in(registry(), &path, TEST, 20);
        let mut dataset = open(&path).unwrap();
        (0..episodes).for_each(|episode| dataset.check_episode(episode).unwrap());
    }
}
