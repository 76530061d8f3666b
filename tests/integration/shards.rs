//! Work that is divided among machines: parts of recordings, evaluations and sweeps, and what they are joined to.

#[cfg(unix)]
use std::process::Stdio;

use serde_json::Value as Json;

use crate::evaluation::{QUICK, manifest, read};
use crate::support::{Folder, PUSHT, content, swm, swm_fails, swm_json, swm_ok};

const TWO_ROOM: &str = "swm/TwoRoom-v2";

fn collect(folder: &Folder, name: &str, extra: &[&str]) -> Vec<String> {
    collect_by(folder, "noisy-expert:2", name, extra)
}

fn collect_by(folder: &Folder, policy: &str, name: &str, extra: &[&str]) -> Vec<String> {
    let out = folder.path(name);
    let args = ["collect", TWO_ROOM, "--policy", policy, "--max-steps", "6", "--image-size", "none"];
    let args = [&args[..], &["--quiet", "--out", &out], extra].concat();
    args.into_iter().map(str::to_owned).collect()
}

fn strs(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
}

#[test]
fn merge_refuses_what_is_not_the_whole() {
    let folder = Folder::new();
    let record = |name: &str, extra: &[&str]| {
        swm_ok(&strs(&collect(&folder, name, extra)));
        folder.path(name)
    };
    let whole = record("whole.h5", &["--episodes", "7"]);
    let part = |shard: &str| {
        record(&format!("parts/{shard}.h5"), &["--total", "7", "--shard", &format!("{shard}/3")])
    };
    let (first, third) = (part("1"), part("3"));
    let merged = folder.path("merged.h5");
    let message = swm_fails(2, &["merge", &first, &third, "--out", &merged]);
    assert!(message.contains("part 2/3 (episodes 2 to 3) is missing"), "{message}");
    assert!(message.contains("total=7, shard=2/3, mode=append"), "{message}");
    assert!(!std::path::Path::new(&merged).exists());
    swm_ok(&["merge", &first, &third, "--partial", "--out", &folder.path("some.h5"), "--quiet"]);
    let message = swm_fails(2, &["merge", &first, &first, &third, "--out", &merged]);
    assert!(message.contains("1.h5 is named twice"), "{message}");
    let again = folder.path("again.h5");
    std::fs::copy(&first, &again).expect("a copy");
    let message = swm_fails(2, &["merge", &first, &again, &third, "--out", &merged]);
    assert!(message.contains("give each part once"), "{message}");
    let inspected = swm_ok(&["inspect", &first]);
    assert!(inspected.contains("part 1/3 of 7 episodes: 2 of its 2"), "{inspected}");

    part("2");
    let parts = folder.path("parts");
    assert_eq!(content(&parts), content(&whole));
    swm_ok(&["merge", &parts, "--out", &merged, "--quiet"]);
    assert!(std::fs::read(&merged).unwrap() == std::fs::read(&whole).unwrap());
    let message = swm_fails(2, &["merge", &whole, "--out", &merged]);
    assert!(message.contains("one dataset was given"), "{message}");
}

#[test]
fn append_continues_the_same_recording_only() {
    let folder = Folder::new();
    let shard = ["--total", "8", "--shard", "1/2", "--seed", "1", "--mode", "append"];
    swm_ok(&strs(&collect(&folder, "part.h5", &["--total", "4", "--shard", "1/2", "--seed", "1"])));
    let refused = |name: &str, extra: &[&str], reason: &str| {
        let message = swm_fails(2, &strs(&collect(&folder, name, extra)));
        assert!(message.contains(reason) && message.contains("--mix"), "{message}");
    };
    let before = std::fs::read(folder.path("part.h5")).unwrap();
    refused("part.h5", &shard, "it holds part 1/2 of 4 episodes, not part 1/2 of 8 episodes");
    refused("part.h5", &["--episodes", "2", "--mode", "append"], "not the whole recording");
    assert!(before == std::fs::read(folder.path("part.h5")).unwrap(), "what is refused changes nothing");

    swm_ok(&strs(&collect(&folder, "whole.h5", &["--total", "2", "--seed", "1"])));
    let more = ["--total", "4", "--mode", "append"];
    refused("whole.h5", &[&more[..], &["--seed", "2"]].concat(), "seed 1, not 2");
    let shard = ["--total", "8", "--mode", "append", "--seed", "1", "--shard", "1/2"];
    refused("whole.h5", &shard, "it holds the whole recording, not part 1/2 of 8 episodes");
    let random = collect_by(&folder, "random", "whole.h5", &[&more[..], &["--seed", "1"]].concat());
    let message = swm_fails(2, &strs(&random));
    assert!(message.contains("policy") && message.contains("not \"random"), "{message}");
    swm_ok(&strs(&collect(&folder, "whole.h5", &[&more[..], &["--seed", "2", "--mix"]].concat())));
    assert_eq!(swm::data::open(folder.path("whole.h5").as_ref()).unwrap().num_episodes(), 4);
    // Episodes that are added without a total are another run, as they were.
    swm_ok(&strs(&collect(&folder, "whole.h5", &["--episodes", "1", "--seed", "5", "--mode", "append"])));
}

/// `swm COMMAND … --out DIR` undivided, and by parts that are joined: what is in both folders.
fn divided(folder: &Folder, command: &[&str], result: &str, shards: u64) -> [Json; 2] {
    let (whole, parts) = (folder.path("whole"), folder.path(&format!("parts{shards}")));
    if !std::path::Path::new(&whole).exists() {
        swm_ok(&[command, &["--out", &whole, "--quiet"]].concat());
    }
    for shard in (1..=shards).rev() {
        let of = format!("{shard}/{shards}");
        swm_ok(&[command, &["--out", &parts, "--quiet", "--shard", &of]].concat());
    }
    swm_ok(&[command, &["--out", &parts, "--quiet", "--join"]].concat());
    assert!(!std::path::Path::new(&format!("{parts}/parts")).exists(), "the result holds everything");
    [whole, parts].map(|dir| {
        let mut json = read(&format!("{dir}/{result}"));
        if let Some(seconds) = json.get_mut("wall_time_s") {
            assert!(seconds.take().as_f64() > Some(0.0));
        }
        json
    })
}

#[test]
fn joined_evaluations_are_the_undivided_one() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let command = ["eval", "--manifest", &manifest, "--policy", "weak", "--reference", "random,no-op"];
    for shards in [1, 7, 64] {
        let [whole, joined] = divided(&folder, &command, "receipt.json", shards);
        assert_eq!(whole["references"].as_array().unwrap().len(), 2);
        assert_eq!(whole, joined, "{shards} shards");
    }
    // Joined again, nothing is left to do; neither is a part run again.
    for again in [&["--join"][..], &["--shard", "1/7"]] {
        let out = folder.path("parts7");
        let said = swm(&[&command[..], &["--out", &out], again].concat()).output().unwrap();
        assert!(said.status.success() && String::from_utf8_lossy(&said.stderr).contains("already done"));
    }
}

#[test]
fn joined_sweeps_are_the_undivided_one() {
    let folder = Folder::new();
    // Not every pair can have every door.
    let (data, manifest) = (folder.path("rooms.h5"), folder.path("rooms.toml"));
    swm_ok(&[
        "collect",
        TWO_ROOM,
        "--policy",
        "expert",
        "--episodes",
        "30",
        "--image-size",
        "none",
        "--out",
        &data,
    ]);
    let make = ["manifest", "make", TWO_ROOM, "--tier", "moderate", "--dataset", &data, "--held-out", "1"];
    swm_ok(&[&make[..], &["--episodes", "6", "--budget", "20", "--out", &manifest]].concat());
    let command = ["sweep", "--manifest", &manifest, "--policy", "expert", "--values", "extremes"];
    let command = [&command[..], &["--factors", "agent.radius,wall.thickness,door.size"]].concat();
    for shards in [1, 7, 64] {
        let [whole, joined] = divided(&folder, &command, "sweep.json", shards);
        let cells = whole["cells"].as_array().unwrap();
        assert!(cells.len() >= 7 && cells.iter().any(|cell| cell["successes"] != cells[0]["successes"]));
        assert_eq!(whole, joined, "{shards} shards");
        let csv = |dir: &str| std::fs::read(format!("{}/sweep.csv", folder.path(dir))).unwrap();
        assert_eq!(csv("whole"), csv(&format!("parts{shards}")));
    }
}

#[test]
fn parts_are_joined_only_when_all_are_there() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let out = folder.path("out");
    let eval = |policy: &str, extra: &[&str]| -> Vec<String> {
        let args =
            ["eval", "--manifest", &manifest, "--policy", policy, "--reference", "none", "--out", &out];
        [&args[..], &["--quiet"], extra].concat().into_iter().map(str::to_owned).collect()
    };
    let message = swm_fails(2, &strs(&eval("weak", &["--join"])));
    assert!(message.contains("holds no parts"), "{message}");
    for shard in ["1/3", "3/3"] {
        swm_ok(&strs(&eval("weak", &["--shard", shard])));
    }
    let message = swm_fails(2, &strs(&eval("weak", &["--join"])));
    assert!(message.contains("2/3 is missing") && message.contains("--shard I/3"), "{message}");
    swm_ok(&strs(&eval("weak", &["--shard", "2/3"])));
    // As a kill leaves it: without its last episode and its end.
    let part = format!("{out}/parts/0003-of-0003.jsonl");
    let text = std::fs::read_to_string(&part).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 4, "a head, two of five episodes, the end");
    std::fs::write(&part, format!("{}\n{}\n{{\"episode\":4,\"succ", lines[0], lines[1])).unwrap();
    let message = swm_fails(2, &strs(&eval("weak", &["--join"])));
    assert!(message.contains("3/3 is not finished"), "{message}");
    let message = swm_fails(1, &strs(&eval("random", &["--shard", "3/3"])));
    assert!(message.contains("another evaluation"), "{message}");
    let message = swm_fails(2, &strs(&eval("random", &["--join"])));
    assert!(message.contains("another evaluation"), "{message}");
    swm_ok(&strs(&eval("weak", &["--shard", "3/3"])));
    let again = std::fs::read_to_string(&part).unwrap();
    assert_eq!(again.lines().nth(1), Some(lines[1]), "a finished episode is not run again");
    // A division that was given up.
    let other = format!("{out}/parts/0001-of-0002.jsonl");
    std::fs::copy(&part, &other).unwrap();
    let message = swm_fails(2, &strs(&eval("weak", &["--join"])));
    assert!(message.contains("others are of"), "{message}");
    std::fs::remove_file(other).unwrap();
    swm_ok(&strs(&eval("weak", &["--join"])));
    assert_eq!(read(&format!("{out}/receipt.json"))["episodes"].as_array().unwrap().len(), 5);
}

#[cfg(unix)]
#[test]
fn a_stopped_sweep_goes_on_to_the_same_result() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let command = ["sweep", "--manifest", &manifest, "--policy", QUICK, "--factors", "agent.scale"];
    let (whole, stopped) = (folder.path("whole"), folder.path("stopped"));
    swm_ok(&[&command[..], &["--out", &whole, "--quiet"]].concat());
    let args = [&command[..], &["--out", &stopped, "--num-envs", "1", "--threads", "1"]].concat();
    let child = swm(&args).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it starts");
    let ledger = format!("{stopped}/sweep.jsonl");
    let lines = || std::fs::read_to_string(&ledger).map_or(0, |text| text.lines().count());
    while lines() < 3 {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let kill = std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]).status();
    assert!(kill.expect("kill is there").success());
    let ended = child.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(75), "{said}");
    let expected = format!("finished episodes are safe in {stopped}; to continue, repeat the command");
    assert!(said.contains(&expected), "{said}");
    assert!(lines() >= 3);
    swm_ok(&[&command[..], &["--out", &stopped, "--quiet"]].concat());
    assert_eq!(read(&format!("{whole}/sweep.json")), read(&format!("{stopped}/sweep.json")));
    assert!(!std::path::Path::new(&ledger).exists());
}

#[cfg(unix)]
#[test]
fn a_stopped_merge_goes_on_to_the_same_dataset() {
    let folder = Folder::new();
    let one = folder.path("one.h5");
    let collect = [
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--episodes",
        "12",
        "--image-size",
        "128",
        "--quiet",
        "--without",
        "goal",
    ];
    swm_ok(&[&collect[..], &["--out", &one]].concat());
    let (whole, stopped) = (folder.path("whole.h5"), folder.path("stopped.h5"));
    // Many copies: much longer than a command has to stop by itself.
    let copies: Vec<String> = (0..24).map(|index| folder.path(&format!("copy{index}.h5"))).collect();
    copies.iter().for_each(|copy| assert!(std::fs::copy(&one, copy).is_ok()));
    let sources: Vec<&str> = copies.iter().map(String::as_str).collect();
    let merge = [&["merge"][..], &sources, &["--quiet", "--out"]].concat();
    let child = swm(&[&merge[..], &[&stopped]].concat()).stderr(Stdio::piped()).spawn().expect("it starts");
    while !std::path::Path::new(&stopped).exists() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let kill = std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]).status();
    assert!(kill.expect("kill is there").success());
    let ended = child.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(75), "{said}");
    assert!(said.contains(&format!("copied episodes are safe in {stopped}; to continue, repeat")), "{said}");
    let resumed = swm_json(&[&merge[..], &[&stopped]].concat());
    assert_eq!(resumed["episodes"], 288);
    assert!(resumed["rows"].as_u64().unwrap() > 0, "the rest is copied now: {resumed}");
    swm_ok(&[&merge[..], &[&whole]].concat());
    swm_ok(&["diff", &stopped, &whole]);
}
