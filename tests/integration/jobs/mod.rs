//! Jobs without a scheduler: `swm submit --on script`, `swm task` and `swm jobs`.

#![cfg(unix)]

mod interrupted;
mod refusals;
mod results;

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Child, Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::support::{Folder, short_recording, swm, swm_ok};

/// A folder of stand-ins that come first on the PATH.
pub(crate) struct Cluster {
    pub(crate) folder: Folder,
}

impl Cluster {
    pub(crate) fn new() -> Self {
        let cluster = Self { folder: Folder::new() };
        fs::create_dir(cluster.folder.path("bin")).expect("the folder is ours");
        cluster
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.folder.path(name)
    }

    /// Makes a program.
    pub(crate) fn program(&self, name: &str, script: &str) {
        let path = self.path(&format!("bin/{name}"));
        fs::write(&path, format!("#!/bin/bash\nROOT={}\n{script}\n", self.path("")))
            .expect("the folder is ours");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("the folder is ours");
    }

    pub(crate) fn with_path(&self, mut command: Command) -> Command {
        let path = format!("{}:{}", self.path("bin"), std::env::var("PATH").expect("there is a PATH"));
        command.env("PATH", path).env("SWM_ENGINE_TIMEOUT", "120");
        command
    }

    pub(crate) fn swm(&self, args: &[&str]) -> Command {
        self.with_path(swm(args))
    }

    pub(crate) fn submit(&self, on: &[&str], shards: &str, command: &[&str]) -> Output {
        let job = self.path("job");
        let args =
            [&["submit", "--job", &job, "--shards", shards, "--no-copy"], on, &["--"], command].concat();
        self.swm(&args).output().expect("it starts")
    }

    pub(crate) fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_default()
    }
}

pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[track_caller]
pub(crate) fn ok(output: &Output) -> String {
    assert!(output.status.success(), "{}", said(output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[track_caller]
pub(crate) fn fails(status: i32, output: &Output) -> String {
    assert_eq!(output.status.code(), Some(status), "{}", said(output));
    said(output)
}

pub(crate) fn collect(episodes: &'static str) -> Vec<&'static str> {
    short_recording(&["--seed", "3", "--episodes", episodes])
}

/// The same, with a line in the log for every episode.
pub(crate) fn collect_line_by_line(episodes: &'static str) -> Vec<&'static str> {
    [&collect(episodes)[..], &["--report-every", "0"]].concat()
}

/// The bytes of the undivided recording.
pub(crate) fn whole(folder: &Folder, episodes: &'static str) -> Vec<u8> {
    let out = folder.path("whole.h5");
    swm_ok(&[&collect(episodes)[..], &["--out", &out, "--quiet"]].concat());
    fs::read(out).expect("the folder is ours")
}

pub(crate) fn signal(child: &Child, signal: &str) {
    let killed = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(killed.expect("kill is there").success());
}

#[track_caller]
pub(crate) fn wait_for(what: &str, is_there: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_there() {
        assert!(started.elapsed() < Duration::from_secs(60), "waited too long: {what}");
        sleep(Duration::from_millis(2));
    }
}
