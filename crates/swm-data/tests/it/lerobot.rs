//! LeRobot folders, as pyarrow and PyAV write them: values, pictures, damage.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Batch;
use swm_data::{Steps, WriteMode, create, open};

use crate::mutations::mutate;
use crate::support::{bits, contents};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets").join(name)
}

fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copied(&entry.path(), &target),
            false => drop(fs::copy(entry.path(), target).unwrap()),
        }
    }
}

#[test]
fn both_versions_hold_the_values_that_were_written() {
    let expected: serde_json::Value =
        serde_json::from_slice(&fs::read(golden("expected_lerobot.json")).unwrap()).unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = golden(&format!("lerobot_{version}"));
        let mut dataset = open(&path).unwrap();
        assert_eq!((dataset.format(), dataset.num_episodes(), dataset.skipped()), ("lerobot", 2, &[][..]));
        assert_eq!([dataset.episode_len(0), dataset.episode_len(1)], [4, 6]);
        let episodes = contents(&path);
        let all = |name: &str| -> Vec<u8> {
            let at = dataset.schema().require(name).unwrap();
            episodes.iter().flat_map(|batch: &Batch| bits(&batch.column(at).to_column())).collect()
        };
        assert_eq!(u64::from(crc32fast::hash(&all("proprio"))), expected["state_crc32"], "{version}");
        assert_eq!(u64::from(crc32fast::hash(&all("action"))), expected["action_crc32"], "{version}");
        let means = expected["frame_means"].as_array().unwrap();
        for (row, (frame, mean)) in all("pixels").chunks_exact(32 * 48 * 3).zip(means).enumerate() {
            let found = frame.iter().map(|&value| f64::from(value)).sum::<f64>() / frame.len() as f64;
            assert!(
                (found - mean.as_f64().unwrap()).abs() < 2.0,
                "{version}, row {row}: {found}, not {mean}"
            );
        }
        assert_eq!(episodes[1].get::<i64>("step_idx").unwrap(), [0, 1, 2, 3, 4, 5]);
        assert_eq!(episodes[1].get::<i32>("ep_idx").unwrap(), [1; 6]);
        assert_eq!(episodes[1].get::<i64>("frame_index").unwrap(), [0, 1, 2, 3, 4, 5]);
        assert_eq!(episodes[1].get::<bool>("next.done").unwrap()[4..], [false, true]);
        // A window, and a jump back.
        let pixels = dataset.schema().index("pixels").unwrap();
        for (first, stride) in [(3, 2), (0, 5)] {
            let mut out = vec![0; 2 * 32 * 48 * 3];
            let steps = Steps { first, count: 2, stride };
            dataset.read_column(pixels, 1, steps, swm_core::SliceMut::U8(&mut out)).unwrap();
            for (frame, row) in out.chunks_exact(32 * 48 * 3).zip([first, first + stride]) {
                assert!(
                    frame == &episodes[1].get::<u8>("pixels").unwrap()[row * frame.len()..][..frame.len()]
                );
            }
        }
    }
}

#[test]
fn they_are_only_read_and_only_inside_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    let message =
        create(&folder.path().join("x.lerobot"), WriteMode::Append, None).err().unwrap().to_string();
    assert!(message.contains("only read"), "{message}");
    for version in ["v2.1", "v3.0"] {
        let path = folder.path().join(version);
        copied(&golden(&format!("lerobot_{version}")), &path);
        let info = path.join("meta/info.json");
        let text = fs::read_to_string(&info).unwrap();
        for (from, to) in [("\"data/", "\"../data/"), ("\"videos/", "\"/videos/"), ("\"v", "\"v1")] {
            fs::write(&info, text.replace(from, to)).unwrap();
            assert!(open(&path).is_err(), "{from} {to}");
        }
    }
}

#[test]
fn a_film_that_cannot_be_decoded_is_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    copied(&golden("lerobot_v3.0"), &path);
    let film = path.join("videos/observation.images.top/chunk-000/file-000.mp4");
    let mut bytes = fs::read(&film).unwrap();
    let at = bytes.windows(4).position(|window| window == b"avc1").unwrap();
    let at = bytes[at + 4..].windows(4).position(|window| window == b"avc1").map_or(at, |next| at + 4 + next);
    bytes[at..at + 4].copy_from_slice(b"av01");
    fs::write(&film, bytes).unwrap();
    let dataset = open(&path).unwrap();
    assert!(dataset.schema().index("pixels").is_none() && dataset.schema().index("proprio").is_some());
    let (name, reason) = &dataset.skipped()[0];
    assert!(name == "observation.images.top" && reason.contains("`av01`"), "{name}: {reason}");
}

#[test]
fn no_mutation_makes_it_trip() {
    let folder = tempfile::tempdir().unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = folder.path().join(version);
        copied(&golden(&format!("lerobot_{version}")), &path);
        mutate(version, &path);
    }
}
