//! The whole command line on this crate's environment, solver, model and data format, as a user would run it.

use std::process::{Command, Output};

/// Runs `ice-rink` with the words of a line.
fn run(folder: &std::path::Path, line: &str) -> Output {
    let words = line.split_whitespace();
    Command::new(env!("CARGO_BIN_EXE_ice-rink"))
        .args(words)
        .current_dir(folder)
        .output()
        .expect("the binary runs")
}

/// Runs a line that must succeed, and reads what it prints as JSON.
fn json(folder: &std::path::Path, line: &str) -> serde_json::Value {
    let output = run(folder, &format!("{line} --json --quiet"));
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("--json prints JSON")
}

#[test]
fn it_is_listed_collected_replayed_planned_on_and_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let envs = json(folder, "envs");
    let rink =
        envs.as_array().unwrap().iter().find(|env| env["id"] == "demo/IceRink-v0").expect("it is listed");
    assert_eq!(rink["num_factors"], 7);

    let collect = "collect demo/IceRink-v0 --policy random --seed 3 --max-steps 40";
    json(folder, &format!("{collect} --episodes 30 --out data.h5"));
    assert!(
        run(folder, "replay data.h5").status.success(),
        "the same seeds and actions give the same states"
    );
    json(folder, &format!("{collect} --episodes 2 --image-size 32x32 --vary all --out images.h5"));
    assert!(run(folder, "verify images.h5").status.success());

    // Our own format by its extension, there and back without a difference.
    json(folder, "convert data.h5 data.jsonl");
    assert_eq!(json(folder, "inspect data.jsonl")["episodes"], 30);
    assert!(run(folder, "diff data.h5 data.jsonl").status.success());
    assert!(run(folder, "replay data.jsonl").status.success());
    json(folder, &format!("{collect} --episodes 2 --out lines.jsonl"));
    assert!(run(folder, "verify lines.jsonl").status.success());

    let success = |policy: &str| {
        let eval = "eval demo/IceRink-v0 --episodes 10 --seed 5 --budget 150";
        json(folder, &format!("{eval} --policy {policy}"))["success_rate"].as_f64().unwrap()
    };
    assert_eq!(success("expert"), 100.0);
    // Planning on the true dynamics with a solver of the workspace, and with our own.
    assert!(success("cem:samples=64,elites=8,iterations=5,receding_horizon=2") >= 90.0);
    assert!(success("shotgun:receding_horizon=1") >= 70.0);
    // Planning in the model that was fitted to what the random policy did.
    assert!(success("fitted-model:data.h5") >= 90.0);
    assert!(success("random") <= 20.0);
}

#[test]
fn wrong_input_gets_the_answers_that_built_in_names_get() {
    let folder = tempfile::tempdir().unwrap();
    let message = |line: &str| {
        let output = run(folder.path(), line);
        assert!(!output.status.success(), "{line}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(message("envs demo/IceRing-v0").contains("did you mean `demo/IceRink-v0`?"));
    assert!(message("eval demo/IceRink-v0 --policy shotgun:pellet=3").contains("did you mean `pellets`?"));
    assert!(message("eval demo/IceRink-v0 --policy fitted-model:none.h5").contains("none.h5"));
}
