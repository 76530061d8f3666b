//! Where nobody reads the standard output or error, or their disk is full: no command panics, and none stops amid its work.

#![cfg(target_os = "linux")]

use std::fs;
use std::path::Path;
use std::process::{Output, Stdio};

use crate::evaluation::manifest;
use crate::jobs::{Cluster, collect, collect_line_by_line, ok};
use crate::preload::Preload;
use crate::support::{Folder, PUSHT, record, short_recording, swm, swm_ok};

/// What a stream of the command leads to.
#[derive(Clone, Copy, Debug)]
enum To {
    /// A pipe that nobody reads.
    ClosedPipe,
    FullDisk,
}

impl To {
    fn open(self) -> Stdio {
        match self {
            Self::ClosedPipe => std::io::pipe().expect("the system has pipes").1.into(),
            Self::FullDisk => {
                fs::File::options().write(true).open("/dev/full").expect("Linux has this device").into()
            }
        }
    }
}

/// Runs `swm`; `out` and `err` are where its streams lead to instead of to this test.
fn run(args: &[String], out: Option<To>, err: Option<To>) -> Output {
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let mut command = swm(&args);
    for (name, stream) in [("out", out), ("err", err)] {
        let Some(stream) = stream else { continue };
        match name {
            "out" => command.stdout(stream.open()),
            _ => command.stderr(stream.open()),
        };
    }
    command.output().expect("the command under test starts")
}

fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(str::to_owned).collect()
}

#[test]
fn a_recording_is_whole_where_nobody_reads_its_notes() {
    let folder = Folder::new();
    let lines = |name: &str| {
        let out = folder.path(name);
        let more = ["--episodes", "40", "--seed", "1", "--report-every", "0", "--out", &out];
        (short_recording(&more).into_iter().map(str::to_owned).collect::<Vec<_>>(), out)
    };
    let (first, whole) = lines("whole.h5");
    assert_eq!(run(&first, None, None).status.code(), Some(0));
    for (name, err) in [("pipe.h5", To::ClosedPipe), ("disk.h5", To::FullDisk)] {
        let (line, out) = lines(name);
        assert_eq!(run(&line, None, Some(err)).status.code(), Some(0), "{err:?}");
        assert!(fs::read(&out).unwrap() == fs::read(&whole).unwrap(), "{err:?}: another recording");
    }
}

#[test]
fn every_command_ends_as_it_would_where_its_streams_are_gone() {
    let folder = Folder::new();
    let data = record(&folder, "a.h5", "--episodes 3 --max-steps 6 --image-size none --seed 2");
    let other = record(&folder, "b.h5", "--episodes 3 --max-steps 6 --image-size none --seed 3");
    let task = manifest(&folder, "historic", "m.toml", &[]);
    let out = |name: &str| folder.path(name);
    let all = [
        "envs".to_owned(),
        format!("fovs {PUSHT}"),
        "solvers".to_owned(),
        "doctor".to_owned(),
        format!("inspect {data}"),
        format!("stats {data}"),
        format!("verify {data}"),
        format!("diff {data} {other}"),
        format!("convert {data} {}", out("c.mcap")),
        format!("merge {data} {other} --out {}", out("d.h5")),
        format!("split {data} --out {}", out("{}.h5")),
        format!("replay {data}"),
        format!("manifest show {task}"),
        format!(
            "manifest make {PUSHT} --tier moderate --dataset {data} --episodes 2 --out {}",
            out("n.toml")
        ),
        format!("eval {PUSHT} --policy random --episodes 2 --budget 3"),
        format!("eval --manifest {task} --policy random --reference none --out {}", out("eval")),
        format!("verify-result {}", out("eval")),
        format!("compare {}", out("eval")),
        format!("report {} --out {}", out("eval"), out("r.html")),
        format!("render {PUSHT} --out {} --steps 2", out("r.png")),
        format!("new-env sample --out {}", out("plugin")),
        "completions bash".to_owned(),
        format!("jobs {}", out("none")),
        format!("inspect {}", out("none.h5")),
        "no-such-command".to_owned(),
        "--version".to_owned(),
        "--help".to_owned(),
    ];
    // What a command makes is made by the first run, and found by the others.
    for line in &all {
        run(&words(line), None, None);
    }
    for line in &all {
        let line = words(line);
        let expected = run(&line, None, None).status.code();
        for (out, err, what) in [
            (None, Some(To::ClosedPipe), "nobody reads stderr"),
            (None, Some(To::FullDisk), "stderr on a full disk"),
            (Some(To::ClosedPipe), Some(To::ClosedPipe), "nobody reads"),
        ] {
            assert_eq!(run(&line, out, err).status.code(), expected, "{what}: swm {line:?}");
        }
        let full = run(&line, Some(To::FullDisk), None);
        let message = String::from_utf8_lossy(&full.stderr);
        assert!(!message.contains("panicked"), "swm {line:?}:\n{message}");
        assert!(matches!(full.status.code(), Some(0..=2)), "swm {line:?}: {:?}", full.status);
    }
}

#[test]
fn tasks_of_a_job_go_on_where_nobody_reads_their_notes() {
    for to in [To::ClosedPipe, To::FullDisk] {
        let cluster = Cluster::new();
        let job = cluster.path("job");
        ok(&cluster.submit(&["--on", "script"], "2", &collect("4")));
        for more in ["--all", "--finish"] {
            let status = run(&words(&format!("task {job} {more}")), Some(To::ClosedPipe), Some(to)).status;
            assert_eq!(status.code(), Some(0), "{more}, {to:?}");
        }
        assert!(Path::new(&cluster.path("job/result.h5")).exists());
    }
}

#[test]
fn a_task_on_a_full_disk_is_known_as_failed() {
    let Some(preload) = Preload::new() else { return };
    for full in ["job/logs", "job/parts"] {
        let cluster = Cluster::new();
        let job = cluster.path("job");
        ok(&cluster.submit(&["--on", "script"], "2", &collect_line_by_line("40")));
        // A log that does not end with its line.
        fs::write(cluster.path("job/logs/0001.log"), "killed amid a li").unwrap();
        let output =
            preload.full(swm(&["task", &job, "--index", "1"]), &cluster.path(full)).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{full}: {message}");
        assert!(message.contains("No space left"), "{full}: {message}");
        assert!(Path::new(&cluster.path("job/done/0001.failed")).exists(), "{full}: {message}");
        swm_ok(&["task", &job, "--all"]);
        assert!(!Path::new(&cluster.path("job/done/0001.failed")).exists());
        swm_ok(&["task", &job, "--finish"]);
    }
    // Where nothing more can be written, its state is there still.
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "2", &collect("4")));
    let output = preload.full(swm(&["task", &job, "--index", "2"]), &job).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    let status = swm_ok(&["jobs", &job]);
    assert!(status.contains("failed") && status.contains("there was no space"), "{status}");
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
}
