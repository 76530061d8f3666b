//! Other programs and ours read each other's files: h5py with hdf5plugin, numpy with Pillow and PyAV, as the reference
//! does, the Python package of MCAP, and pyarrow, as LeRobot does.
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

/// A recording with images in a format.
fn recorded(folder: &Folder, name: &str) -> String {
    let out = folder.path(name);
    let fixed =
        ["--policy", "weak", "--episodes", "3", "--max-steps", "9", "--image-size", "48x48", "--quiet"];
    swm_ok(&[&["collect", PUSHT][..], &fixed, &["--out", &out]].concat());
    out
}

#[test]
fn numpy_pillow_pyav_mcap_and_pyarrow_read_our_files() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    for format in ["folder", "video", "mcap", "lerobot"] {
        if swm::registry().find::<swm::data::Format>(format).is_err() {
            eprintln!("skipped: built without the format `{format}`");
            continue;
        }
        let out = match format {
            // The script compares all rows.
            "lerobot" => {
                let out = folder.path("ours.lerobot");
                swm_ok(&["convert", &recorded(&folder, "ours.h5"), &out, "--last-row", "keep", "--quiet"]);
                out
            }
            _ => recorded(&folder, &format!("ours.{format}")),
        };
        let seen = script(&python, "read_formats.py", &[&out]);
        let shown = swm_json(&["inspect", &out]);
        assert_eq!((&seen["episodes"], &seen["steps"]), (&shown["episodes"], &shown["steps"]), "{format}");
        let ours = crate::support::content(&out);
        let mut columns = 0;
        for (name, hash) in seen["hashes"].as_object().unwrap() {
            assert_eq!(ours[name], hash.as_str().unwrap().parse::<u64>().unwrap(), "{format}: {name}");
            columns += 1;
        }
        let means = frame_means(&out);
        for (name, theirs) in seen["frame_means"].as_object().unwrap() {
            let theirs = theirs.as_array().unwrap();
            assert_eq!(theirs.len(), means[name].len(), "{format}: {name}");
            for (row, (ours, theirs)) in means[name].iter().zip(theirs).enumerate() {
                // Decoders may differ in the last bit of a value.
                let gap = (ours - theirs.as_f64().unwrap()).abs();
                assert!(gap < 1.0, "{format}: {name}, row {row}: {gap}");
            }
            columns += usize::from(format != "mcap");
        }
        assert_eq!(columns, shown["columns"].as_object().unwrap().len(), "{format}");
    }
}

/// The mean of every frame, by column of images.
fn frame_means(path: &str) -> std::collections::BTreeMap<String, Vec<f64>> {
    let mut dataset = swm::data::open(std::path::Path::new(path)).expect("a dataset");
    let schema = dataset.schema().clone();
    let mut means = std::collections::BTreeMap::<String, Vec<f64>>::new();
    let mut rows = swm::core::Batch::new(schema.clone(), 0);
    for episode in 0..dataset.num_episodes() {
        dataset.read(episode, 0..dataset.episode_len(episode), &mut rows).expect("its rows");
        for field in schema.fields().iter().filter(|field| field.shape.len() == 3) {
            let mean = |frame: &[u8]| frame.iter().map(|&v| f64::from(v)).sum::<f64>() / frame.len() as f64;
            let values = rows.get::<u8>(&field.name).expect("images");
            means.entry(field.name.clone()).or_default().extend(values.chunks(field.dim()).map(mean));
        }
    }
    means
}

#[test]
fn our_reader_sees_what_the_mcap_package_wrote() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    for compression in ["NONE", "LZ4", "ZSTD"] {
        let theirs = folder.path(&format!("{compression}.mcap"));
        let expected = script(&python, "write_log.py", &[&theirs, compression]);
        let seen = crate::support::content(&theirs);
        let shown = swm_json(&["inspect", &theirs]);
        assert_eq!((&shown["episodes"], &shown["steps"]), (&expected["episodes"], &expected["steps"]));
        for (name, hash) in expected["hashes"].as_object().unwrap() {
            assert_eq!(
                seen[name],
                hash.as_str().unwrap().parse::<u64>().unwrap(),
                "{compression}: column {name}"
            );
        }
        swm_ok(&["verify", &theirs, "--quiet"]);
    }
}

/// The block of a page that contains `line`, in Python.
fn block_of(page: &str, line: &str) -> String {
    let text = std::fs::read_to_string(root().join(page)).expect(page);
    let found = text.split("```python\n").skip(1).filter_map(|rest| rest.split_once("```"));
    found.map(|(block, _)| block.to_owned()).find(|block| block.contains(line)).expect(line)
}

#[test]
fn the_mcap_package_reads_a_killed_recording_as_the_page_describes() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    let whole = std::fs::read(recorded(&folder, "whole.mcap")).unwrap();
    let killed = folder.path("killed.mcap");
    // In the last episode, with that part of a chunk which the kill left.
    std::fs::write(&killed, &whole[..whole.len() * 3 / 4]).unwrap();
    let run = |code: &str| {
        let output = Command::new(&python).args(["-c", code]).current_dir(folder.path(".")).output();
        let output = output.expect("Python starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap().replace('\'', "\"");
        serde_json::from_str::<serde_json::Value>(&text).expect(&text)
    };
    let page = run(&block_of("docs/datasets.md", "NonSeekingReader"));
    let seeking = "from mcap.reader import make_reader\ntopics = {}\n\
        try:\n    for _, channel, _ in make_reader(open('killed.mcap', 'rb')).iter_messages():\n        \
        topics[channel.topic] = topics.get(channel.topic, 0) + 1\nexcept Exception as error:\n    \
        topics['error'] = type(error).__name__\nprint(topics)";
    let misled = run(seeking);
    assert!(misled["error"].is_string() && misled.as_object().unwrap().len() == 1, "{misled}");
    swm_ok(&["verify", &killed, "--fix", "--quiet"]);
    let fixed = run(seeking);
    let steps = swm_json(&["inspect", &killed])["steps"].as_u64().unwrap();
    assert_eq!(fixed["/step"], steps, "{fixed}");
    for (topic, count) in fixed.as_object().unwrap() {
        // Chunks that no commit follows are read by the package, and removed by `--fix`.
        assert!(page[topic].as_u64() >= count.as_u64(), "{topic}: {page} {fixed}");
    }
    assert!(steps > 0 && !fixed.as_object().unwrap().contains_key("error"), "{fixed}");
}

#[test]
fn our_reader_sees_what_pyarrow_and_svt_av1_wrote_for_lerobot() {
    let Some(python) = python() else { return };
    if swm::registry().find::<swm::data::Format>("lerobot").is_err() {
        eprintln!("skipped: built without the format `lerobot`");
        return;
    }
    let folder = Folder::new();
    let theirs = folder.path("theirs");
    let expected = script(&python, "write_lerobot.py", &[&theirs]);
    let seen = crate::support::content(&theirs);
    let shown = swm_json(&["inspect", &theirs]);
    assert_eq!((&shown["episodes"], &shown["steps"]), (&expected["episodes"], &expected["steps"]));
    for (name, hash) in expected["hashes"].as_object().unwrap() {
        assert_eq!(seen[name], hash.as_str().unwrap().parse::<u64>().unwrap(), "column {name}");
    }
    let (ours, theirs) = (&frame_means(&theirs)["pixels"], expected["frame_means"].as_array().unwrap());
    assert_eq!(ours.len(), theirs.len());
    for (row, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        let gap = (ours - theirs.as_f64().unwrap()).abs();
        assert!(gap < 0.05, "row {row}: {gap}");
    }
}
