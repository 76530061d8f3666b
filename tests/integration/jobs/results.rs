//! Jobs that are run to their end: what they say on the way, and that their results are the undivided ones.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::{Cluster, collect, ok, said, whole};
use crate::evaluation::{manifest, read};
use crate::support::{swm, swm_fails, swm_json, swm_ok};

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

/// Of an evaluation of two policies on 5 pairs by 3 shards: the costly one must not be left to the first shards.
fn every_part_has_both_policies(job: &str) {
    for shard in 1..=3 {
        let text = fs::read_to_string(format!("{job}/parts/000{shard}-of-0003.jsonl"))
            .expect("the part was written");
        let lines =
            text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("a line is JSON"));
        let episodes: Vec<u64> = lines.filter_map(|line| line["episode"].as_u64()).collect();
        let of_the_first = episodes.iter().filter(|&&episode| episode < 5).count();
        assert!(
            (1..=2).contains(&of_the_first) && episodes.len() - of_the_first <= 2,
            "{shard}: {episodes:?}"
        );
        assert!(episodes.len() > of_the_first, "{shard}: {episodes:?}");
    }
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
        if command[0] == "eval" {
            every_part_has_both_policies(&job);
        }
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
