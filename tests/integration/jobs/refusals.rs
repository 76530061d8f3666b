//! Requests that are refused before anything is queued, and shards of a job that has changed.

use std::fs;
use std::path::Path;

use super::{Cluster, collect, fails, ok};
use crate::evaluation::{manifest, read};
use crate::support::{swm_fails, swm_ok};

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
fn a_disk_that_is_too_small_is_found_out_before() {
    let cluster = Cluster::new();
    cluster.program("df", "echo Filesystem; echo '/dev/a 100 90 10 90% /'");
    let long = collect("400000");
    let message = fails(2, &cluster.submit(&["--on", "script", "--pilot", "4"], "4", &long));
    assert!(message.contains("parts and result need about") && message.contains("--force"), "{message}");
    ok(&cluster.submit(&["--on", "script", "--pilot", "4", "--force"], "4", &long));
    assert!(!Path::new(&cluster.path("job/pilot.h5")).exists());
}

#[test]
fn a_changed_copy_of_the_program_is_refused_by_tasks_and_by_the_join() {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    let submit = ["submit", "--job", &job, "--shards", "2", "--on", "script", "--"];
    ok(&cluster.swm(&[&submit[..], &collect("4")].concat()).output().unwrap());
    let copy = cluster.path("job/swm");
    let run = |more: &str| std::process::Command::new(&copy).args(["task", &job, more]).output().unwrap();
    ok(&run("--all"));
    let sound = fs::read(&copy).unwrap();
    fs::write(&copy, [&sound[..], b"x"].concat()).unwrap();
    for more in ["--all", "--finish"] {
        let message = fails(2, &run(more));
        let fix = "has changed since the job was submitted; copy ";
        assert!(message.contains(&copy) && message.contains(fix), "{more}: {message}");
    }
    fs::write(&copy, sound).unwrap();
    ok(&run("--finish"));
}

#[test]
fn a_task_does_not_write_its_log_through_a_link() {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "2", &collect("4")));
    let other = cluster.path("other");
    fs::write(&other, "of others").unwrap();
    std::os::unix::fs::symlink(&other, cluster.path("job/logs/0001.log")).unwrap();
    let message = swm_fails(1, &["task", &job, "--index", "1"]);
    assert!(message.contains("0001.log") && message.contains("symbolic link"), "{message}");
    assert_eq!(fs::read_to_string(&other).unwrap(), "of others");
    assert!(Path::new(&cluster.path("job/done/0001.failed")).exists());
}

#[test]
fn a_result_elsewhere_is_no_result_of_the_job() {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "1", &collect("4")));
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    let finished = cluster.path("job/finished.json");
    let text = fs::read_to_string(&finished).unwrap();
    fs::write(&finished, text.replace("result.h5", "../other.h5")).unwrap();
    for command in [&["jobs", &*job][..], &["task", &job, "--finish"]] {
        let message = swm_fails(1, command);
        assert!(message.contains("finished.json names the result `../other.h5`"), "{message}");
    }
}
