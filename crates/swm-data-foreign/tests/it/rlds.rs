//! Datasets of RLDS: the sample that TensorFlow Datasets wrote, and small ones with faults.

use std::fs;
use std::path::Path;

use serde_json::json;
use swm_core::Column;
use swm_data::OpenOptions;

use crate::copied;
use crate::partial::assert_partial;
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
    // Of several, one has to be named.
    copied(&path, &folder.path().join("mine/2.0.0"));
    let message = opened(&folder.path().join("mine"), &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("several versions, 1.0.0, 2.0.0; open the folder of one"), "{message}");
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

/// An entry of a record: its key, the number of the kind of its list, and the list.
fn entry(key: &str, kind: u8, list: &[u8]) -> Vec<u8> {
    part(1, &[part(1, key.as_bytes()), part(2, &part(kind, list))].concat())
}

fn floats_of(values: &[f32]) -> Vec<u8> {
    part(1, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>())
}

fn texts_of(texts: &[&[u8]]) -> Vec<u8> {
    texts.iter().flat_map(|text| part(1, text)).collect()
}

/// Writes a dataset of one part: the features of its steps beside `action`, and what the steps of each episode have beside it. An episode has
/// two steps.
fn write_steps(folder: &Path, more: &serde_json::Value, episodes: &[Vec<u8>]) {
    let mut steps = json!({"action": {"tensor": {"dtype": "float32", "encoding": "none", "shape": {}}}});
    steps.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let steps = json!({"sequence": {"feature": {"featuresDict": {"features": steps}}}});
    let features = json!({"featuresDict": {"features": {"steps": steps}}});
    let info =
        json!({"name": "mine", "splits": [{"name": "train", "shardLengths": [episodes.len().to_string()]}]});
    fs::write(folder.join("features.json"), features.to_string()).unwrap();
    fs::write(folder.join("dataset_info.json"), info.to_string()).unwrap();
    let actions = entry("steps/action", 2, &floats_of(&[1.0, 2.0]));
    let records: Vec<Vec<u8>> = episodes.iter().map(|more| part(1, &[&actions[..], more].concat())).collect();
    write_shard(&folder.join("mine-train.tfrecord-00000-of-00001"), &records);
}

#[test]
fn a_record_may_lack_a_feature() {
    let folder = tempfile::tempdir().unwrap();
    let number = json!({"tensor": {"dtype": "float32", "encoding": "none", "shape": {}}});
    let more = json!({"first": number, "later": number});
    let extra = |key: &str| entry(key, 2, &floats_of(&[3.0, 4.0]));
    write_steps(folder.path(), &more, &[extra("steps/first"), extra("steps/later")]);
    assert_partial(folder.path(), "first", "steps/first", 1, "NaN");
    assert_partial(folder.path(), "later", "steps/later", 0, "NaN");
}

#[test]
fn bytes_that_are_no_text_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let text = json!({"tensor": {"dtype": "string", "encoding": "none", "shape": {}}});
    let more = json!({"blob": text, "word": text, "late": text});
    let of = |late: &[u8]| {
        let word = entry("steps/word", 1, &texts_of(&["ä".as_bytes(), b""]));
        let late = entry("steps/late", 1, &texts_of(&[b"a", late]));
        [entry("steps/blob", 1, &texts_of(&[b"\xff\x00", b"\xfe"])), word, late].concat()
    };
    let episodes: Vec<Vec<u8>> =
        (0..40).map(|episode| of(if episode == 39 { b"\xff" } else { b"b" })).collect();
    write_steps(folder.path(), &more, &episodes);
    let mut dataset = opened(folder.path(), &OpenOptions::default()).unwrap();
    let skipped =
        dataset.info().skipped.iter().map(|(name, reason)| format!("{name}: {reason}")).collect::<String>();
    assert!(skipped.starts_with("blob") && skipped.contains("are bytes and no text"), "{skipped}");
    let word = column_of(dataset.as_ref(), "word");
    assert_eq!(rows(dataset.as_mut(), word, 3, 0, 1), Column::Str(vec!["ä".to_owned()]));
    // Far behind, it is no damage, either.
    let late = column_of(dataset.as_ref(), "late");
    let steps = swm_data::Steps { first: 0, count: 2, stride: 1 };
    let mut out = vec![String::new(); 2];
    let error = dataset.rows(late, 39, steps, swm_core::SliceMut::Str(&mut out)).unwrap_err().to_string();
    assert!(error.contains("bytes and no text") && !error.contains("damaged"), "{error}");
}

/// A PNG file of one color: `kind` is 0 (gray), 2 (RGB), 4 (gray and alpha) or 6 (RGBA).
fn png(kind: u8, pixel: &[u8]) -> Vec<u8> {
    let side = 16_u32;
    let crc = |bytes: &[u8]| {
        let step = |sum: u32, _| if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 };
        !bytes.iter().fold(!0, |sum, &byte| (0..8).fold(sum ^ u32::from(byte), step))
    };
    let chunk = |name: &[u8], bytes: &[u8]| {
        let all = [name, bytes].concat();
        [&(bytes.len() as u32).to_be_bytes()[..], &all, &crc(&all).to_be_bytes()].concat()
    };
    let line = [vec![0], pixel.repeat(side as usize)].concat();
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut packed, &line.repeat(side as usize)).unwrap();
    let head = [&side.to_be_bytes()[..], &side.to_be_bytes(), &[8, kind, 0, 0, 0]].concat();
    let body = chunk(b"IDAT", &packed.finish().unwrap());
    [b"\x89PNG\r\n\x1a\n".to_vec(), chunk(b"IHDR", &head), body, chunk(b"IEND", &[])].concat()
}

#[test]
fn images_of_other_channels_are_read_as_tensorflow_does() {
    let folder = tempfile::tempdir().unwrap();
    let image = json!({"image": {"shape": {"dimensions": ["16", "16", "3"]}, "dtype": "uint8", "encodingFormat": "png"}});
    let images = [png(0, &[7]), png(6, &[1, 2, 3, 9]), png(4, &[5, 9]), png(2, &[1, 2, 3])];
    let of = |two: &[Vec<u8>]| entry("steps/image", 1, &texts_of(&[&two[0], &two[1]]));
    write_steps(folder.path(), &json!({"image": image}), &[of(&images[..2]), of(&images[2..])]);
    let mut dataset = opened(folder.path(), &OpenOptions::default()).unwrap();
    let pixels = column_of(dataset.as_ref(), "pixels");
    for (at, expected) in [[7; 3], [1, 2, 3], [5; 3], [1, 2, 3]].into_iter().enumerate() {
        let read = rows(dataset.as_mut(), pixels, at / 2, at % 2, 1);
        assert_eq!(read, Column::U8(expected.repeat(256)), "image {at}");
    }
}

#[test]
fn an_image_of_another_size_is_not_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let image = json!({"image": {"shape": {"dimensions": ["-1", "-1", "3"]}, "dtype": "uint8", "encodingFormat": "png"}});
    let of = |side: usize| swm_media::png::encode(16, side, &vec![7; 16 * side * 3]).unwrap();
    let two = |first: usize, second: usize| entry("steps/image", 1, &texts_of(&[&of(first), &of(second)]));
    write_steps(folder.path(), &json!({"image": image}), &[two(16, 16), two(16, 24)]);
    let mut dataset = opened(folder.path(), &OpenOptions::default()).unwrap();
    let pixels = column_of(dataset.as_ref(), "pixels");
    let steps = swm_data::Steps { first: 0, count: 2, stride: 1 };
    let mut out = vec![0; 2 * 16 * 16 * 3];
    let error = dataset.rows(pixels, 1, steps, swm_core::SliceMut::U8(&mut out)).unwrap_err().to_string();
    for part in ["episode 1", "row 1", "16 × 24 pixels", "16 × 16", "make all of one size"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    assert!(!error.contains("damaged"), "{error}");
}
