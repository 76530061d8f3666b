//! Shards that are killed, stopped or run twice, and parts that are lost: what is committed counts.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use super::{Cluster, collect, collect_line_by_line, ok, said, signal, wait_for, whole};
use crate::evaluation::{manifest, read};
use crate::support::{swm, swm_fails, swm_json, swm_ok};

/// A shard that is killed or stopped once some episodes are committed, and then continued.
///
/// On a busy machine the shard can end before the signal reaches it. Then another one is tried.
fn interrupted(kind: &str) {
    assert!((0..5).any(|_| is_interrupted(kind)), "no shard was interrupted before its end");
}

/// Whether the shard was interrupted before its end. If so, the rest is checked.
fn is_interrupted(kind: &str) -> bool {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "2", &collect_line_by_line("2000")));
    let mut child = swm(&["task", &job, "--index", "1"]).stderr(Stdio::null()).spawn().expect("it starts");
    let log = || cluster.text("job/logs/0001.log");
    wait_for("episodes", || log().matches(" written to ").count() > 3);
    signal(&child, kind);
    let status = child.wait().expect("it ends");
    let before = log();
    let last = before.matches(" written to ").count();
    if last == 1000 {
        return false;
    }
    assert_eq!(status.code(), (kind == "-TERM").then_some(75), "{before}");
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
    let whole = whole(&cluster.folder, "2000");
    assert!(fs::read(cluster.path("job/result.h5")).expect("the folder is ours") == whole);
    assert_eq!(read(&cluster.path("job/done/0001.json"))["attempt"], 2);
    true
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
    ok(&cluster.submit(&["--on", "script"], "2", &collect_line_by_line("100000")));
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
    let mut flipped = bytes.clone();
    flipped[bytes.len() / 2] ^= 1;
    for damaged in [&bytes[..bytes.len() / 2], &flipped] {
        fs::write(&part, damaged).unwrap();
        let message = swm_fails(1, &["task", &job, "--finish"]);
        let told = format!("what shard 2 wrote has changed since: remove {part}");
        assert!(message.contains(&told) && message.contains(&to_run), "{message}");
        assert!(!message.contains("error: error:") && !Path::new(&cluster.path("job/result.h5")).exists());
    }

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
    let nothing = ok(&cluster.swm(&["submit", "--job", &job]).output().unwrap());
    assert!(nothing.contains("nothing to submit: of 3 shards 3 are done"), "{nothing}");

    // Without the result, they are needed again.
    let result = cluster.path("job/result.h5");
    fs::remove_file(&result).unwrap();
    let page = swm_ok(&["jobs", &job]);
    assert!(
        page.contains("2 done, 1 lost") && page.contains(&format!("lost: {result} is missing")),
        "{page}"
    );
    let status = swm_json(&["jobs", &job]);
    assert_eq!(
        (&status["result"], &status["lost_result"]),
        (&serde_json::Value::Null, &result.clone().into())
    );
    let message = swm_fails(1, &["task", &job, "--finish"]);
    assert!(message.contains(&format!("{result} was there before and is missing\n")), "{message}");
    assert!(message.contains("parts are missing: 2;") && message.contains(&to_run), "{message}");
    swm_ok(&["task", &job, "--all"]);
    let page = swm_ok(&["jobs", &job]);
    assert!(page.contains(&format!("to join it again: swm task {job} --finish")), "{page}");
    let left = ok(&cluster.swm(&["submit", "--job", &job]).output().unwrap());
    assert!(left.contains("--finish") && !left.contains("--index"), "{left}");
    let joined = cluster.swm(&["task", &job, "--finish"]).output().unwrap();
    ok(&joined);
    let joined = said(&joined);
    assert!(joined.contains("is missing: the shards are joined again"), "{joined}");
    assert!(fs::read(&result).unwrap() == whole);
    assert!(swm_ok(&["jobs", &job]).contains("result.h5 ("));
    fs::write(&result, &whole[..100]).unwrap();
    let page = swm_ok(&["jobs", &job]);
    assert!(page.contains("result.h5 (100 bytes, where ") && page.contains("cut short"), "{page}");
}

#[test]
fn a_lost_receipt_is_made_again() {
    let cluster = Cluster::new();
    let manifest = manifest(&cluster.folder, "moderate", "m.toml", &["--held-out", "1"]);
    let job = cluster.path("job");
    let eval = ["eval", "--manifest", &manifest, "--policy", "random", "--reference", "none"];
    ok(&cluster.submit(&["--on", "script"], "2", &eval));
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    assert_eq!(swm_json(&["jobs", &job])["done"], 2);
    let receipt = cluster.path("job/receipt.json");
    let episodes = |path: &str| read(path)["episodes"].clone();
    let before = episodes(&receipt);
    fs::remove_file(&receipt).unwrap();
    let page = swm_ok(&["jobs", &job]);
    assert!(
        page.contains("2 shards: 2 lost") && page.contains(&format!("lost: {receipt} is missing")),
        "{page}"
    );
    let message = swm_fails(1, &["task", &job, "--finish"]);
    assert!(message.contains(&format!("swm task {job} --all")), "{message}");
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    assert!(before.is_array() && before == episodes(&receipt), "{before}");
}

#[test]
fn files_that_a_loss_of_power_emptied_count_as_absent() {
    let cluster = Cluster::new();
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "script"], "3", &collect("6")));
    swm_ok(&["task", &job, "--all"]);
    fs::write(cluster.path("job/done/0001.json"), "").unwrap();
    assert!(swm_ok(&["jobs", &job]).contains("2 done"));
    assert!(swm_fails(1, &["task", &job, "--finish"]).contains("1 of 3 shards"));
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    assert!(fs::read(cluster.path("job/result.h5")).unwrap() == whole(&cluster.folder, "6"));
    fs::write(cluster.path("job/finished.json"), "").unwrap();
    swm_ok(&["jobs", &job]);
    swm_ok(&["task", &job, "--all"]);
    swm_ok(&["task", &job, "--finish"]);
    assert!(fs::metadata(cluster.path("job/finished.json")).unwrap().len() > 0);
}
