//! Jobs on a real HyperQueue with three workers, which `tests/cluster/hq.sh` starts. Where there is no program `hq` (on the PATH, or
//! named by `SWM_HQ`) the test says so and passes.

#![cfg(unix)]

use std::fs;
use std::process::{Command, Output};

use crate::jobs::{collect_line_by_line, ok, wait_for, whole};
use crate::support::{Folder, root, swm};

/// What the script says if it cannot run here.
const SKIPPED: i32 = 77;

/// A running server with workers; stopped when this is dropped.
struct HyperQueue {
    folder: Folder,
    path: String,
}

impl HyperQueue {
    fn start() -> Option<Self> {
        let path = std::env::var("PATH").expect("there is a PATH");
        let path = match std::env::var("SWM_HQ") {
            Ok(hq) => format!("{}:{path}", std::path::Path::new(&hq).parent()?.display()),
            Err(_) => path,
        };
        let hq = Self { folder: Folder::new(), path };
        let up = hq.script(&["up"]);
        if up.status.code() == Some(SKIPPED) {
            println!("skipped: {}", String::from_utf8_lossy(&up.stderr).trim());
            return None;
        }
        ok(&up);
        Some(hq)
    }

    fn script(&self, args: &[&str]) -> Output {
        let mut command = Command::new(root().join("tests/cluster/hq.sh"));
        command.args(args).env("SWM_HQ_ROOT", self.folder.path("hq"));
        command.output().expect("the script starts")
    }

    fn swm(&self, args: &[&str]) -> Output {
        let mut command = swm(args);
        command.env("PATH", &self.path).env("HQ_SERVER_DIR", self.folder.path("hq/server"));
        command.output().expect("the command starts")
    }
}

impl Drop for HyperQueue {
    fn drop(&mut self) {
        // A test that fails leaves no daemons either.
        let _ = self.script(&["down"]);
    }
}

#[test]
fn a_lost_worker_does_not_change_a_result() {
    let Some(hq) = HyperQueue::start() else { return };
    let whole = whole(&hq.folder, "1200");
    let job = hq.folder.path("job");
    let submit = ["submit", "--job", &job, "--on", "hq", "--shards", "6", "--no-copy", "--"];
    ok(&hq.swm(&[&submit[..], &collect_line_by_line("1200")].concat()));
    wait_for("a shard", || {
        fs::read_to_string(format!("{job}/logs/0001.log")).is_ok_and(|text| text.contains(" written to "))
    });
    ok(&hq.script(&["kill-worker", "1"]));
    wait_for("the result", || fs::metadata(format!("{job}/finished.json")).is_ok());
    assert!(fs::read(format!("{job}/result.h5")).unwrap() == whole);
    assert!(ok(&hq.swm(&["submit", "--job", &job])).contains("nothing to submit"));
}
