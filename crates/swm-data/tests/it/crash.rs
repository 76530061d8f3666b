//! Recordings that end badly: killed, or out of space.

use std::io::{BufRead, BufReader};
use std::path::Path;

use swm_data::testing::kills::{self, child, kill, last};
use swm_data::{WriteMode, create, open};

use crate::support::{assert_same, contents, episode, record, rounds, rows_of, schema};

/// The test that is the recording process.
const TEST: &str = "crash::record_until_stopped";

#[test]
fn record_until_stopped() {
    kills::record_until_stopped();
}

/// Kills a recording of this name 20 times, or many recordings, and looks at what each left, of so many episodes.
fn kill_each(name: &str, look: impl Fn(&Path, usize)) {
    for _ in 0..rounds(1, 12) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let episodes = kill(&path, TEST, 20);
        look(&path, episodes);
    }
}

#[test]
fn a_killed_recording_keeps_what_it_committed_and_can_be_continued() {
    kill_each("data.h5", |path, _| {
        // A clean end: plain opening works.
        hdf5_metno::File::open(path).unwrap();
    });
}

#[test]
fn a_killed_folder_keeps_what_it_committed_and_can_be_continued() {
    kill_each("data.folder", assert_whole);
}

#[cfg(feature = "video")]
#[test]
fn killed_videos_keep_what_they_committed_and_can_be_continued() {
    kill_each("data.video", assert_whole);
}

#[test]
fn a_killed_log_keeps_what_it_committed_and_can_be_continued() {
    kill_each("data.mcap", |path, episodes| {
        let mut dataset = open(path).unwrap();
        (0..episodes).for_each(|episode| dataset.check_episode(episode).unwrap());
    });
}

/// Every checksum is right, and other programs can open the arrays.
fn assert_whole(path: &Path, episodes: usize) {
    let mut dataset = open(path).unwrap();
    assert!(dataset.info().has_checksums);
    for index in 0..episodes {
        dataset.check_episode(index).unwrap();
    }
    for entry in std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.extension().is_some_and(|extension| extension == "npz") {
            let mut archive = zip::ZipArchive::new(std::fs::File::open(&entry).unwrap()).unwrap();
            // Reading to the end compares the checksum.
            std::io::copy(&mut archive.by_name("arr_0.npy").unwrap(), &mut std::io::sink()).unwrap();
        }
    }
}

#[test]
fn a_full_disk_is_an_error_and_costs_no_finished_episode() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let mut committed = 0;
    // Limits on the size of the file, in the shell's blocks of 512 or 1024 bytes: too little for a file at all, for
    // an episode, for more than a few; and again the same, now that the file is full.
    for blocks in [1, 8, 40, 1000, 5000, 5000, 12000, 12000] {
        let output = child(&path, TEST, &format!("trap '' XFSZ; ulimit -f {blocks};")).output().unwrap();
        assert!(output.status.code().is_some(), "{blocks} blocks: ended by {}", output.status);
        let lines: Vec<String> = String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned).collect();
        if let Some(failure) = lines.iter().find(|line| line.starts_with("failed")) {
            let parts = ["data.h5", "episodes are safe", "File too large"];
            assert!(parts.iter().all(|part| failure.contains(part)), "{failure}");
        }
        committed = last(&lines, "written ").unwrap_or(committed);
        let held = if path.exists() { open(&path).unwrap().num_episodes() } else { 0 };
        assert_eq!(held, committed, "{blocks} blocks: {lines:?}");
    }
    assert!(committed > 3, "the limits were too tight for this test");
    record(&path, WriteMode::Append, committed..committed + 2).unwrap();
    let read = contents(&path);
    assert_eq!(read.len(), committed + 2);
    for (index, batch) in read.iter().enumerate() {
        assert_same(&episode(&schema(), index, rows_of(index)), batch);
    }
}

#[test]
fn a_recording_can_be_read_while_it_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let mut process = child(&path, TEST, "").spawn().unwrap();
    let mut lines = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
    lines.by_ref().find(|line| line == "written 6").unwrap();
    let read = contents(&path);
    let busy = create(&path, WriteMode::Append, None).err().unwrap().to_string();
    let first =
        if cfg!(unix) { format!("process {} on ", process.id()) } else { "is being written".to_owned() };
    process.kill().unwrap();
    process.wait().unwrap();
    assert!(read.len() >= 6 && busy.contains(&first), "{} episodes, {busy}", read.len());
    for (index, batch) in read.iter().enumerate() {
        assert_same(&episode(&schema(), index, rows_of(index)), batch);
    }
}

#[test]
fn a_writer_that_was_killed_while_it_opened_the_file_locks_nobody_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..2).unwrap();
    // What the library leaves between opening for writing and entering SWMR mode: its mark, and nothing else.
    let marked = {
        let builder = hdf5_metno::File::with_options();
        let _open = builder.open_rw(&path).unwrap();
        std::fs::read(&path).unwrap()
    };
    assert_eq!(marked[11], 1, "the library marks files otherwise than it used to");
    std::fs::write(&path, &marked).unwrap();
    assert!(hdf5_metno::File::open(&path).is_err());
    assert_eq!(contents(&path).len(), 2);
    std::fs::write(&path, &marked).unwrap();
    assert_eq!(record(&path, WriteMode::Append, 2..3).unwrap(), 2);
    assert_eq!(contents(&path).len(), 3);
}
