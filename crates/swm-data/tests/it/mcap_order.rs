//! MCAP files that another program rewrote: their records have another order, and they are read all the same.

use std::fs;
use std::path::{Path, PathBuf};

use swm_data::format::{built_in, by_name};
use swm_data::testing::mutations::mutate;
use swm_data::tools::verify::verify;
use swm_data::{WriteMode, open};

use crate::support::{assert_same, contents, record};

const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const METADATA: u8 = 0x0C;
const DATA_END: u8 = 0x0F;

/// Opcode and content of the records of some bytes.
fn records(mut bytes: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let mut found = Vec::new();
    while bytes.len() >= 9 {
        let size = u64::from_le_bytes(bytes[1..9].try_into().unwrap()) as usize;
        found.push((bytes[0], bytes[9..9 + size].to_vec()));
        bytes = &bytes[9 + size..];
    }
    found
}

fn push(out: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    out.push(opcode);
    out.extend((content.len() as u64).to_le_bytes());
    out.extend(content);
}

/// How messages are stored.
#[derive(Clone, Copy, Debug)]
enum Stored {
    /// In no chunk.
    Alone,
    /// In chunks of so many messages without an index, which describe their channels.
    Chunks(usize, &'static str),
}

/// The same content as packages for MCAP write it that copy metadata first: other numbers of channels, no summary.
fn rewritten(bytes: &[u8], stored: Stored, is_reversed: bool) -> Vec<u8> {
    let all = records(&bytes[8..bytes.len() - 8]);
    let until = all.iter().position(|(opcode, _)| *opcode == DATA_END).unwrap();
    let all = &all[..until];
    let of = |kind: u8| all.iter().filter(move |(opcode, _)| *opcode == kind).map(|(_, content)| content);
    let renumbered = |content: &[u8]| {
        let id = u16::from_le_bytes([content[0], content[1]]) + 40;
        [&id.to_le_bytes(), &content[2..]].concat()
    };
    let mut out = b"\x89MCAP0\r\n".to_vec();
    of(HEADER).for_each(|content| push(&mut out, HEADER, content));
    let mut metadata: Vec<_> = of(METADATA).collect();
    if is_reversed {
        metadata.reverse();
    }
    metadata.iter().for_each(|content| push(&mut out, METADATA, content));
    let mut described = Vec::new();
    of(SCHEMA).for_each(|content| push(&mut described, SCHEMA, content));
    of(CHANNEL).for_each(|content| push(&mut described, CHANNEL, &renumbered(content)));
    // Behind times, size, checksum, the empty name of no compression, and the size again.
    let chunks = of(CHUNK).flat_map(|content| records(&content[8 + 8 + 8 + 4 + 4 + 8..]));
    let mut messages: Vec<Vec<u8>> = chunks.map(|(_, content)| renumbered(&content)).collect();
    if is_reversed {
        messages.reverse();
    }
    match stored {
        Stored::Alone => {
            out.extend(&described);
            messages.iter().for_each(|message| push(&mut out, MESSAGE, message));
        }
        Stored::Chunks(count, compression) => {
            for part in messages.chunks(count) {
                let mut inner = described.clone();
                part.iter().for_each(|message| push(&mut inner, MESSAGE, message));
                let packed = match compression {
                    "lz4" => {
                        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                        std::io::Write::write_all(&mut encoder, &inner).unwrap();
                        encoder.finish().unwrap()
                    }
                    "zstd" => ruzstd::encoding::compress_to_vec(
                        &inner[..],
                        ruzstd::encoding::CompressionLevel::Fastest,
                    ),
                    _ => inner.clone(),
                };
                let mut content = [0u8; 16].to_vec();
                content.extend((inner.len() as u64).to_le_bytes());
                content.extend(crc32fast::hash(&inner).to_le_bytes());
                content.extend((compression.len() as u32).to_le_bytes());
                content.extend(compression.as_bytes());
                content.extend((packed.len() as u64).to_le_bytes());
                content.extend(packed);
                push(&mut out, CHUNK, &content);
            }
        }
    }
    push(&mut out, DATA_END, &[0; 4]);
    push(&mut out, FOOTER, &[0; 20]);
    out.extend(b"\x89MCAP0\r\n");
    out
}

const WAYS: [(Stored, bool); 6] = [
    (Stored::Alone, false),
    (Stored::Alone, true),
    (Stored::Chunks(7, ""), false),
    (Stored::Chunks(1, "lz4"), true),
    (Stored::Chunks(400, "lz4"), false),
    (Stored::Chunks(13, "zstd"), true),
];

fn recorded(folder: &Path) -> (PathBuf, Vec<u8>) {
    let path = folder.join("data.mcap");
    record(&path, WriteMode::Error, 0..4).unwrap();
    let bytes = fs::read(&path).unwrap();
    (path, bytes)
}

#[test]
fn the_order_of_records_does_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let (path, good) = recorded(folder.path());
    let expected = contents(&path);
    let problems = |path: &Path| verify(open(path).unwrap().as_mut(), &mut |_| {}).problems;
    let of_values = problems(&path);
    for (stored, is_reversed) in WAYS {
        fs::write(&path, rewritten(&good, stored, is_reversed)).unwrap();
        let found = contents(&path);
        assert_eq!(found.len(), expected.len(), "{stored:?}");
        expected.iter().zip(&found).for_each(|(expected, found)| assert_same(expected, found));
        let dataset = open(&path).unwrap();
        assert_eq!(dataset.metadata().map(|run| &run.env[..]), Some("swm/Test-v1"));
        assert_eq!(problems(&path), of_values, "{stored:?}");
    }
}

#[test]
fn a_file_in_another_order_is_copied_and_not_continued() {
    let folder = tempfile::tempdir().unwrap();
    let (path, good) = recorded(folder.path());
    for (stored, is_reversed) in WAYS {
        let bytes = rewritten(&good, stored, is_reversed);
        fs::write(&path, &bytes).unwrap();
        let message = record(&path, WriteMode::Append, 4..5).unwrap_err().to_string();
        assert!(message.contains("records in another order") && message.contains("swm convert"), "{message}");
        assert_eq!(by_name(built_in(), "mcap").unwrap().repair(&path, true).unwrap(), [] as [&str; 0]);
        assert!(fs::read(&path).unwrap() == bytes, "{stored:?}");
        // Cut off, as by a kill of the other program: nothing of it is cut by a repair.
        fs::write(&path, &bytes[..bytes.len() - 40]).unwrap();
        drop(by_name(built_in(), "mcap").unwrap().repair(&path, true).unwrap_err());
        assert!(fs::read(&path).unwrap() == bytes[..bytes.len() - 40], "{stored:?}");
    }
}

#[test]
fn a_message_that_is_missing_or_twice_there_is_damage() {
    let folder = tempfile::tempdir().unwrap();
    let (path, good) = recorded(folder.path());
    let bytes = rewritten(&good, Stored::Alone, false);
    let all = records(&bytes[8..bytes.len() - 8]);
    let written = |all: &[(u8, Vec<u8>)]| {
        let mut out = bytes[..8].to_vec();
        all.iter().for_each(|(opcode, content)| push(&mut out, *opcode, content));
        [out, bytes[..8].to_vec()].concat()
    };
    // The last one is of the numbers.
    let last = all.iter().rposition(|(opcode, _)| *opcode == MESSAGE).unwrap();
    let mut twice = all.clone();
    twice.insert(last, all[last].clone());
    let mut missing = all.clone();
    missing.remove(last);
    for changed in [twice, missing] {
        fs::write(&path, written(&changed)).unwrap();
        let message = open(&path).err().unwrap().to_string();
        assert!(message.contains("is damaged: episode 3 should have 17 messages on `/step`"), "{message}");
    }
    // Rows of another episode.
    let mut other = all.clone();
    let text = String::from_utf8_lossy(&all[last].1[22..]).replace("\"ep_idx\":3", "\"ep_idx\":2");
    other[last].1.truncate(22);
    other[last].1.extend(text.as_bytes());
    fs::write(&path, written(&other)).unwrap();
    let problems = verify(open(&path).unwrap().as_mut(), &mut |_| {}).problems;
    let told = |reason: &str| reason.contains("row 16 is of episode 2 by its `ep_idx`");
    assert!(
        problems.iter().any(|problem| problem.episode == Some(3) && told(&problem.reason)),
        "{problems:?}"
    );
}

#[test]
fn no_mutation_makes_it_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.mcap");
    swm_data::testing::mutations::seed(&path);
    let good = fs::read(&path).unwrap();
    for (stored, is_reversed) in WAYS {
        fs::write(&path, rewritten(&good, stored, is_reversed)).unwrap();
        mutate(&format!("{stored:?}"), &path);
    }
}
