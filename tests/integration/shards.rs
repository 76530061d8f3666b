//! Work that is divided among machines: parts of recordings, evaluations and sweeps, and what they are joined to.

use crate::support::{Folder, content, swm_fails, swm_ok};

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
    assert!(message.contains("--total 7 --shard 2/3 --mode append"), "{message}");
    assert!(!std::path::Path::new(&merged).exists());
    swm_ok(&["merge", &first, &third, "--partial", "--out", &folder.path("some.h5"), "--quiet"]);
    let message = swm_fails(2, &["merge", &first, &first, &third, "--out", &merged]);
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
