//! Datasets of RLDS: the sample that TensorFlow Datasets wrote, and small ones with faults.

use std::fs;
use std::path::Path;

use serde_json::json;
use swm_core::Column;
use swm_data::OpenOptions;

use crate::published::{check, column_of, golden, lengths, numbers, opened, rows};

const SAMPLE: &str = "rlds_toy";

#[test]
fn records_of_tensorflow_are_episodes() {
    let names = [("action", "action", 1.0), ("state", "proprio", 1.0), ("reward", "reward", 1.0)];
    let mut dataset = check(SAMPLE, &OpenOptions::default(), &names);
    assert_eq!(lengths(dataset.as_ref()), [5, 3, 4]);
    let text = |dataset: &mut dyn swm_data::Dataset, name: &str, episode: usize| {
        let column = column_of(dataset, name);
        let Column::Str(texts) = rows(dataset, column, episode, 0, 1) else { panic!("{name}") };
        texts.into_iter().next().unwrap()
    };
    assert_eq!(text(dataset.as_mut(), "language_instruction", 0), "push block 0");
    assert!(text(dataset.as_mut(), "episode_metadata.file_path", 0).starts_with("raw/"));
    for (name, expected) in [("terminated", 1.0), ("truncated", 0.0), ("is_first", 0.0)] {
        let column = column_of(dataset.as_ref(), name);
        let values = numbers(&rows(dataset.as_mut(), column, 1, 0, 3));
        assert_eq!(values[2], expected, "{name}: {values:?}");
    }
    let pixels = column_of(dataset.as_ref(), "pixels");
    assert_eq!(dataset.schema().fields()[pixels].shape, [32, 32, 3]);
    let Column::U8(image) = rows(dataset.as_mut(), pixels, 1, 2, 1) else { panic!() };
    assert!(image.iter().any(|&byte| byte != image[0]), "it holds an image");
    let notes = dataset.info().notes.join("\n");
    assert!(notes.contains("order of their files") && notes.contains("`fps`"), "{notes}");
}

/// CRC-32C, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    let step = |sum: u32, _| if sum & 1 == 1 { sum >> 1 ^ 0x82f6_3b78 } else { sum >> 1 };
    !bytes.iter().fold(!0, |sum, &byte| (0..8).fold(sum ^ u32::from(byte), step))
}

fn masked(bytes: &[u8]) -> [u8; 4] {
    crc(bytes).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes()
}

fn part(number: u8, bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![number << 3 | 2];
    let mut size = bytes.len();
    while size > 127 {
        out.push(size as u8 | 128);
        size >>= 7;
    }
    out.push(size as u8);
    out.extend(bytes);
    out
}

/// An episode whose actions are numbers from `first` on, and which ends by `is_last`.
fn episode(first: u8, steps: u8) -> Vec<u8> {
    let entry = |key: &str, list: Vec<u8>| part(1, &[part(1, key.as_bytes()), part(2, &list)].concat());
    let values: Vec<u8> = (0..steps * 2).flat_map(|at| f32::from(first + at).to_le_bytes()).collect();
    let marks = |end: u8| -> Vec<u8> { (0..steps).map(|at| u8::from(at + 1 == steps) * end).collect() };
    let all = [
        entry("steps/action", part(2, &part(1, &values))),
        entry("steps/is_last", part(3, &part(1, &marks(1)))),
        entry("steps/is_terminal", part(3, &part(1, &marks(0)))),
        entry("id", part(3, &part(1, &[first]))),
    ];
    part(1, &all.concat())
}

fn write_shard(path: &Path, episodes: &[Vec<u8>]) {
    let mut bytes = Vec::new();
    for episode in episodes {
        let length = (episode.len() as u64).to_le_bytes();
        bytes.extend([&length[..], &masked(&length), episode, &masked(episode)].concat());
    }
    fs::write(path, bytes).unwrap();
}

/// A dataset of two parts, of which the first has two files.
fn write(folder: &Path) {
    let tensor = |dtype: &str, sizes: &[&str]| json!({"tensor": {"dtype": dtype, "encoding": "none", "shape": {"dimensions": sizes}}});
    let steps = json!({"featuresDict": {"features": {
        "action": tensor("float32", &["2"]), "is_last": tensor("bool", &[]), "is_terminal": tensor("bool", &[]),
        "cloud": tensor("float32", &["-1"]),
    }}});
    let features = json!({"featuresDict": {"features": {"steps": {"sequence": {"feature": steps}}, "id": tensor("int64", &[])}}});
    let split = |name: &str, lengths: &[&str]| json!({"name": name, "shardLengths": lengths, "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}"});
    let info = json!({"name": "mine", "fileFormat": "tfrecord", "splits": [split("val", &["1"]), split("train", &["2", "1"])]});
    fs::write(folder.join("features.json"), features.to_string()).unwrap();
    fs::write(folder.join("dataset_info.json"), info.to_string()).unwrap();
    let shard = |name: &str| folder.join(format!("mine-{name}"));
    write_shard(&shard("train.tfrecord-00000-of-00002"), &[episode(0, 2), episode(10, 3)]);
    write_shard(&shard("train.tfrecord-00001-of-00002"), &[episode(20, 1)]);
    write_shard(&shard("val.tfrecord-00000-of-00001"), &[episode(30, 4)]);
}

#[test]
fn parts_have_files_of_several_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine/1.0.0");
    fs::create_dir_all(&path).unwrap();
    write(&path);
    // The folder of the only version is found.
    for path in [path.clone(), folder.path().join("mine")] {
        let mut dataset = opened(&path, &OpenOptions::default()).unwrap();
        assert_eq!(lengths(dataset.as_ref()), [2, 3, 1]);
        let action = column_of(dataset.as_ref(), "action");
        assert_eq!(numbers(&rows(dataset.as_mut(), action, 1, 1, 2)), [12.0, 13.0, 14.0, 15.0]);
        assert_eq!(numbers(&rows(dataset.as_mut(), action, 2, 0, 1)), [20.0, 21.0]);
        let ends = column_of(dataset.as_ref(), "truncated");
        assert_eq!(
            numbers(&rows(dataset.as_mut(), ends, 1, 0, 3)),
            [0.0, 0.0, 1.0],
            "a cut is no end of the task"
        );
        let id = column_of(dataset.as_ref(), "id");
        assert_eq!(numbers(&rows(dataset.as_mut(), id, 1, 0, 3)), [10.0; 3]);
        let skipped = &dataset.info().skipped[0];
        assert!(skipped.0 == "cloud" && skipped.1.contains("not the same in all rows"), "{skipped:?}");
        assert!(dataset.info().notes.iter().any(|note| note.contains("part `train` of val, train")));
    }
    let val = OpenOptions::default().split(Some("val".to_owned()));
    assert_eq!(lengths(opened(&path, &val).unwrap().as_ref()), [4]);
    let none = OpenOptions::default().split(Some("test".to_owned()));
    let message = opened(&path, &none).err().unwrap().to_string();
    assert!(message.contains("there are val, train"), "{message}");
}

#[test]
fn what_was_changed_is_found_by_its_checksum() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let shard = folder.path().join("mine-train.tfrecord-00000-of-00002");
    let whole = fs::read(&shard).unwrap();
    let message = |bytes: &[u8]| {
        fs::write(&shard, bytes).unwrap();
        let mut dataset = match opened(folder.path(), &OpenOptions::default()) {
            Ok(dataset) => dataset,
            Err(error) => return error.to_string(),
        };
        let action = column_of(dataset.as_ref(), "action");
        let mut out = vec![0.0f32; 4];
        let steps = swm_data::Steps { first: 0, count: 2, stride: 1 };
        let read = dataset.rows(action, 0, steps, swm_core::SliceMut::F32(&mut out));
        read.map_or_else(|error| error.to_string(), |()| "sound".to_owned())
    };
    assert_eq!(message(&whole), "sound");
    // A value of the first record, which its length does not show.
    let mut changed = whole.clone();
    let at = whole.windows(12).position(|bytes| bytes == b"steps/action").unwrap() + 24;
    changed[at] ^= 1;
    assert!(message(&changed).contains("changed after it was written"), "{}", message(&changed));
    let mut length = whole.clone();
    length[0] ^= 1;
    assert!(message(&length).contains("length of the record at byte 0"), "{}", message(&length));
    assert!(message(&whole[..whole.len() - 3]).contains("cut short"));
    let first = whole.len() - (12 + 4 + episode(10, 3).len());
    assert!(message(&whole[..first]).contains("has 1 episodes, by `dataset_info.json` 2"));
    // A record that claims more than the file has, with a sound checksum.
    let huge = (1u64 << 40).to_le_bytes();
    let forged = [&huge[..], &masked(&huge), &whole[12..]].concat();
    assert!(message(&forged).contains("claims 1099511627776 bytes"), "{}", message(&forged));
}

#[test]
fn names_of_files_stay_in_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let info = fs::read_to_string(folder.path().join("dataset_info.json")).unwrap();
    fs::write(folder.path().join("dataset_info.json"), info.replace("{DATASET}-", "../{DATASET}-")).unwrap();
    let message = opened(folder.path(), &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("names the file `../mine"), "{message}");
    fs::write(folder.path().join("dataset_info.json"), info.replace("tfrecord\"", "riegeli\"")).unwrap();
    let message = opened(folder.path(), &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("riegeli"), "{message}");
    assert!(golden(SAMPLE).is_dir());
}
