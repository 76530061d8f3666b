//! Other programs and ours read each other's files: h5py with hdf5plugin, as the reference does.
//!
//! `cargo xtask test` makes the virtual environment and names its Python in `SWM_INTEROP_PYTHON`.

use std::process::Command;

use crate::support::{Folder, PUSHT, root, swm_json, swm_ok};

/// The Python with h5py; says so where there is none.
fn python() -> Option<String> {
    let python = std::env::var("SWM_INTEROP_PYTHON").ok();
    if python.is_none() {
        eprintln!(
            "skipped: no SWM_INTEROP_PYTHON; `cargo xtask test` makes that environment and runs this test"
        );
    }
    python
}

fn script(python: &str, name: &str, args: &[&str]) -> serde_json::Value {
    let script = root().join("tests/interop").join(name);
    let output = Command::new(python).arg(script).args(args).output().expect("Python starts");
    assert!(output.status.success(), "{name}:\n{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("the script prints JSON")
}

#[test]
fn h5py_reads_our_files_as_the_reference_does() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    let out = folder.path("ours.h5");
    swm_ok(&[
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--episodes",
        "3",
        "--max-steps",
        "9",
        "--image-size",
        "32x32",
        "--vary",
        "all",
        "--out",
        &out,
        "--quiet",
    ]);
    let seen = script(&python, "read_ours.py", &[&out]);
    let ours = swm_json(&["inspect", &out]);
    assert_eq!(seen["episodes"], ours["episodes"]);
    assert_eq!(seen["steps"], ours["steps"]);
    for (name, column) in ours["columns"].as_object().unwrap() {
        assert_eq!(seen["columns"][name]["shape"], column["shape"], "{name}");
        assert_eq!(seen["columns"][name]["dtype"], column["dtype"], "{name}");
    }
    assert_eq!(seen["last_actions_are_nan"], true);
    assert_eq!(seen["metadata"]["env"], PUSHT);
}

#[test]
fn our_reader_sees_the_same_values_as_h5py() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    let theirs = folder.path("theirs.h5");
    let expected = script(&python, "write_theirs.py", &[&theirs]);
    let seen = crate::support::content(&theirs);
    let shown = swm_json(&["inspect", &theirs]);
    assert_eq!(shown["episodes"], expected["episodes"]);
    assert_eq!(shown["steps"], expected["steps"]);
    for (name, hash) in expected["hashes"].as_object().unwrap() {
        let hash: u64 = hash.as_str().unwrap().parse().unwrap();
        assert_eq!(seen[name], hash, "column {name}");
    }
}
