//! Results stay what they are, and say which pairs they are of.

use serde_json::Value as Json;

use crate::evaluation::{QUICK, manifest, read};
use crate::support::{Folder, PUSHT, swm, swm_fails, swm_json, swm_ok};

#[test]
fn a_result_is_neither_replaced_nor_repeated_unasked() {
    let folder = Folder::new();
    let (task, other) = (
        manifest(&folder, "historic", "m.toml", &[]),
        manifest(&folder, "historic", "n.toml", &["--seed", "5"]),
    );
    let out = folder.path("out");
    let eval = |task: &str, policy: &str, extra: &[&str]| {
        let args = ["eval", "--manifest", task, "--policy", policy, "--out", &out];
        let args: Vec<String> = [&args[..], extra].concat().into_iter().map(str::to_owned).collect();
        args
    };
    let said = |args: Vec<String>| {
        let output = swm(&args.iter().map(String::as_str).collect::<Vec<_>>()).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let receipt = || std::fs::read(format!("{out}/receipt.json")).unwrap();
    assert_eq!(said(eval(&task, "random", &["--reference", "no-op"])).0, Some(0));
    let first = receipt();
    let (status, message) = said(eval(&task, "random", &["--reference", "no-op"]));
    assert!(status == Some(0) && message.contains("already done; give --again to repeat it"), "{message}");
    assert_eq!(receipt(), first, "it was not written again");
    for (args, differs) in [
        (eval(&task, "constant", &[]), "policy `random"),
        (eval(&other, "random", &[]), "the manifest "),
        (eval(&task, "random", &["--policy-seed", "3"]), "policy seed 0, not 3"),
    ] {
        let (status, message) = said(args);
        assert!(status == Some(2) && message.contains(differs) && message.contains("--again"), "{message}");
        assert_eq!(receipt(), first);
    }
    // Reference policies that were left out are added, and the policy is not run again. Its result comes before the oracle's.
    let (status, message) = said(eval(&task, "random", &["--reference", "no-op,oracle", "--oracle", QUICK]));
    assert_eq!(status, Some(0), "{message}");
    assert!(message.contains("takes longest; give --reference random,no-op to leave it out"), "{message}");
    let (before, after): (Json, Json) =
        (serde_json::from_slice(&first).unwrap(), serde_json::from_slice(&receipt()).unwrap());
    assert_eq!((&before["episodes"], &before["wall_time_s"]), (&after["episodes"], &after["wall_time_s"]));
    assert_eq!(after["references"].as_array().unwrap().len(), 2);
    let (status, message) = said(eval(&task, "random", &["--oracle", "constant"]));
    assert!(status == Some(2) && message.contains("oracle"), "{message}");
    assert_eq!(said(eval(&task, "constant", &["--reference", "none", "--again"])).0, Some(0));
    let replaced: Json = serde_json::from_slice(&receipt()).unwrap();
    assert_eq!(replaced["candidate"]["policy"]["name"], "constant");

    // Without a manifest.
    let online = ["eval", PUSHT, "--policy", "random", "--episodes", "1", "--budget", "2", "--videos", "0"];
    let online = |out| [&online[..], &["--image-size", "none", "--quiet", "--out", out]].concat();
    assert!(swm_fails(2, &online(&out)).contains("receipt.json; give another --out, or --again"));
    let out = folder.path("online");
    let online = online(&out);
    swm_ok(&online);
    assert!(swm_fails(2, &online).contains("--again"));
    swm_ok(&[&online[..], &["--again"]].concat());
}

#[test]
fn a_sweep_says_what_is_sampled_without_it() {
    let folder = Folder::new();
    let task = folder.path("sampled.toml");
    let make =
        ["manifest", "make", "swm/TwoRoom-v2", "--tier", "historic", "--episodes", "2", "--budget", "5"];
    swm_ok(&[&make[..], &["--out", &task]].concat());
    let sweep = ["sweep", "--manifest", &task, "--policy", "random", "--quiet", "--factors"];
    let note = |factors: &str| {
        let sweep = swm_json(&[&sweep[..], &[factors]].concat());
        sweep["cells"][1]["note"].as_str().unwrap_or_default().to_owned()
    };
    assert_eq!(note("agent.position"), "nothing changes: the unchanged episodes sample it, too");
    assert_eq!(note("agent.color"), "every episode goes as without the change");
    assert_eq!(note("agent.position+agent.color"), "every episode goes as without the change");
}

#[test]
fn a_sweep_counts_the_pairs_that_can_have_a_value() {
    let folder = Folder::new();
    let (data, task) = (folder.path("rooms.h5"), folder.path("rooms.toml"));
    let collect =
        ["collect", "swm/TwoRoom-v2", "--policy", "noisy-expert:2", "--episodes", "12", "--max-steps", "40"];
    swm_ok(&[&collect[..], &["--image-size", "none", "--out", &data, "--quiet"]].concat());
    let make =
        ["manifest", "make", "swm/TwoRoom-v2", "--dataset", &data, "--tier", "historic", "--episodes", "12"];
    swm_ok(&[&make[..], &["--budget", "3", "--goal-offset", "10", "--out", &task]].concat());
    let sweep = |factor: &str, out: &str| {
        let out = folder.path(out);
        let args = ["sweep", "--manifest", &task, "--policy", "constant", "--factors", factor];
        swm_json(&[&args[..], &["--values", "extremes", "--out", &out, "--quiet"]].concat())
    };
    // No door may be that small for the agent: the smallest that fits is taken.
    let doors = sweep("door.size", "doors");
    let (lowest, note) = (&doors["cells"][1], doors["cells"][1]["note"].as_str().unwrap());
    assert_eq!(lowest["summary"]["episodes"], 12, "{note}");
    assert!(note.contains("nearest possible value in 12 of 12 pairs"), "{note}");
    // A thick wall leaves out the pairs that start inside it, and no others.
    let walls = sweep("wall.thickness", "walls");
    let thickest = &walls["cells"][2];
    assert!(thickest["value"].as_str().unwrap().starts_with("highest ("), "{thickest}");
    let count = thickest["summary"]["episodes"].as_u64().unwrap();
    assert_eq!(count, 12, "nearer values are found for all: {}", thickest["note"]);

    let again = ["sweep", "--manifest", &task, "--policy", "random", "--factors", "door.size"];
    let message = swm_fails(2, &[&again[..], &["--out", &folder.path("doors")]].concat());
    assert!(
        message.contains("a sweep with policy `constant`, not `random`") && message.contains("--again"),
        "{message}"
    );
}

#[test]
fn results_on_one_manifest_are_compared_pair_by_pair() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let eval = |out: &str, policy: &str, seed: &str| {
        let out = folder.path(out);
        let args = ["eval", "--manifest", &manifest, "--policy", policy, "--reference", "none", "--quiet"];
        swm_ok(&[&args[..], &["--out", &out, "--policy-seed", seed]].concat());
        out
    };
    let (a, b, c) = (eval("a", QUICK, "0"), eval("b", QUICK, "1"), eval("c", "constant", "0"));
    let (first, second) = (read(&format!("{a}/receipt.json")), read(&format!("{b}/receipt.json")));
    assert_eq!(first["manifest_hash"], second["manifest_hash"]);
    assert_ne!(
        first["episodes"][0]["decisions"], second["episodes"][0]["decisions"],
        "noise has a seed of its own"
    );
    let compared = swm_json(&["compare", &format!("{a},{b}"), &c]);
    assert_eq!(compared[0]["runs"], 2);
    assert_eq!(compared[1]["test"]["pairs"], 5);
    assert_eq!(
        compared[1]["test"]["runs"],
        serde_json::json!([2, 1]),
        "all runs of both sides are in the test"
    );
    let rate =
        |path: &str| read(&format!("{path}/receipt.json"))["summary"]["success_rate"].as_f64().unwrap();
    let difference = compared[1]["test"]["difference"].as_f64().unwrap();
    assert!((difference - ((rate(&a) + rate(&b)) / 2.0 - rate(&c))).abs() < 1e-9, "{compared}");
    let message = swm_fails(2, &["compare", &format!("{a},{a}"), &c]);
    assert!(message.contains("same policy seed"), "{message}");
    let message = swm_fails(2, &["compare", &format!("{a},{c}")]);
    assert!(message.contains("not runs of one policy"), "{message}");
    let told = swm_ok(&["compare", &format!("{a},{b}"), &c]);
    assert!(told.contains("(policy seed 0, 1)") && told.matches("policy seed").count() == 1, "{told}");
    // Seeds belong to the run: as a setting, they make another policy.
    let d = eval("d", &format!("{QUICK},seed=1"), "0");
    let message = swm_fails(2, &["compare", &format!("{a},{d}")]);
    for word in ["not runs of one policy", "its setting `seed`", "policy seeds 1, 2"] {
        assert!(message.contains(word), "{message}");
    }
}

/// Of version 1: `beside` for `references`, with the roles `do_nothing` and `ceiling`, a hash of tables over help texts, and a
/// setting of iCEM under its former name.
#[test]
fn receipts_of_version_1_verify() {
    let old = concat!(env!("CARGO_MANIFEST_DIR"), "/integration/receipt-v1.json");
    let result = swm_json(&["verify-result", old, "--oracle", "--quiet"]);
    assert_eq!((&result["equal"], &result["differences"]), (&true.into(), &Json::Object(Default::default())));
    assert!(result["notes"][0].as_str().unwrap().contains("version 1"), "{result}");
    // Everything but that hash is compared, the reference policies included.
    let folder = Folder::new();
    let changed = folder.path("changed.json");
    let mut receipt = read(old);
    receipt["fingerprints"]["tables"] = "0".into();
    std::fs::write(&changed, receipt.to_string()).unwrap();
    assert_eq!(swm_json(&["verify-result", &changed, "--quiet"])["equal"], true);
    receipt["beside"][1]["episodes"][0]["digest"] = "0".into();
    std::fs::write(&changed, receipt.to_string()).unwrap();
    assert!(swm_fails(1, &["verify-result", &changed, "--quiet"]).contains("not equal"));

    // An object of Python, of which the receipt has the name alone.
    receipt["candidate"]["policy"]["name"] = "WorldModelPolicy(CEMSolver, Cost, horizon 5)".into();
    std::fs::write(&changed, receipt.to_string()).unwrap();
    let message = swm_fails(1, &["verify-result", &changed, "--quiet"]);
    assert!(message.contains("`WorldModelPolicy(CEMSolver, Cost, horizon 5)` was an object of"), "{message}");
    assert!(
        message.contains("swm.verify(receipt, policy=") && !message.contains("unknown policy"),
        "{message}"
    );

    let task = folder.path("task.json");
    std::fs::write(&task, receipt["manifest"].to_string()).unwrap();
    let args = ["eval", "--manifest", &task, "--policy", "random", "--oracle", QUICK, "--quiet"];
    let written = swm_json(&[&args[..], &["--reference", "no-op,oracle"]].concat());
    let references = written["references"].as_array().unwrap().iter();
    assert_eq!(
        references.map(|known| known["role"].as_str().unwrap()).collect::<Vec<_>>(),
        ["no_op", "oracle"]
    );
    assert_eq!(written["receipt"], 2);
    assert_eq!(written["manifest_hash"], receipt["manifest_hash"], "a task keeps its hash");
}
