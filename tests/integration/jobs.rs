//! Jobs without a scheduler: `swm submit --on script`, `swm task` and `swm jobs`.

#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::evaluation::{manifest, read};
use crate::support::{Folder, swm, swm_fails, swm_json, swm_ok};

const COLLECT: &[&str] = &[
    "collect",
    "swm/TwoRoom-v2",
    "--policy",
    "noisy-expert:2",
    "--max-steps",
    "6",
    "--image-size",
    "none",
    "--seed",
    "3",
];

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
    [COLLECT, &["--episodes", episodes]].concat()
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

#[test]
fn a_job_by_hand_is_the_undivided_recording() {
    let cluster = Cluster::new();
    let whole = whole(&cluster.folder, "10");
    let job = cluster.path("job");
    let printed = ok(&cluster.submit(&["--on", "script"], "4", &collect("10")));
    assert_eq!(printed.lines().count(), 5);
    assert!(
        printed.contains(&format!("task {job} --index 3\n")) && printed.ends_with("--finish\n"),
        "{printed}"
    );

    swm_ok(&["task", &job, "--index", "3"]);
    let again = swm(&["task", &job]).env("JOB_COMPLETION_INDEX", "2").output().unwrap();
    assert!(ok(&again).is_empty() && said(&again).contains("shard 3 of 4 was done already"));
    let message = swm_fails(1, &["task", &job, "--finish"]);
    assert!(
        message.contains("3 of 4 shards")
            && message.contains("1-2,4")
            && message.contains(&format!("to run them: swm task {job} --all"))
    );
    let status = swm_json(&["jobs", &job]);
    assert_eq!((&status["done"], &status["missing"]), (&1.into(), &serde_json::json!([1, 2, 4])));
    // No engine knows of a shard that runs by hand; its log does.
    fs::write(format!("{job}/logs/0001.log"), "swm task: attempt 1 on n7 by nothing: 0 committed\n").unwrap();
    let page = swm_ok(&["jobs", &job]);
    assert!(page.contains("1 interrupted, 2 not started"), "{page}");
    assert!(page.contains("interrupted: last on n7"), "{page}");
    // A lock tells that a shard is at work here, and by whom.
    let (lock, us) = (format!("{job}/done/0001.lock"), std::process::id());
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    fs::write(&lock, format!("process {us} on {host}")).unwrap();
    let page = swm_ok(&["jobs", &job]);
    assert!(page.contains("1 running, 2 not started"), "{page}");
    assert!(
        page.contains(&format!("running: process {us} on "))
            && page.contains("to do           shards 2,4, by: swm task"),
        "{page}"
    );
    fs::remove_file(lock).unwrap();
    fs::remove_file(format!("{job}/logs/0001.log")).unwrap();
    // Committed episodes count although no log tells of them.
    let parts: Vec<_> =
        fs::read_dir(format!("{job}/parts")).unwrap().map(|entry| entry.unwrap().path()).collect();
    let [done] = parts.as_slice() else { panic!("one shard is done: {parts:?}") };
    let first = done.to_str().unwrap().replace("0003", "0001");
    fs::copy(done, &first).unwrap();
    let status = swm_json(&["jobs", &job]);
    let begun = &status["each"][0];
    assert_eq!(begun["state"], "not started");
    assert!(begun["episodes"].as_u64() >= Some(2), "{begun}");
    assert_eq!(status["progress"], "4 shards: 1 done, 3 not started");
    fs::remove_file(first).unwrap();
    // What is done is a dataset already.
    assert!(swm_ok(&["inspect", &job]).contains("episodes"));
    // A job that is interrupted between two shards is continued from any machine.
    let left = ok(&cluster.submit(&["--on", "script"], "4", &collect("10")));
    assert_eq!(left.lines().count(), 4, "{left}");
    let message = swm_fails(2, &["jobs", "--logs", &job]);
    assert!(message.contains("the join of the shards has no log yet"), "{message}");
    assert!(swm_ok(&["jobs", "--cancel", &job]).contains("nothing to cancel"));
    let ran = swm(&["task", &job, "--all"]).output().unwrap();
    let advice = format!("all shards are done; to join them to the result: swm task {job} --finish");
    assert!(ran.status.success() && said(&ran).contains(&advice), "{}", said(&ran));
    let all = swm(&["jobs"]).current_dir(cluster.path("")).output().unwrap();
    assert!(ok(&all).contains("not joined yet"), "{}", ok(&all));
    swm_ok(&["task", &job, "--finish"]);
    assert!(fs::read(format!("{job}/result.h5")).unwrap() == whole);
    assert!(said(&swm(&["task", &job, "--finish"]).output().unwrap()).contains("was there already"));
    let page = swm_ok(&["jobs", &job]);
    assert!(page.contains("4 done") && page.contains("10 of 10") && page.contains("result.h5"), "{page}");
    let done = read(&format!("{job}/done/0003.json"));
    assert_eq!((&done["range"], &done["attempt"]), (&serde_json::json!([5, 7]), &1.into()));
    assert_eq!(done["sha256"].as_str().unwrap().len(), 64);
    let all = swm(&["jobs"]).current_dir(cluster.path("")).output().unwrap();
    assert!(ok(&all).contains("4 shards: 4 done"));
    let nothing = cluster.swm(&["submit", "--job", &job, "--on", "script"]).output().unwrap();
    assert!(ok(&nothing).contains("nothing to submit: of 4 shards 4 are done"));
}

#[test]
fn evaluations_and_sweeps_are_the_undivided_ones() {
    let cluster = Cluster::new();
    let manifest = manifest(&cluster.folder, "moderate", "m.toml", &["--held-out", "1"]);
    let eval = ["eval", "--manifest", &manifest, "--policy", "weak", "--reference", "random"];
    let sweep = ["sweep", "--manifest", &manifest, "--policy", "weak", "--factors", "agent.scale"];
    for (command, result) in [(&eval, "receipt.json"), (&sweep, "sweep.json")] {
        let (whole, job) = (cluster.path(&format!("{}-whole", command[0])), cluster.path(command[0]));
        swm_ok(&[&command[..], &["--out", &whole, "--quiet"]].concat());
        let submit = ["submit", "--on", "script", "--shards", "3", "--no-copy", "--job", &job, "--"];
        swm_ok(&[&submit[..], command].concat());
        swm_ok(&["task", &job, "--all"]);
        swm_ok(&["task", &job, "--finish"]);
        let [mut whole, mut joined] = [whole, job].map(|dir| read(&format!("{dir}/{result}")));
        for result in [&mut whole, &mut joined] {
            result.as_object_mut().unwrap().remove("wall_time_s");
        }
        assert_eq!(whole, joined, "{result}");
    }
    let message = swm_fails(
        2,
        &[
            "submit",
            "--on",
            "script",
            "--shards",
            "999",
            "--job",
            &cluster.path("a"),
            "--",
            "eval",
            "--manifest",
            &manifest,
            "--policy",
            "weak",
            "--reference",
            "none",
        ],
    );
    assert!(message.contains("there are 5 episodes; use as many shards or fewer"), "{message}");
    assert!(!Path::new(&cluster.path("a")).exists(), "what is refused leaves nothing");
}

#[test]
fn wrong_requests_are_refused_before_anything_is_queued() {
    let cluster = Cluster::new();
    let refused = |on: &str, shards: &str, command: &[&str], reason: &str| {
        let message = fails(2, &cluster.submit(&["--on", on], shards, command));
        assert!(message.contains(reason), "{message}");
        assert!(!Path::new(&cluster.path("job")).exists(), "{message}");
    };
    refused("pbs", "2", &collect("4"), "`pbs` is unknown; there are: slurm, hq, script; script prints");
    refused("slurm:partion=cpu", "2", &collect("4"), "did you mean `partition`?");
    refused("script", "8", &collect("4"), "there are 4 episodes");
    refused("script", "2", &["collect", "swm/TwoRoom-v2", "--policy", "expurt", "--episodes", "4"], "expurt");
    refused("script", "2", &[&collect("4")[..], &["--out", "a.h5"]].concat(), "leave out --out");
    refused("script", "2", &[&collect("4")[..], &["--no-such-option"]].concat(), "--no-such-option");
    refused("script", "2", &["merge", "a", "b"], "`swm merge` cannot be divided");
    refused("script", "2", &["eval", "swm/TwoRoom-v2", "--policy", "expert"], "give --manifest");
    refused("script", "2", &["train", "lewm", "--dataset", "a.h5"], "--each FILE");
    let message = swm_fails(2, &["task", &cluster.path("none"), "--index", "1"]);
    assert!(message.contains("holds no job"), "{message}");
    fs::create_dir(cluster.path("job")).unwrap();
    fs::write(cluster.path("job/data.h5"), "").unwrap();
    let message = fails(2, &cluster.submit(&["--on", "script"], "2", &collect("4")));
    assert!(message.contains("holds no job but other files"), "{message}");
}

#[test]
fn another_request_for_the_same_folder_is_refused() {
    let cluster = Cluster::new();
    let manifest = manifest(&cluster.folder, "moderate", "m.toml", &["--held-out", "1"]);
    let eval = |policy: &'static str| {
        ["eval", "--manifest", &manifest, "--policy", policy, "--reference", "none"].map(str::to_owned)
    };
    let submit = |shards: &str, policy: &'static str| {
        let line = eval(policy);
        cluster.submit(&["--on", "script"], shards, &line.each_ref().map(String::as_str))
    };
    let job = cluster.path("job");
    ok(&submit("2", "weak"));
    ok(&submit("2", "weak"));
    assert!(fails(2, &submit("2", "random")).contains("its arguments"));
    assert!(fails(2, &submit("3", "weak")).contains("its shards: it has 2, not 3"));
    swm_ok(&["task", &job, "--index", "1"]);
    // Touched, it is the same; changed, it is not.
    let text = fs::read_to_string(&manifest).unwrap();
    fs::write(&manifest, &text).unwrap();
    ok(&submit("2", "weak"));
    fs::write(&manifest, format!("{text}\n# changed\n")).unwrap();
    let changed = "has changed since the job was submitted";
    assert!(swm_fails(2, &["task", &job, "--index", "2"]).contains(changed));
    assert!(swm_fails(2, &["submit", "--job", &job]).contains(changed));
    fs::write(&manifest, &text).unwrap();
    let description = format!("{job}/job.json");
    let held = fs::read_to_string(&description).unwrap();
    let program = read(&description)["program"]["sha256"].as_str().unwrap().to_owned();
    fs::write(&description, held.replace(&program, &"0".repeat(64))).unwrap();
    assert!(swm_fails(2, &["task", &job, "--index", "2"]).contains("is not the program of the job"));
    fs::write(&description, held.replace("renderer: swm-render", "renderer: another")).unwrap();
    assert!(swm_fails(2, &["task", &job, "--index", "2"]).contains("results would differ"));
    fs::write(&description, held).unwrap();
    swm_ok(&["task", &job, "--all"]);
}

#[test]
fn the_job_holds_the_program() {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    let submit = ["submit", "--on", "script", "--shards", "2", "--job", &job, "--"];
    let printed = swm_ok(&[&submit[..], &collect("4")].concat());
    assert!(printed.starts_with(&format!("{job}/swm task {job} --index 1")), "{printed}");
    for line in printed.lines() {
        ok(&Command::new("sh").args(["-c", line]).output().unwrap());
    }
    assert!(fs::read(format!("{job}/result.h5")).unwrap() == whole(&cluster.folder, "4"));
}

/// A long shard that is killed or stopped once some episodes are committed, and then continued.
fn interrupted(kind: &str) {
    let cluster = Cluster::new();
    let whole = whole(&cluster.folder, "1200");
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "2", &[&collect("1200")[..], &["--report-every", "0"]].concat()));
    let mut child = swm(&["task", &job, "--index", "1"]).stderr(Stdio::null()).spawn().expect("it starts");
    let log = || cluster.text("job/logs/0001.log");
    wait_for("episodes", || log().matches(" written to ").count() > 3);
    signal(&child, kind);
    let status = child.wait().expect("it ends");
    assert_eq!(status.code(), (kind == "-TERM").then_some(75), "{}", log());
    let before = log();
    let last = before.matches(" written to ").count();
    assert!(last < 600, "it was stopped in the middle");
    assert!(!Path::new(&cluster.path("job/done/0001.json")).exists());
    swm_ok(&["task", &job, "--index", "1"]);
    let after = log()[before.len()..].to_owned();
    assert!(after.starts_with("swm task: attempt 2 on "), "{after}");
    // An episode that was committed is not computed again.
    let first = after
        .lines()
        .find_map(|line| line.strip_prefix("episode ")?.split(' ').next()?.parse::<usize>().ok());
    assert!(first.expect("it is there") >= last, "{first:?} after {last}");
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    assert!(fs::read(cluster.path("job/result.h5")).expect("the folder is ours") == whole);
    assert_eq!(read(&cluster.path("job/done/0001.json"))["attempt"], 2);
}

#[test]
fn a_killed_task_goes_on_behind_its_last_episode() {
    interrupted("-KILL");
}

#[test]
fn a_stopped_task_goes_on_behind_its_last_episode() {
    interrupted("-TERM");
}

#[test]
fn a_shard_has_one_task_at_a_time() {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "2", &[&collect("4000")[..], &["--report-every", "0"]].concat()));
    let mut child = swm(&["task", &job, "--index", "1"]).stderr(Stdio::null()).spawn().unwrap();
    wait_for("a start", || cluster.text("job/logs/0001.log").contains(" written to "));
    // It is not over: a scheduler that starts the task again later finds it done, or goes on.
    let message = swm_fails(75, &["task", &job, "--index", "1"]);
    assert!(message.contains(&format!("process {}", child.id())), "{message}");
    signal(&child, "-KILL");
    child.wait().unwrap();
}

#[test]
fn parts_that_are_lost_or_damaged_are_made_again() {
    let cluster = Cluster::new();
    let whole = whole(&cluster.folder, "6");
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "3", &collect("6")));
    swm_ok(&["task", &job, "--all"]);
    let part = cluster.path("job/parts/0002-of-0003.h5");
    let to_run = format!("swm task {job} --all");

    let bytes = fs::read(&part).unwrap();
    fs::write(&part, &bytes[..bytes.len() / 2]).unwrap();
    let message = swm_fails(1, &["task", &job, "--finish"]);
    assert!(message.contains(&format!("what shard 2 wrote has changed since: remove {part}")), "{message}");
    assert!(message.contains(&to_run), "{message}");

    fs::remove_file(&part).unwrap();
    let message = swm_fails(1, &["task", &job, "--finish"]);
    assert!(message.contains("1 of 3 shards") && message.contains(&part), "{message}");
    assert!(message.contains("parts are missing: 2;") && message.contains(&to_run), "{message}");
    let status = swm_json(&["jobs", &job]);
    assert_eq!((&status["done"], &status["missing"]), (&2.into(), &serde_json::json!([2])));
    assert_eq!((&status["episodes"], &status["each"][1]["episodes"]), (&4.into(), &0.into()));
    let page = swm_ok(&["jobs", &job]);
    assert!(page.contains("2 done, 1 lost") && page.contains(&to_run), "{page}");
    let again = ok(&cluster.submit(&["--on", "script"], "3", &collect("6")));
    assert!(again.contains("--index 2") && !again.contains("--index 1"), "{again}");

    swm_ok(&["task", &job, "--index", "2"]);
    assert!(fs::read(&part).unwrap() == bytes);
    fs::remove_file(&part).unwrap();
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    assert!(fs::read(cluster.path("job/result.h5")).unwrap() == whole);
    // Once they are joined, nobody needs the parts.
    fs::remove_file(&part).unwrap();
    assert_eq!(swm_json(&["jobs", &job])["done"], 3);
}

#[test]
fn a_disk_that_is_too_small_is_found_out_before() {
    let cluster = Cluster::new();
    cluster.program("df", "echo Filesystem; echo '/dev/a 100 90 10 90% /'");
    let long = collect("400000");
    let message = fails(2, &cluster.submit(&["--on", "script", "--pilot", "4"], "4", &long));
    assert!(message.contains("parts and result need about") && message.contains("--force"), "{message}");
    ok(&cluster.submit(&["--on", "script", "--pilot", "4", "--force"], "4", &long));
    assert!(!Path::new(&cluster.path("job/pilot.h5")).exists());
}
