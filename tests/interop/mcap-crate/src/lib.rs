//! What the crate `mcap`, at the version in Cargo.lock, does with recordings of this project: the reasons of
//! docs/design/0012-mcap-in-house.md as tests. If one of them fails at a newer version, the design has to be considered again.
//!
//! The folder that `SWM_MCAP_FILES` names has `whole.mcap`, a recording of three episodes, and `killed.mcap`, the same up to the middle of
//! the third.

#![cfg(test)]

use std::collections::BTreeMap;
use std::io::{Cursor, Seek as _, SeekFrom};
use std::path::PathBuf;
use std::{env, fs};

use mcap::records::{ChunkIndex, MessageHeader, MessageIndexEntry, Record, op};
use mcap::sans_io::{IndexedReadEvent, IndexedReader, IndexedReaderOptions};
use mcap::{McapError, MessageStream, Summary, WriteOptions, Writer};

/// The channel of the images.
const PIXELS: &str = "/pixels";
/// The record that commits an episode.
const EPISODE: &str = "swm.episode";
/// Opcode and length before the content of a record.
const HEAD: usize = 9;

fn file(name: &str) -> Vec<u8> {
    let folder = env::var_os("SWM_MCAP_FILES")
        .expect("`cargo xtask ci --only mcap` records the files, and sets SWM_MCAP_FILES");
    fs::read(PathBuf::from(folder).join(name)).unwrap()
}

fn summary(bytes: &[u8]) -> Summary {
    Summary::read(bytes).unwrap().expect("a finished file has a summary")
}

/// A message in the middle of a chunk: the chunk, the place in it, and where that is in the file.
fn image(bytes: &[u8], summary: &Summary) -> (ChunkIndex, MessageIndexEntry, usize) {
    let chunk = summary.chunk_indexes.first().unwrap().clone();
    let indexes = summary.read_message_indexes(bytes, &chunk).unwrap();
    let (_, images) = indexes.into_iter().find(|(channel, _)| channel.topic == PIXELS).unwrap();
    let entry = images[images.len() / 2].clone();
    let at = chunk.compressed_data_offset().unwrap() + entry.offset;
    (chunk, entry, at as usize)
}

/// The content of the record that begins at a place.
fn content(bytes: &[u8], at: usize) -> &[u8] {
    let length = u64::from_le_bytes(bytes[at + 1..at + HEAD].try_into().unwrap()) as usize;
    &bytes[at + HEAD..at + HEAD + length]
}

/// The end of the last episode that was committed, by a walk over the records: the crate has no name for it.
fn committed_end(bytes: &[u8]) -> usize {
    let (mut at, mut end) = (mcap::MAGIC.len(), 0);
    while at + HEAD <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + HEAD].try_into().unwrap()) as usize;
        let next = at + HEAD + length;
        if next > bytes.len() {
            break;
        }
        if let Ok(Record::Metadata(record)) = mcap::read::parse_record(bytes[at], content(bytes, at))
            && record.name == EPISODE
        {
            end = next;
        }
        at = next;
    }
    end
}

#[test]
fn the_version_is_the_one_of_the_design() {
    assert_eq!(mcap::VERSION, "0.26.0");
}

/// Random access needs the summary, which is written at the end.
#[test]
fn a_killed_file_has_no_random_access() {
    let whole = summary(&file("whole.mcap"));
    assert_eq!(whole.metadata_indexes.iter().filter(|index| index.name == EPISODE).count(), 3);
    let killed = file("killed.mcap");
    assert!(committed_end(&killed) > 0);
    assert!(matches!(Summary::read(&killed), Err(McapError::BadMagic)));
}

/// A writer begins a file wherever it is: behind two episodes, it leaves a file that is neither the old one nor the new one. What is left
/// for a killed file is to copy all of its messages into a new one.
#[test]
fn a_killed_file_cannot_be_continued() {
    let mut killed = file("killed.mcap");
    let end = committed_end(&killed);
    killed.truncate(end);
    let there = messages(&killed).iter().filter(|message| message.is_ok()).count();
    assert!(there >= 40, "two episodes: {there} messages");

    let mut place = Cursor::new(killed);
    place.seek(SeekFrom::End(0)).unwrap();
    let mut writer = Writer::with_options(place, WriteOptions::new().compression(None)).unwrap();
    let channel_id = writer.add_channel(0, "/later", "json", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 1 << 60, publish_time: 1 << 60 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    let written = writer.finish().unwrap();
    // The writer knows of what it wrote, and of nothing that was there.
    assert_eq!(written.stats.unwrap().message_count, 1);
    let continued = writer.into_inner().into_inner();

    // A reader by the index finds the one message; a reader from the front finds the two episodes, then an error.
    let found = summary(&continued);
    assert_eq!(found.stats.as_ref().unwrap().message_count, 1);
    assert!(found.chunk_indexes.iter().all(|chunk| chunk.chunk_start_offset > end as u64));
    assert!(found.metadata_indexes.is_empty());
    let read = messages(&continued);
    assert!(
        matches!(read.last(), Some(Err(McapError::UnexpectedEof))),
        "the second start of a file is no record"
    );
    let topics = read.iter().flatten();
    assert!(topics.clone().count() == there && topics.clone().all(|topic| topic != "/later"));
}

/// The topics of the messages in their order, up to the first error.
fn messages(bytes: &[u8]) -> Vec<Result<String, McapError>> {
    let mut found = Vec::new();
    for message in MessageStream::new(bytes).unwrap() {
        let is_error = message.is_err();
        found.push(message.map(|message| message.channel.topic.clone()));
        if is_error {
            break;
        }
    }
    found
}

/// A row by its position: the reader that has one asks for the whole chunk.
#[test]
fn one_message_reads_its_whole_chunk() {
    let bytes = file("whole.mcap");
    let summary = summary(&bytes);
    let (chunk, entry, at) = image(&bytes, &summary);
    assert!(chunk.compression.is_empty());
    let one = content(&bytes, at).len();
    let options = IndexedReaderOptions::new().include_topics([PIXELS]);
    let options = options.starting_at(entry.log_time).ending_at(entry.log_time);
    let mut reader = IndexedReader::new_with_options(&summary, options).unwrap();
    let (mut read, mut found) = (0, 0);
    loop {
        let (offset, length) = match reader.next_event() {
            None => break,
            Some(event) => match event.unwrap() {
                IndexedReadEvent::ReadChunkRequest { offset, length } => (offset as usize, length),
                IndexedReadEvent::Message { header, .. } => {
                    assert_eq!(header.log_time, entry.log_time);
                    found += 1;
                    continue;
                }
            },
        };
        read += length;
        reader.insert_chunk_record_data(offset as u64, &bytes[offset..offset + length]).unwrap();
    }
    assert_eq!((found, read as u64), (1, chunk.compressed_size));
    assert!(read > 20 * one, "{read} bytes are read for a message of {one}");
}

/// The other way to a message by its position walks over all messages before it, though nothing is compressed: where one of them has a
/// wrong length, it does not arrive. At its place in the file the message can be read; only the parser of single records remains of use.
#[test]
fn a_message_by_its_position_needs_those_before_it() {
    let mut bytes = file("whole.mcap");
    let summary = summary(&bytes);
    let (chunk, entry, at) = image(&bytes, &summary);
    let header = |bytes: &[u8]| match mcap::read::parse_record(op::MESSAGE, content(bytes, at)).unwrap() {
        Record::Message { header, .. } => (header.sequence, header.log_time),
        _ => panic!("a message"),
    };
    let found = summary.seek_message(&bytes, &chunk, &entry).unwrap();
    assert_eq!((found.sequence, found.log_time), header(&bytes));

    let first = chunk.compressed_data_offset().unwrap() as usize;
    bytes[first + 1] ^= 1;
    assert!(summary.seek_message(&bytes, &chunk, &entry).is_err());
    assert_eq!(header(&bytes), (found.sequence, found.log_time));
}

/// Chunks that others compressed are read by libraries in C; in-house they are read by `lz4_flex` and `ruzstd`.
#[test]
fn compressed_chunks_need_libraries_in_c() {
    let lock = include_str!("../Cargo.lock");
    for library in ["lz4-sys", "zstd-sys"] {
        assert!(lock.contains(&format!("name = \"{library}\"")), "{library}");
    }
}
