//! Results that are handed on: a bundle verifies without what it was made of, and a board is a page of bundles.

use crate::evaluation::{QUICK, dataset, manifest};
use crate::support::{Folder, swm_fails, swm_json, swm_ok};

#[test]
fn a_bundle_verifies_without_dataset_manifest_and_result() {
    let folder = Folder::new();
    let task = manifest(&folder, "historic", "m.toml", &[]);
    let (result, bundle, moved) = (folder.path("result"), folder.path("bundle"), folder.path("moved"));
    let eval = ["eval", "--manifest", &task, "--policy", QUICK, "--reference", "random", "--quiet"];
    swm_ok(&[&eval[..], &["--out", &result]].concat());
    let told = swm_ok(&["bundle", &result, "--out", &bundle]);
    assert!(told.contains("4 files") && !told.contains("object of Python"), "{told}");
    assert!(swm_fails(2, &["bundle", &result, "--out", &bundle]).contains("give another --out"));
    std::fs::rename(&bundle, &moved).unwrap();
    for path in [&dataset(&folder), &task] {
        std::fs::remove_file(path).unwrap();
    }
    std::fs::remove_dir_all(&result).unwrap();
    let verified = swm_json(&["verify-result", &moved, "--quiet", "--num-envs", "2"]);
    assert_eq!(verified["equal"], true, "{verified}");

    // One byte of a start or goal.
    let path = format!("{moved}/manifest.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen("\"seed\": 42", "\"seed\": 43", 1)).unwrap();
    let message = swm_fails(2, &["verify-result", &moved, "--quiet"]);
    assert!(message.contains("manifest.json was changed"), "{message}");
    assert!(
        swm_fails(2, &["board", &moved, "--out", &folder.path("board")])
            .contains("manifest.json was changed")
    );
    assert!(!std::path::Path::new(&folder.path("board")).exists());
}

#[test]
fn a_board_compares_bundles_and_runs_them_again() {
    let folder = Folder::new();
    let task = manifest(&folder, "historic", "m.toml", &[]);
    let bundles: Vec<String> = ["random", "constant"]
        .iter()
        .map(|policy| {
            let (result, bundle) = (folder.path(policy), folder.path(&format!("{policy}-bundle")));
            let eval = ["eval", "--manifest", &task, "--policy", policy, "--reference", "none", "--quiet"];
            swm_ok(&[&eval[..], &["--out", &result]].concat());
            swm_ok(&["bundle", &result, "--out", &bundle, "--reported", "50", "--source", "a paper"]);
            bundle
        })
        .collect();
    let board = folder.path("board");
    let told = swm_ok(&["board", &bundles[0], &bundles[1], "--out", &board, "--rerun", "--quiet"]);
    for text in ["random-bundle", "first − this", "reproduced", "a paper", "index.html"] {
        assert!(told.contains(text), "{told}");
    }
    let json = swm_json(&["board", &bundles[0], "--out", &board]);
    assert_eq!(json["reported"][0]["reported"], 50.0);
    let message = swm_fails(2, &["board", &folder.path("random"), "--out", &board]);
    assert!(message.contains("it is a result; `swm bundle` makes"), "{message}");
    assert!(swm_fails(2, &["board", &bundles[0], "--oracle", "--out", &board]).contains("--rerun"));
}
