//! Files of manifests, receipts, sweeps and jobs with other numbers than were written: refused in a sentence, or used. No command panics,
//! hangs, or takes the memory of the machine.

#![cfg(unix)]

use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

use crate::evaluation::manifest;
use crate::support::{Folder, short_recording, swm_ok};

/// Memory of the command, in KiB, and what it may take.
const MEMORY_KIB: u64 = 4 << 20;
const PATIENCE: Duration = Duration::from_secs(60);

/// The pointers of all values. Of long lists the first items stand for the others.
fn leaves(json: &Json, at: &str, found: &mut Vec<String>) {
    match json {
        Json::Object(fields) => {
            fields
                .iter()
                .for_each(|(name, value)| leaves(value, &format!("{at}/{}", name.replace('/', "~1")), found));
        }
        Json::Array(items) => {
            found.push(at.to_owned());
            items
                .iter()
                .enumerate()
                .take(1)
                .for_each(|(index, value)| leaves(value, &format!("{at}/{index}"), found));
        }
        _ => found.push(at.to_owned()),
    }
}

/// What a value is replaced with.
fn others(value: &Json) -> Vec<Json> {
    match value {
        Json::Number(_) => vec![json!(0), json!(u64::MAX), json!(-1), json!(1e300)],
        Json::Array(_) => vec![json!([]), json!([u64::MAX])],
        Json::String(_) => vec![json!(""), json!("../../x")],
        _ => vec![json!(u64::MAX)],
    }
}

/// Runs `swm` with a limit on its memory; how it ended is what this test is about.
fn run(line: &str) -> Result<(), String> {
    let script = format!("ulimit -v {MEMORY_KIB}; exec '{}' {line}", env!("CARGO_BIN_EXE_swm-under-test"));
    let mut command = Command::new("bash");
    command.args(["-c", &script]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("bash starts");
    let started = Instant::now();
    let stderr = child.stderr.take().expect("it is piped");
    let reader = std::thread::spawn(move || std::io::read_to_string(stderr).unwrap_or_default());
    let status = loop {
        match child.try_wait().expect("it is our child") {
            Some(status) => break status,
            None if started.elapsed() > PATIENCE => {
                let _ = child.kill();
                let _ = child.wait();
                return Err("it does not end".to_owned());
            }
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    let message = reader.join().expect("it only reads");
    match status.code() {
        Some(0..=2 | 75) if !message.contains("panicked") => Ok(()),
        _ => Err(format!("{status}: {message}")),
    }
}

/// Changes each value of the file, and runs the commands on each change.
fn change_each(file: &str, commands: &[String], failures: &mut Vec<String>) {
    let whole = fs::read(file).expect("it was written by the command");
    let json: Json = serde_json::from_slice(&whole).expect("it was written by the command");
    let mut all = Vec::new();
    leaves(&json, "", &mut all);
    for leaf in all {
        for value in others(json.pointer(&leaf).expect("it was written by the command")) {
            let mut changed = json.clone();
            *changed.pointer_mut(&leaf).expect("it was written by the command") = value.clone();
            fs::write(file, serde_json::to_vec(&changed).expect("it was written by the command"))
                .expect("it was written by the command");
            for command in commands {
                failures
                    .extend(run(command).err().map(|how| format!("{leaf} = {value}: swm {command}: {how}")));
            }
        }
    }
    fs::write(file, whole).expect("it was written by the command");
}

#[test]
fn manifests_and_results_with_other_values_are_refused_or_used() {
    let folder = Folder::new();
    let (task, out) = (manifest(&folder, "historic", "m.json", &[]), folder.path("out"));
    swm_ok(&["eval", "--manifest", &task, "--policy", "random", "--reference", "no-op", "--out", &out, "-q"]);
    let sweep = folder.path("sweep");
    let factors = ["--factors", "block.color", "--values", "grid", "--points", "2"];
    swm_ok(
        &[&["sweep", "--manifest", &task, "--policy", "random", "--out", &sweep, "-q"][..], &factors]
            .concat(),
    );
    let page = folder.path("page.html");
    let mut failures = Vec::new();
    // A budget of many steps would be used.
    change_each(&task, &[format!("manifest show {task}")], &mut failures);
    let receipt = format!("{out}/receipt.json");
    change_each(
        &receipt,
        &[
            format!("compare {out} {out}"),
            format!("report {out} --videos 0 --plans 0 --overwrite --out {page}"),
        ],
        &mut failures,
    );
    let swept = format!("{sweep}/sweep.json");
    change_each(
        &swept,
        &[format!("report {sweep} --videos 0 --plans 0 --overwrite --out {page}")],
        &mut failures,
    );
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn jobs_with_other_values_are_refused_or_used() {
    let folder = Folder::new();
    let job = folder.path("job");
    let command = short_recording(&["--seed", "3", "--episodes", "4"]);
    let submit = ["submit", "--job", &job, "--shards", "2", "--no-copy", "--on", "script", "--"];
    swm_ok(&[&submit[..], &command].concat());
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    let mut failures = Vec::new();
    let commands = [format!("jobs {job}"), format!("task {job} --index 1"), format!("task {job} --finish")];
    for file in ["job.json", "done/0001.json", "finished.json"] {
        change_each(&format!("{job}/{file}"), &commands, &mut failures);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    let message = crate::support::swm_fails(
        2,
        &[
            "submit",
            "--job",
            &folder.path("many"),
            "--shards",
            "18446744073709551615",
            "--on",
            "script",
            "--",
            "collect",
            "swm/TwoRoom-v2",
            "--episodes",
            "4",
        ],
    );
    assert!(message.contains("1..=1000000"), "{message}");
}
