//! Damaged MCAP files: damage is not taken for the end of a killed recording, and nothing is cut for it.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::{Dtype, Field, Schema};
use swm_data::format::{built_in, by_name};
use swm_data::{WriteMode, create, open};

use crate::support::{contents, episode, metadata, mutations, record};

const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0F;

/// Opcode, position and length of content of every record.
fn records(bytes: &[u8]) -> Vec<(u8, usize, usize)> {
    let (mut found, mut at) = (Vec::new(), 8);
    while at + 9 <= bytes.len() - 8 {
        let size = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        found.push((bytes[at], at, size));
        at += 9 + size;
    }
    found
}

fn position(bytes: &[u8], opcode: u8, number: usize) -> usize {
    records(bytes).into_iter().filter(|record| record.0 == opcode).nth(number).unwrap().1
}

/// Three episodes, with a chunk each.
fn recorded(folder: &Path) -> (PathBuf, Vec<u8>) {
    let path = folder.join("data.mcap");
    record(&path, WriteMode::Error, 0..3).unwrap();
    let bytes = fs::read(&path).unwrap();
    (path, bytes)
}

fn repair(path: &Path, apply: bool) -> Result<Vec<String>, swm_data::DataError> {
    by_name(built_in(), "mcap").unwrap().repair(path, apply)
}

/// Reading, continuing and repairing are refused for this reason, and change nothing.
fn assert_left_alone(path: &Path, bytes: &[u8], reason: &str) {
    fs::write(path, bytes).unwrap();
    let refused = [
        open(path).err().unwrap().to_string(),
        record(path, WriteMode::Append, 3..4).unwrap_err().to_string(),
        repair(path, true).unwrap_err().to_string(),
    ];
    for message in refused {
        assert!(message.contains("damaged") && message.contains(reason), "{message}");
    }
    assert!(fs::read(path).unwrap() == bytes);
}

#[test]
fn a_flipped_length_of_a_chunk_is_damage_and_not_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let (path, good) = recorded(folder.path());
    let chunk = position(&good, CHUNK, 1);
    // The lowest bit leads into the middle of the messages, a high one behind the end of the file.
    for (byte, bit) in [(1, 1), (2, 0x40), (5, 1), (8, 0x80)] {
        let mut bytes = good.clone();
        bytes[chunk + byte] ^= bit;
        fs::write(&path, &bytes).unwrap();
        assert!(open(&path).is_err(), "byte {byte}");
    }
    let mut bytes = good.clone();
    bytes[chunk + 5] ^= 1;
    assert_left_alone(&path, &bytes, "it was finished");
    // Its recording was killed behind the third episode: the commits behind the damage tell.
    bytes.truncate(position(&good, DATA_END, 0));
    assert_left_alone(&path, &bytes, "episode 1 was committed");
    // Without the damage, the same file is that of a killed recording.
    fs::write(&path, &good[..bytes.len()]).unwrap();
    assert_eq!(contents(&path).len(), 3);
    assert_eq!(repair(&path, true).unwrap().len(), 1);
    assert!(fs::read(&path).unwrap() == good, "a repaired file is the finished one");
}

#[test]
fn a_commit_that_is_gone_is_missed() {
    let folder = tempfile::tempdir().unwrap();
    let (path, good) = recorded(folder.path());
    let last = records(&good).into_iter().rfind(|record| record.0 == 0x0C).unwrap();
    let mut bytes = good.clone();
    // The last commit becomes a record of another kind, which a reader passes over.
    bytes[last.1] ^= 0x40;
    assert_left_alone(&path, &bytes, "its summary counts");
}

#[test]
fn any_flipped_byte_of_a_finished_file_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.mcap");
    mutations::seed(&path);
    let good = fs::read(&path).unwrap();
    for at in 0..good.len() {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        fs::write(&path, &bytes).unwrap();
        let sound = mutations::play(&path) && repair(&path, false).is_ok_and(|steps| steps.is_empty());
        assert!(!sound, "byte {at} of {}", good.len());
    }
}

#[test]
fn checksums_cover_all_episodes_after_an_append() {
    let folder = tempfile::tempdir().unwrap();
    let [parts, whole] = ["parts.mcap", "whole.mcap"].map(|name| folder.path().join(name));
    let schema = Schema::new(vec![Field::step("state", Dtype::F64, &[3])]).unwrap();
    let write = |path: &Path, episodes: std::ops::Range<usize>| {
        let mut writer = create(path, WriteMode::Append, None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        for index in episodes {
            writer.write_episode(&episode(&schema, index, 5)).unwrap();
        }
        writer.finish().unwrap();
    };
    write(&whole, 0..5);
    // The second of them continues a recording that was cut behind its last episode.
    for (episodes, cut) in [(0..2, true), (2..3, false), (3..5, false)] {
        write(&parts, episodes);
        if cut {
            let bytes = fs::read(&parts).unwrap();
            fs::write(&parts, &bytes[..position(&bytes, DATA_END, 0)]).unwrap();
        }
    }
    assert!(fs::read(&parts).unwrap() == fs::read(&whole).unwrap());
    open(&parts).unwrap().check_whole().unwrap();
}
