//! Results do not depend on environments, threads, or how a run is divided.

use crate::support::{Folder, PUSHT, content, short_recording, swm_json, swm_ok};

fn collect(out: &str, extra: &[&str]) {
    let base =
        ["collect", PUSHT, "--policy", "weak", "--seed", "7", "--max-steps", "12", "--image-size", "32x32"];
    let args: Vec<&str> = base.iter().chain(extra).chain(&["--out", out, "--quiet"]).copied().collect();
    swm_ok(&args);
}

#[test]
fn files_are_bit_identical_for_any_number_of_environments_and_threads() {
    let folder = Folder::new();
    let mut files = Vec::new();
    for (num_envs, threads) in [("1", "1"), ("3", "1"), ("8", "2"), ("1", "2")] {
        let out = folder.path(&format!("envs{num_envs}_threads{threads}.h5"));
        collect(&out, &["--episodes", "10", "--num-envs", num_envs, "--threads", threads, "--vary", "all"]);
        files.push(std::fs::read(&out).unwrap());
    }
    for (index, file) in files.iter().enumerate() {
        assert!(*file == files[0], "file {index} differs from the first");
    }
}

#[test]
fn worlds_on_rapier_are_bit_identical_too() {
    let folder = Folder::new();
    for (env, policy) in [("swm/PushTRapier-v0", "weak"), ("swm/PointMaze-v0", "explorer")] {
        let mut files = Vec::new();
        for (num_envs, threads) in [("1", "1"), ("3", "1"), ("8", "2"), ("1", "2")] {
            let out = folder.path(&format!("{policy}_envs{num_envs}_threads{threads}.h5"));
            swm_ok(&[
                "collect",
                env,
                "--policy",
                policy,
                "--seed",
                "7",
                "--max-steps",
                "30",
                "--image-size",
                "32x32",
                "--episodes",
                "8",
                "--num-envs",
                num_envs,
                "--threads",
                threads,
                "--vary",
                "all",
                "--out",
                &out,
                "--quiet",
            ]);
            files.push(std::fs::read(&out).unwrap());
        }
        for (index, file) in files.iter().enumerate() {
            assert!(*file == files[0], "{env}: file {index} differs from the first");
        }
    }
}

#[test]
fn appending_gives_what_one_run_gives() {
    let folder = Folder::new();
    let (parts, whole) = (folder.path("parts.h5"), folder.path("whole.h5"));
    collect(&parts, &["--episodes", "4", "--num-envs", "3"]);
    collect(&parts, &["--episodes", "6", "--num-envs", "2", "--mode", "append"]);
    collect(&whole, &["--episodes", "10", "--num-envs", "8"]);
    assert_eq!(content(&parts), content(&whole));
    let again = folder.path("again.h5");
    collect(&again, &["--total", "3"]);
    collect(&again, &["--total", "10", "--mode", "append"]);
    assert_eq!(content(&again), content(&whole));
}

#[test]
fn shards_merged_are_what_one_run_gives() {
    let folder = Folder::new();
    let (whole, merged) = (folder.path("whole.h5"), folder.path("merged.h5"));
    collect(&whole, &["--episodes", "7", "--vary", "all"]);
    let mut merge = vec!["merge".to_owned()];
    for shard in 1..=3 {
        let part = folder.path(&format!("part{shard}.h5"));
        collect(&part, &["--episodes", "7", "--vary", "all", "--shard", &format!("{shard}/3")]);
        merge.push(part);
    }
    // A part that is whole stays as it is.
    let part = folder.path("part2.h5");
    let before = content(&part);
    collect(&part, &["--episodes", "7", "--vary", "all", "--shard", "2/3", "--mode", "append"]);
    assert_eq!(content(&part), before);
    merge.extend(["--out".to_owned(), merged.clone()]);
    swm_ok(&merge.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(content(&merged), content(&whole));
    let metadata = |path: &str| swm_json(&["inspect", path])["metadata"].clone();
    assert_eq!(metadata(&merged), metadata(&whole));
}

#[test]
fn many_parts_are_the_whole_to_the_byte_and_some_may_be_empty() {
    let folder = Folder::new();
    let collect = |name: &str, episodes: &str, shard: Option<usize>| {
        let out = folder.path(name);
        let of = shard.map(|shard| format!("{shard}/16"));
        let fixed = ["--seed", "3", "--total", episodes, "--mode", "append", "--out", &out, "--quiet"];
        let mut args = short_recording(&fixed);
        args.extend(of.iter().flat_map(|of| ["--shard", of.as_str()]));
        swm_ok(&args);
        out
    };
    for episodes in ["5", "21"] {
        let name = |part: &str| format!("{episodes}.{part}.h5");
        let whole = collect(&name("whole"), episodes, None);
        let parts: Vec<String> =
            (1..=16).map(|shard| collect(&name(&shard.to_string()), episodes, Some(shard))).collect();
        let merged = folder.path(&name("merged"));
        let mut merge = vec!["merge"];
        merge.extend(parts.iter().map(String::as_str));
        merge.extend(["--out", &merged]);
        swm_ok(&merge);
        assert!(std::fs::read(&merged).unwrap() == std::fs::read(&whole).unwrap(), "{episodes} episodes");
    }
}

#[test]
fn another_seed_gives_other_data() {
    let folder = Folder::new();
    let (a, b) = (folder.path("a.h5"), folder.path("b.h5"));
    collect(&a, &["--episodes", "2"]);
    swm_ok(&[
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--seed",
        "8",
        "--max-steps",
        "12",
        "--image-size",
        "32x32",
        "--episodes",
        "2",
        "--out",
        &b,
        "--quiet",
    ]);
    assert_ne!(content(&a)["action"], content(&b)["action"]);
}

#[test]
fn planning_does_not_depend_on_environments_or_threads() {
    let policy = "cem:samples=24,elites=4,iterations=3,horizon=4,receding_horizon=4,action_block=2";
    let outcome = |num_envs: &str, threads: &str| {
        let mut result = swm_json(&[
            "eval",
            PUSHT,
            "--policy",
            policy,
            "--episodes",
            "5",
            "--budget",
            "16",
            "--num-envs",
            num_envs,
            "--threads",
            threads,
            "--quiet",
        ]);
        result["wall_time_s"].take();
        result
    };
    let first = outcome("1", "1");
    assert_eq!(first["episodes"], 5);
    assert_eq!(first, outcome("5", "1"));
    assert_eq!(first, outcome("2", "2"));
}
