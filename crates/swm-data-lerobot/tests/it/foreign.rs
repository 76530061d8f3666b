//! Folders that other programs wrote.

use std::fs;

use swm_core::Batch;
use swm_data::{Steps, WriteMode};

use crate::copied;
use crate::golden;
use crate::support::{bits, contents, record};
use crate::{mutate, open};

#[test]
fn both_versions_hold_the_values_that_were_written() {
    let expected: serde_json::Value =
        serde_json::from_slice(&fs::read(golden("expected_lerobot.json")).unwrap()).unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = golden(&format!("lerobot_{version}"));
        let mut dataset = open(&path).unwrap();
        assert_eq!(
            (dataset.info().format, dataset.num_episodes(), dataset.info().skipped.len()),
            ("lerobot", 2, 0)
        );
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
        assert_eq!(episodes[1].get::<bool>("terminated").unwrap()[4..], [false, true]);
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

/// Videos in AV1 are what LeRobot itself writes: the same images, encoded by SVT-AV1 at LeRobot's settings.
#[test]
fn videos_in_av1_hold_the_images_that_were_encoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    copied(&golden("lerobot_v3.0"), &path);
    let video = path.join("videos/observation.images.top/chunk-000/file-000.mp4");
    fs::copy(golden("lerobot_av1_top.mp4"), &video).unwrap();
    let in_av1 = contents(&path);
    let in_h264 = contents(&golden("lerobot_v3.0"));
    for (av1, h264) in in_av1.iter().zip(&in_h264) {
        assert_eq!(av1.get::<f32>("proprio").unwrap(), h264.get::<f32>("proprio").unwrap());
        let (av1, h264) = (av1.get::<u8>("pixels").unwrap(), h264.get::<u8>("pixels").unwrap());
        assert_eq!(av1.len(), h264.len());
        let squares: f64 = av1.iter().zip(h264).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
        let error = (squares / av1.len() as f64).sqrt();
        assert!((0.1..8.0).contains(&error), "{error}");
    }
    // Damage in the video is an error or other images, and the numbers stay.
    let bytes = fs::read(&video).unwrap();
    let mut errors = 0;
    for at in (0..bytes.len()).step_by(bytes.len() / 60) {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x24;
        fs::write(&video, bytes).unwrap();
        let Ok(mut dataset) = open(&path) else { continue };
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        errors += (0..2).filter(|&episode| dataset.read(episode, 0..4, &mut batch).is_err()).count();
    }
    assert!(errors > 5, "{errors}");
}

#[test]
fn other_programs_folders_are_not_continued_and_read_only_inside() {
    let folder = tempfile::tempdir().unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = folder.path().join(version);
        copied(&golden(&format!("lerobot_{version}")), &path);
        let message = record(&path, WriteMode::Append, 0..1).unwrap_err().to_string();
        assert!(message.contains("another program"), "{message}");
        let info = path.join("meta/info.json");
        let text = fs::read_to_string(&info).unwrap();
        for (from, to) in [("\"data/", "\"../data/"), ("\"videos/", "\"/videos/"), ("\"v", "\"v1")] {
            fs::write(&info, text.replace(from, to)).unwrap();
            assert!(open(&path).is_err(), "{from} {to}");
        }
    }
}

#[test]
fn a_video_that_cannot_be_decoded_is_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    copied(&golden("lerobot_v3.0"), &path);
    let video = path.join("videos/observation.images.top/chunk-000/file-000.mp4");
    let mut bytes = fs::read(&video).unwrap();
    let at = bytes.windows(4).position(|window| window == b"avc1").unwrap();
    let at = bytes[at + 4..].windows(4).position(|window| window == b"avc1").map_or(at, |next| at + 4 + next);
    bytes[at..at + 4].copy_from_slice(b"vp09");
    fs::write(&video, bytes).unwrap();
    let dataset = open(&path).unwrap();
    assert!(dataset.schema().index("pixels").is_none() && dataset.schema().index("proprio").is_some());
    let (name, reason) = &dataset.info().skipped[0];
    assert!(name == "observation.images.top" && reason.contains("`vp09`"), "{name}: {reason}");
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

/// As another program leaves it that rewrites a folder of ours.
#[test]
fn columns_that_are_made_up_for_others_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.lerobot");
    record(&path, WriteMode::Error, 0..2).unwrap();
    fs::remove_file(path.join("meta/swm.json")).unwrap();
    let mut dataset = open(&path).unwrap();
    let skipped: Vec<&str> = dataset.info().skipped.iter().map(|(name, _)| name.as_str()).collect();
    let has = |name: &str| dataset.schema().fields().iter().any(|field| field.name == name);
    assert!(has("step_idx") && has("ep_idx") && has("action"), "{skipped:?}");
    assert_eq!(dataset.num_episodes(), 2);
    (0..2).for_each(|episode| dataset.check_episode(episode).unwrap());
}
