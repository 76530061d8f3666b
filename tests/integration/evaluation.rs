//! Manifests, receipts, comparisons: what can be repeated is, to the last bit; what differs is named.

use serde_json::Value as Json;

use crate::support::{Folder, PUSHT, swm, swm_fails, swm_json, swm_ok};

/// A planner that is done soon.
pub(crate) const QUICK: &str =
    "cem:samples=20,elites=5,iterations=3,horizon=2,receding_horizon=2,action_block=4";

/// A recording of 30 episodes, made once.
pub(crate) fn dataset(folder: &Folder) -> String {
    let out = folder.path("pusht.h5");
    if std::path::Path::new(&out).exists() {
        return out;
    }
    let args = ["collect", PUSHT, "--policy", "weak", "--episodes", "30", "--max-steps", "50", "--quiet"];
    swm_ok(&[&args[..], &["--image-size", "none", "--seed", "3", "--out", &out]].concat());
    out
}

/// A manifest of few pairs of the dataset.
pub(crate) fn manifest(folder: &Folder, tier: &str, name: &str, extra: &[&str]) -> String {
    let (data, out) = (dataset(folder), folder.path(name));
    let args =
        ["manifest", "make", PUSHT, "--tier", tier, "--episodes", "5", "--budget", "16", "--dataset", &data];
    swm_ok(&[&args[..], &["--out", &out], extra].concat());
    out
}

#[test]
fn a_manifest_says_which_factors_are_set_and_so_not_sampled() {
    let folder = Folder::new();
    let (data, out) = (dataset(&folder), folder.path("m.toml"));
    let make =
        ["manifest", "make", PUSHT, "--tier", "historic", "--episodes", "2", "--out", &out, "--overwrite"];
    let factors =
        ["--set", "agent.color=red", "--set", "agent.color=gray", "--vary", "agent.color,block.color"];
    for source in [&["--dataset", &data][..], &[]] {
        let made = swm(&[&make[..], &factors, source].concat()).output().unwrap();
        let said = String::from_utf8_lossy(&made.stderr);
        let note = "note: --vary agent.color: samples nothing, since the factor is set";
        assert!(made.status.success() && said.contains(note), "{said}");
        assert!(!said.contains("--vary block.color: samples nothing"), "{said}");
        let note = "note: --set agent.color=gray replaces the earlier --set of `agent.color`";
        assert!(said.contains(note), "{said}");
    }
    let yaml = folder.path("m.yaml");
    let message =
        swm_fails(2, &["manifest", "make", PUSHT, "--tier", "historic", "--episodes", "2", "--out", &yaml]);
    assert!(message.contains("m.yaml: a manifest is TOML or JSON"), "{message}");
    assert!(!std::path::Path::new(&yaml).exists());
}

pub(crate) fn read(path: &str) -> Json {
    serde_json::from_str(&std::fs::read_to_string(path).expect("it was written")).expect("it is JSON")
}

#[test]
fn manifests_are_the_same_in_both_languages_and_every_time() {
    let folder = Folder::new();
    let (a, b) = (
        manifest(&folder, "strict", "a.toml", &["--held-out", "1"]),
        manifest(&folder, "strict", "b.json", &["--held-out", "1"]),
    );
    let show = |path: &str| {
        let mut shown = swm_json(&["manifest", "show", path]);
        shown["manifest"].take();
        shown
    };
    assert_eq!(show(&a), show(&b));
    let pairs = read(&b);
    let froms: Vec<u64> =
        pairs["pairs"].as_array().unwrap().iter().map(|pair| pair["from"][0].as_u64().unwrap()).collect();
    assert!(froms.windows(2).all(|pair| pair[0] < pair[1]), "one pair per episode, in order: {froms:?}");
    for pair in pairs["pairs"].as_array().unwrap() {
        let number = |side: &str, i: usize| pair[side]["state"][i].as_f64().unwrap();
        assert_eq!([number("start", 5), number("start", 6)], [0.0, 0.0], "starts are at rest");
        let moved = (number("start", 2) - number("goal", 2)).hypot(number("start", 3) - number("goal", 3));
        assert!(moved >= 50.0, "the block must move: {moved}");
    }
    let historic = manifest(&folder, "historic", "c.json", &[]);
    assert_eq!(read(&historic)["excluded"]["solved_at_start"], 0, "historic manifests leave nothing out");
}

#[test]
fn receipts_are_bit_equal_for_any_number_of_environments_and_threads() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let run = |out: &str, num_envs: &str, threads: &str| {
        let out = folder.path(out);
        let args = ["eval", "--manifest", &manifest, "--policy", QUICK, "--quiet", "--out", &out];
        let mut receipt = swm_json(&[&args[..], &["--num-envs", num_envs, "--threads", threads]].concat());
        receipt["wall_time_s"].take();
        receipt
    };
    let first = run("a", "1", "1");
    assert_eq!(first["episodes"].as_array().unwrap().len(), 5);
    assert_eq!(first["references"].as_array().unwrap().len(), 3, "random, no-op, oracle");
    let settings = &first["candidate"]["policy"]["named"];
    assert_eq!(settings["stop_at_success"], false, "the manifest has a test of its own: {settings}");
    assert_eq!(first["references"][2]["candidate"]["policy"]["named"], *settings);
    assert_eq!(first, run("b", "5", "1"));
    assert_eq!(first, run("c", "2", "2"));
    for (num_envs, threads) in [("1", "1"), ("4", "2")] {
        let out = folder.path("b");
        let result =
            swm_json(&["verify-result", &out, "--num-envs", num_envs, "--threads", threads, "--quiet"]);
        assert_eq!(result["equal"], true, "{result}");
    }
}

#[test]
fn what_differs_is_named() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "historic", "m.toml", &[]);
    let out = folder.path("out");
    swm_ok(&[
        "eval",
        "--manifest",
        &manifest,
        "--policy",
        QUICK,
        "--reference",
        "random,no-op",
        "--out",
        &out,
        "--quiet",
    ]);
    let receipt = read(&format!("{out}/receipt.json"));
    let changed = folder.path("changed.json");
    let differs = |change: &dyn Fn(&mut Json)| -> Vec<String> {
        let mut copy = receipt.clone();
        change(&mut copy);
        std::fs::write(&changed, copy.to_string()).unwrap();
        let output = swm(&["verify-result", &changed, "--json", "--quiet"]).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
        let result: Json = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(result["equal"], false);
        result["differences"].as_object().unwrap().keys().cloned().collect()
    };
    assert_eq!(differs(&|r| r["manifest"]["budget"] = 17.into()), ["protocol"]);
    assert_eq!(differs(&|r| r["fingerprints"]["tables"] = "0".into()), ["protocol"]);
    assert_eq!(differs(&|r| r["fingerprints"]["physics"] = "0".into()), ["physics"]);
    assert_eq!(differs(&|r| r["candidate"]["seed"] = 9.into()), ["seed"]);
    assert_eq!(differs(&|r| r["candidate"]["policy"]["named"]["samples"] = 21.into()), ["solver"]);
    assert_eq!(differs(&|r| r["episodes"][2]["decisions"] = "0".into()), ["solver"]);
    assert_eq!(differs(&|r| r["episodes"][2]["digest"] = "0".into()), ["physics"]);
    assert_eq!(differs(&|r| r["episodes"][2]["steps"] = 1.into()), ["outcomes"]);
    assert_eq!(differs(&|r| r["summary"]["successes"] = 400.into()), ["outcomes"]);
    assert_eq!(differs(&|r| r["references"][0]["episodes"][3]["digest"] = "0".into()), ["references"]);
    // Whatever is derived follows from the episodes.
    assert_eq!(differs(&|r| r["summary"]["success_rate"] = 99.5.into()), ["outcomes"]);
    assert_eq!(differs(&|r| r["summary"]["ci95"] = [0.0, 1.0].to_vec().into()), ["outcomes"]);
    let forge = |reference: usize, keys: [&'static str; 2], value: Json| {
        differs(&move |r| r["references"][reference][keys[0]][keys[1]] = value.clone())
    };
    for reference in [0, 1] {
        assert_eq!(forge(reference, ["summary", "success_rate"], 0.25.into()), ["references"]);
        assert_eq!(forge(reference, ["summary", "ci95"], [0.0, 1.0].to_vec().into()), ["references"]);
        assert_eq!(forge(reference, ["test", "p_value"], 1e-9.into()), ["references"]);
        assert_eq!(forge(reference, ["test", "difference"], 77.0.into()), ["references"]);
        assert_eq!(forge(reference, ["test", "pairs"], 999.into()), ["references"]);
    }
    // Another policy under the name of a reference, with its own episodes.
    let swapped = differs(&|r| {
        let other = r["references"][1].clone();
        let role = r["references"][0]["role"].clone();
        r["references"][0] = other;
        r["references"][0]["role"] = role;
    });
    assert_eq!(swapped, ["references"]);
    // Its noise is not that of the references of this candidate; a policy without noise acts as before.
    assert_eq!(differs(&|r| r["references"][1]["candidate"]["seed"] = 9.into()), ["references"]);
    assert_eq!(differs(&|r| r["episodes"][2]["total_reward"] = 1e-3.into()), ["outcomes"]);
    let mut other = receipt.clone();
    other["plan_steps"] = 2.into();
    std::fs::write(&changed, other.to_string()).unwrap();
    let output = swm(&["verify-result", &changed, "--json", "--quiet"]).output().unwrap();
    let result: Json = serde_json::from_slice(&output.stdout).unwrap();
    let notes = result["notes"].to_string();
    assert!(notes.contains("after plans of 2 actions, and not of the policy's 8"), "{result}");
    // Older receipts say nothing of the plans after the first.
    std::fs::write(&changed, without_plan_costs(receipt.clone()).to_string()).unwrap();
    assert_eq!(swm_json(&["verify-result", &changed, "--quiet"])["equal"], true);
}

#[test]
fn a_planner_on_the_true_dynamics_is_its_own_oracle() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "historic", "m.toml", &[]);
    for seed in ["0", "3"] {
        let out = folder.path(seed);
        // Whoever ran the oracle would write its episodes here, and could not.
        std::fs::create_dir_all(format!("{out}/episodes-oracle.jsonl")).unwrap();
        let args = ["eval", "--manifest", &manifest, "--policy", QUICK, "--policy-seed", seed, "--quiet"];
        let receipt = swm_json(&[&args[..], &["--reference", "oracle", "--out", &out]].concat());
        let oracle = &receipt["references"][0];
        assert_eq!(oracle["candidate"], receipt["candidate"]);
        assert_eq!(oracle["episodes"], receipt["episodes"]);
        assert_eq!(oracle["regret"]["at_end"], 0.0);
    }
    let out = folder.path("other");
    std::fs::create_dir_all(format!("{out}/episodes-oracle.jsonl")).unwrap();
    let args = ["eval", "--manifest", &manifest, "--policy", "random", "--oracle", QUICK, "--quiet"];
    let message = swm_fails(1, &[&args[..], &["--reference", "oracle", "--out", &out]].concat());
    assert!(message.contains("episodes-oracle.jsonl"), "{message}");
}

fn without_plan_costs(mut receipt: Json) -> Json {
    for episode in receipt["episodes"].as_array_mut().expect("a list") {
        let costs = episode.as_object_mut().and_then(|episode| episode.remove("plan_costs")).expect("costs");
        // 16 actions are two plans of 8.
        assert!(costs.as_array().is_some_and(|costs| costs.len() <= 2), "{costs}");
        assert_eq!(costs[0], episode["plan_cost"]);
    }
    receipt
}

#[test]
fn an_interrupted_evaluation_goes_on() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "historic", "m.toml", &[]);
    let run = |out: &str, policy: &str| {
        vec![
            "eval",
            "--manifest",
            &manifest,
            "--policy",
            policy,
            "--reference",
            "none",
            "--num-envs",
            "1",
            "--out",
            out,
        ]
        .into_iter()
        .map(str::to_owned)
        .collect::<Vec<_>>()
    };
    let (whole, parts) = (folder.path("whole"), folder.path("parts"));
    let ok = |args: Vec<String>| swm_ok(&args.iter().map(String::as_str).collect::<Vec<_>>());
    ok(run(&whole, QUICK));
    let mut expected = read(&format!("{whole}/receipt.json"));

    // What an interruption leaves: some episodes, and half a line. The ledger's head is made by a run that is stopped at
    // its first episode, by a folder in the place of the receipt.
    std::fs::create_dir_all(format!("{parts}/receipt.json")).unwrap();
    let args = run(&parts, QUICK);
    swm_fails(1, &args.iter().map(String::as_str).collect::<Vec<_>>());
    std::fs::remove_dir(format!("{parts}/receipt.json")).unwrap();
    let ledger = format!("{parts}/episodes.jsonl");
    assert!(std::path::Path::new(&ledger).exists(), "episodes are kept until the receipt has them");

    std::fs::write(&ledger, "{\"evaluation\":\"another\"}\n{\"episode\":0}\n").unwrap();
    let message = swm_fails(1, &args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(message.contains("another evaluation"), "{message}");
    std::fs::remove_file(&ledger).unwrap();

    let mut child = swm(&args.iter().map(String::as_str).collect::<Vec<_>>())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let lines = || std::fs::read_to_string(&ledger).map_or(0, |text| text.lines().count());
    while child.try_wait().unwrap().is_none() && lines() < 3 {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    child.kill().ok();
    child.wait().unwrap();
    if std::path::Path::new(&ledger).exists() {
        let mut text = std::fs::read_to_string(&ledger).unwrap();
        text.push_str("{\"episode\":4,\"succ");
        std::fs::write(&ledger, text).unwrap();
    }
    ok(args);
    let mut found = read(&format!("{parts}/receipt.json"));
    for receipt in [&mut found, &mut expected] {
        receipt["wall_time_s"].take();
    }
    assert_eq!(found, expected);
}

#[test]
fn streams_say_what_carries_over() {
    let folder = Folder::new();
    let (stream, out) = (folder.path("stream.toml"), folder.path("m.toml"));
    let phases = "[[phase]]\nepisodes = 2\n\n[[phase]]\nepisodes = 3\nvary = [\"block.color\"]\nset = { \"agent.scale\" = 25 }\n";
    std::fs::write(&stream, phases).unwrap();
    let make = [
        "manifest", "make", PUSHT, "--tier", "moderate", "--budget", "8", "--out", &out, "--stream", &stream,
    ];
    let message = swm_fails(2, &[&make[..], &["--episodes", "4"]].concat());
    assert!(message.contains("--episodes 5"), "{message}");
    let shown = swm_json(&[&make[..], &["--episodes", "5"]].concat());
    assert_eq!(shown["phases"], 2);
    let results: Vec<String> = ["random", "constant"]
        .iter()
        .map(|policy| {
            let dir = folder.path(policy);
            swm_ok(&[
                "eval",
                "--manifest",
                &out,
                "--policy",
                policy,
                "--reference",
                "none",
                "--out",
                &dir,
                "--quiet",
            ]);
            dir
        })
        .collect();
    let receipt = read(&format!("{}/receipt.json", results[0]));
    let counts: Vec<u64> = receipt["phases"]
        .as_array()
        .unwrap()
        .iter()
        .map(|phase| phase["episodes"].as_u64().unwrap())
        .collect();
    assert_eq!(counts, [2, 3]);
    let found = swm_json(&["compare", "--stream", &results[0], &results[1], "--untrained", &results[0]]);
    assert_eq!(found["results"].as_array().unwrap().len(), 2);
    assert!(found["transfer"]["backward"].is_number() && found["transfer"]["forward"].is_number());
}

#[test]
fn wrong_requests_are_refused() {
    let folder = Folder::new();
    let out = folder.path("m.toml");
    let says = |args: &[&str], words: &[&str]| {
        let message = swm_fails(2, args);
        for word in words {
            assert!(message.contains(word), "swm {args:?}: no `{word}` in\n{message}");
        }
    };
    let make =
        |env: &'static str, tier: &'static str| ["manifest", "make", env, "--tier", tier, "--out", &out];
    says(&make("swm/PointMaze-v0", "strict"), &["no strict tier", "swm/PushT-v1"]);
    says(&[&make(PUSHT, "moderate")[..], &["--episodes", "0"]].concat(), &["0 pairs"]);
    says(&[&make(PUSHT, "moderate")[..], &["--distractor", "noise"]].concat(), &["--image-size"]);
    let image = ["--image-size", "32", "--distractor", "noize"];
    says(&[&make(PUSHT, "moderate")[..], &image].concat(), &["did you mean `noise`?"]);
    says(&["eval", "--policy", "random"], &["nothing names the environment; give environment, or --man"]);
    says(&["eval", "--manifest", &out, "--policy", "random"], &["cannot read the manifest"]);
    swm_ok(&[&make(PUSHT, "moderate")[..], &["--episodes", "2", "--budget", "4"]].concat());
    says(&["eval", PUSHT, "--manifest", &out, "--policy", "random"], &["cannot be used with"]);
    says(&["eval", "--manifest", &out, "--policy", "randon"], &["did you mean `random`?"]);
    says(&["eval", "--manifest", &out, "--policy", "random", "--reference", "me"], &["no-op"]);
    std::fs::write(&out, "version = 2\n").unwrap();
    says(&["eval", "--manifest", &out, "--policy", "random"], &["m.toml"]);

    // A manifest whose environment has changed since does not pass in silence.
    swm_ok(&[&make(PUSHT, "moderate")[..], &["--episodes", "2", "--budget", "4", "--overwrite"]].concat());
    let text = std::fs::read_to_string(&out).unwrap();
    let (head, rest) = text.split_once("witness = \"").unwrap();
    let changed = format!("{head}witness = \"0{}", &rest[1..]);
    std::fs::write(&out, &changed).unwrap();
    says(
        &["eval", "--manifest", &out, "--policy", "random"],
        &["was changed after", "remove the line `hash = …`"],
    );
    let (_, unsealed) = changed.split_once('\n').unwrap();
    std::fs::write(&out, unsealed).unwrap();
    let message = swm_fails(1, &["eval", "--manifest", &out, "--policy", "random"]);
    assert!(message.contains("no longer starts as the manifest says"), "{message}");
}

#[test]
fn factors_are_swept_alone_in_groups_and_together() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let sweep = |out: &str, extra: &[&str]| {
        let out = folder.path(out);
        let args = ["sweep", "--manifest", &manifest, "--policy", "weak", "--out", &out, "--quiet"];
        (swm_json(&[&args[..], extra].concat()), out)
    };
    let factors = ["--factors", "agent.color,agent.scale,block.shape"];
    let (first, out) = sweep("a", &[&factors[..], &["--num-envs", "1"]].concat());
    assert_eq!(first, sweep("b", &[&factors[..], &["--num-envs", "3", "--threads", "2"]].concat()).0);
    let names: Vec<&str> =
        first["cells"].as_array().unwrap().iter().map(|cell| cell["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["unchanged", "block.shape", "agent.color", "agent.scale"]);
    assert!(
        first["cells"][2]["note"].as_str().unwrap().contains("every episode goes as without"),
        "a color moves nothing"
    );
    assert!(first["cells"][3]["note"].is_null(), "a scale does");
    let csv = std::fs::read_to_string(format!("{out}/sweep.csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert_eq!(csv.lines().count(), 5);
    assert!(csv.lines().all(|line| line.split(',').count() == columns), "{csv}");
    let svg = std::fs::read_to_string(format!("{out}/sweep.svg")).unwrap();
    assert!(svg.starts_with("<svg xmlns=") && svg.contains("block.shape") && !svg.contains("NaN"));

    let (grid, _) = sweep("c", &["--factors", "agent.scale", "--values", "grid", "--points", "3"]);
    assert_eq!(grid["cells"].as_array().unwrap().len(), 4);
    let (joint, _) = sweep("e", &["--factors", "agent.scale+block.shape"]);
    assert_eq!(joint["cells"][1]["name"], "agent.scale+block.shape");
    let (extremes, _) = sweep("d", &["--factors", "block.start_position", "--values", "extremes"]);
    let cells = extremes["cells"].as_array().unwrap();
    assert!(cells[1]["value"].as_str().unwrap().starts_with("lowest ("), "{cells:?}");
    let message =
        swm_fails(2, &["sweep", "--manifest", &manifest, "--policy", "weak", "--factors", "agent.colour"]);
    assert!(message.contains("did you mean `agent.color`?"), "{message}");
}
