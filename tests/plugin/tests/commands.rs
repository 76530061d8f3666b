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
    let about = String::from_utf8(run(folder, "envs demo/IceRink-v0").stdout).unwrap();
    assert!(about.contains("`ice-rink fovs demo/IceRink-v0`"), "{about}");

    let collect = "collect demo/IceRink-v0 --policy random --seed 3 --max-steps 40";
    json(folder, &format!("{collect} --episodes 30 --out data.h5"));
    assert!(
        run(folder, "replay data.h5").status.success(),
        "the same seeds and actions give the same states"
    );
    json(folder, &format!("{collect} --episodes 2 --image-size 32x32 --vary all --out images.h5"));
    assert!(run(folder, "verify images.h5").status.success());

    // The custom format by its extension, there and back without a difference.
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
    // Planning on the true dynamics with a solver of the workspace, and with the custom one.
    assert!(success("cem:samples=64,elites=8,iterations=5,receding_horizon=2") >= 90.0);
    assert!(success("shotgun:receding_horizon=1") >= 70.0);
    // Planning on the model that was fitted to what the random policy did.
    assert!(success("fitted-model:data.h5") >= 90.0);
    assert!(success("random") <= 20.0);
}

#[test]
fn its_model_has_an_oracle_hashed_files_an_image_size_and_traces() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let collect = "collect demo/IceRink-v0 --policy random --seed 3 --max-steps 40 --image-size 24x32";
    json(folder, &format!("{collect} --episodes 12 --out data.h5"));
    json(folder, "manifest make demo/IceRink-v0 --tier historic --episodes 2 --budget 12 --out task.toml");

    // The oracle is the same planner on the true dynamics: of a solver of the workspace, or of this crate.
    let eval = |solver: &str| {
        json(
            folder,
            &format!("eval --manifest task.toml --reference oracle --policy fitted-model:data.h5,{solver}"),
        )
    };
    let receipt = eval("samples=32,elites=8,iterations=3");
    let oracle = &receipt["references"][0]["candidate"]["policy"];
    assert_eq!(oracle["name"], "cem");
    let settings = &oracle["named"];
    assert_eq!([&settings["samples"], &settings["action_block"], &settings["receding_horizon"]], [32, 2, 2]);
    assert!(receipt["references"][0]["regret"]["first_plan"].is_f64(), "{receipt}");
    assert_eq!(receipt["plan_steps"], 4, "2 blocks of 2 actions");
    assert_eq!(eval("solver=shotgun,pellets=50")["references"][0]["candidate"]["policy"]["name"], "shotgun");

    // The file that the model depends on is hashed, and that file alone.
    let files = receipt["files"].as_object().unwrap();
    assert_eq!(files.keys().collect::<Vec<_>>(), ["data.h5"]);
    assert_eq!(files["data.h5"].as_str().map(str::len), Some(64));

    // Worlds get images of the size that the model was trained on.
    let result = json(folder, "eval demo/IceRink-v0 --policy fitted-model:data.h5 --episodes 1 --budget 4");
    assert_eq!(result["setup"]["image"], serde_json::json!({ "height": 24, "width": 32 }));

    // It is measured by the same name: it predicts blocks of two actions, better than a model in which nothing changes.
    let quality = "quality demo/IceRink-v0 --dataset data.h5 --episodes 12 --rows 30 --horizon 10 --plans 8";
    let measured = json(folder, &format!("{quality} --model fitted-model:data.h5"));
    let still = json(folder, &format!("{quality} --model constant"));
    assert_eq!((&measured["stride"], &still["stride"]), (&2.into(), &1.into()));
    let error = |found: &serde_json::Value| {
        let errors = found["open_loop_unexplained"].as_array().unwrap();
        errors.last().and_then(serde_json::Value::as_f64).unwrap()
    };
    assert!(error(&measured) < 0.5 * error(&still), "{measured} {still}");

    // `mpc` plans with it as with trained models: equal requests, equal receipts.
    let settings = "data.h5,samples=32,elites=8,iterations=3";
    let mut by = ["fitted-model", "mpc:fitted-model"].map(|policy| {
        let eval = "eval --manifest task.toml --reference none --policy";
        json(folder, &format!("{eval} {policy}:{settings}"))
    });
    for receipt in &mut by {
        assert_eq!(receipt["candidate"]["policy"]["name"], "fitted-model");
        receipt.as_object_mut().unwrap().remove("wall_time_s");
    }
    assert_eq!(by[0], by[1]);

    // A sweep takes it, too.
    let sweep = "sweep --manifest task.toml --factors ice.friction";
    json(folder, &format!("{sweep} --policy fitted-model:{settings} --out sweep"));
    json(folder, &format!("{sweep} --policy mpc:fitted-model:{settings} --out swept"));
    let read = |folder_of: &str| std::fs::read(folder.join(folder_of).join("sweep.json")).unwrap();
    assert_eq!(
        String::from_utf8(read("sweep")).unwrap(),
        String::from_utf8(read("swept")).unwrap(),
        "the same sweep"
    );

    // Its plans are traced and drawn.
    let plan =
        "plan demo/IceRink-v0 --budget 6 --policy mpc:fitted-model:data.h5,samples=32,elites=8,iterations=3";
    let plans = json(folder, &format!("{plan} --trace trace --video-format gif"));
    assert_eq!(plans["plans"].as_array().unwrap().len(), 2);
    for file in ["index.html", "costs.svg", "trace.jsonl", "episode_000_plan_001_elites.svg"] {
        assert!(folder.join("trace").join(file).is_file(), "{file} is missing");
    }
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
    let named = "name one dataset: `fitted-model:FILE`";
    assert!(message("eval demo/IceRink-v0 --policy fitted-model").contains(named));
    assert!(message("eval demo/IceRink-v0 --policy mpc:fitted-model").contains(named));
    std::fs::create_dir(folder.path().join("fitted-model")).unwrap();
    let twice = message("eval demo/IceRink-v0 --policy mpc:fitted-model,samples=8");
    assert!(twice.contains("write `fitted-model:…` for the model"), "{twice}");
    assert!(message("quality demo/IceRink-v0 --model fitted-model").contains(named));
    assert!(message("quality demo/IceRink-v0 --model none").contains("models of the registry: fitted-model"));
}

/// This command is built without the tensor library, unlike the tests of the workspace.
#[test]
fn commands_that_need_baselines_name_the_feature() {
    let folder = tempfile::tempdir().unwrap();
    for line in [
        "train --list",
        "checkpoints runs/lewm",
        "export runs/lewm --out published",
        "eval demo/IceRink-v0 --policy mpc:runs/lewm",
        "eval demo/IceRink-v0 --policy lewm:published",
        "render demo/IceRink-v0 --policy gcbc:runs/gcbc --out a.png",
    ] {
        let output = run(folder.path(), line);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {message}");
        assert!(message.contains("baselines") && !message.contains("did you mean"), "{line}: {message}");
    }
}
