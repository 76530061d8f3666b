//! File systems of clusters without locks: everything works, gives the same bytes, and has one writer at a time all the same.

#![cfg(target_os = "linux")]

use std::fs;
use std::process::{Command, Stdio};

use crate::jobs::{Cluster, collect, collect_line_by_line, ok, wait_for, whole};
use crate::preload::Preload;
use crate::support::{Folder, swm};

/// `ENOLCK`, `ENOSYS` and `EOPNOTSUPP`: Lustre without `-o flock`, FUSE, NFS without its lock daemon.
const ERRORS: [i32; 3] = [37, 38, 95];

fn succeeds(mut command: Command, what: &str) {
    let output = command.output().expect("the command under test starts");
    assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_job_on_a_file_system_without_locks_gives_the_same_bytes() {
    let Some(preload) = Preload::new() else { return };
    for error in ERRORS {
        let cluster = Cluster::new();
        let job = cluster.path("job");
        let without = |args: &[&str]| preload.without_locks(swm(args), error);
        let submit = ["submit", "--job", &job, "--shards", "3", "--no-copy", "--on", "script", "--"];
        succeeds(without(&[&submit[..], &collect("6")].concat()), "submit");
        succeeds(without(&["task", &job, "--index", "2"]), "task");
        succeeds(without(&["task", &job, "--all"]), "task --all");
        succeeds(without(&["task", &job, "--finish"]), "task --finish");
        let result = fs::read(cluster.path("job/result.h5")).unwrap();
        assert!(result == whole(&cluster.folder, "6"), "error {error}");
        let left = fs::read_dir(cluster.path("job/done")).unwrap().map(|entry| entry.unwrap().file_name());
        assert!(left.into_iter().all(|name| !name.to_string_lossy().contains("lock")));
    }
}

#[test]
fn recordings_of_all_formats_are_made_and_continued_without_locks() {
    let Some(preload) = Preload::new() else { return };
    let folder = Folder::new();
    for error in ERRORS {
        for extension in ["h5", "folder", "mcap"] {
            let out = folder.path(&format!("{error}.{extension}"));
            for episodes in ["2", "4"] {
                let more = ["--episodes", episodes, "--mode", "append", "--out", &out, "-q"];
                succeeds(
                    preload.without_locks(swm(&crate::support::short_recording(&more)), error),
                    extension,
                );
            }
            succeeds(preload.without_locks(swm(&["verify", &out]), error), extension);
        }
    }
}

#[test]
fn there_is_one_writer_without_locks() {
    let Some(preload) = Preload::new() else { return };
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "2", &collect_line_by_line("100000")));
    let task = || preload.without_locks(swm(&["task", &job, "--index", "1"]), ERRORS[0]);
    let mut first = task().stderr(Stdio::null()).spawn().unwrap();
    wait_for("a start", || cluster.text("job/logs/0001.log").contains(" written to "));
    let output = task().output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(75), "{message}");
    assert!(message.contains(&format!("process {}", first.id())), "{message}");
    first.kill().unwrap();
    first.wait().unwrap();
    // What a killed process left is free again.
    let mut second = task().stderr(Stdio::null()).spawn().unwrap();
    wait_for("a second start", || cluster.text("job/logs/0001.log").contains("attempt 2 on "));
    second.kill().unwrap();
    second.wait().unwrap();
}
