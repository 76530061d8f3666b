//! Event files that TensorBoard reads, written by hand: records of TensorFlow's TFRecord format that hold the two
//! protocol-buffer messages `Event` and `Summary`, as far as scalars need them. Not a general encoder of either.
//!
//! Sources: `tensorflow/core/lib/io/record_writer.h` (framing, masked checksum), `tensorflow/core/util/event.proto`,
//! `tensorflow/core/framework/summary.proto` (field numbers); CRC-32C: RFC 3720, appendix B.4.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Writes one event file.
pub struct EventWriter {
    out: BufWriter<File>,
    path: PathBuf,
}

impl EventWriter {
    /// A new event file in `folder`, whose name no other has. `resumed`: the step that training goes on after; points
    /// that earlier files hold for later steps are then taken back, so that curves do not go two ways.
    ///
    /// # Errors
    ///
    /// A file of the folder cannot be read or written.
    pub fn create(folder: &Path, resumed: Option<u64>) -> io::Result<Self> {
        let now = now();
        let (seconds, process) = (now.floor(), std::process::id());
        let path = (0..)
            .map(|number: u32| folder.join(format!("events.out.tfevents.{seconds}.{process}.{number}")))
            .find(|path| !path.exists())
            .expect("a folder holds fewer files than there are numbers");
        let mut writer = Self { out: BufWriter::new(File::create_new(&path)?), path };
        let mut event = Message::default();
        event.double(EVENT_WALL_TIME, now);
        event.bytes(EVENT_FILE_VERSION, b"brain.Event:2");
        writer.record(&event.0)?;
        if let Some(step) = resumed {
            let mut session = Message::default();
            session.integer(SESSION_STATUS, SESSION_START);
            let mut event = Message::default();
            event.double(EVENT_WALL_TIME, now);
            // TensorBoard drops what it knows from this step on.
            event.integer(EVENT_STEP, step + 1);
            event.bytes(EVENT_SESSION, &session.0);
            writer.record(&event.0)?;
        }
        writer.flush()?;
        Ok(writer)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a point to each of some curves.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn scalars<'a>(
        &mut self,
        step: u64,
        values: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> io::Result<()> {
        let mut summary = Message::default();
        for (tag, value) in values {
            let mut point = Message::default();
            point.bytes(VALUE_TAG, tag.as_bytes());
            point.float(VALUE_SIMPLE, value as f32);
            summary.bytes(SUMMARY_VALUE, &point.0);
        }
        let mut event = Message::default();
        event.double(EVENT_WALL_TIME, now());
        event.integer(EVENT_STEP, step);
        event.bytes(EVENT_SUMMARY, &summary.0);
        self.record(&event.0)
    }

    /// Hands everything to the operating system.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// A record: length, its checksum, content, its checksum.
    fn record(&mut self, content: &[u8]) -> io::Result<()> {
        let length = (content.len() as u64).to_le_bytes();
        self.out.write_all(&length)?;
        self.out.write_all(&masked(crc32c(&length)).to_le_bytes())?;
        self.out.write_all(content)?;
        self.out.write_all(&masked(crc32c(content)).to_le_bytes())
    }
}

const EVENT_WALL_TIME: u32 = 1;
const EVENT_STEP: u32 = 2;
const EVENT_FILE_VERSION: u32 = 3;
const EVENT_SUMMARY: u32 = 5;
const EVENT_SESSION: u32 = 7;
const SESSION_STATUS: u32 = 1;
const SESSION_START: u64 = 1;
const SUMMARY_VALUE: u32 = 1;
const VALUE_TAG: u32 = 1;
const VALUE_SIMPLE: u32 = 2;

/// Seconds since 1970: TensorBoard orders events by them. No result holds it.
#[expect(clippy::disallowed_methods, reason = "the format of these logs asks for the time")]
fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// A protocol-buffer message under construction.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn key(&mut self, field: u32, wire_type: u64) {
        self.varint(u64::from(field) << 3 | wire_type);
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn integer(&mut self, field: u32, value: u64) {
        self.key(field, 0);
        self.varint(value);
    }

    fn double(&mut self, field: u32, value: f64) {
        self.key(field, 1);
        self.0.extend(value.to_le_bytes());
    }

    fn float(&mut self, field: u32, value: f32) {
        self.key(field, 5);
        self.0.extend(value.to_le_bytes());
    }

    fn bytes(&mut self, field: u32, value: &[u8]) {
        self.key(field, 2);
        self.varint(value.len() as u64);
        self.0.extend(value);
    }
}

/// TFRecord's mask: checksums of data that holds checksums are poor.
fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C (Castagnoli), bytewise.
fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, &byte| (crc >> 8) ^ TABLE[usize::from(crc as u8 ^ byte)])
}

const TABLE: [u32; 256] = {
    const REVERSED_POLYNOMIAL: u32 = 0x82f6_3b78;
    let mut table = [0; 256];
    let mut index = 0;
    while index < 256 {
        let mut crc = index as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ REVERSED_POLYNOMIAL } else { crc >> 1 };
            bit += 1;
        }
        table[index] = crc;
        index += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_rfc() {
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
    }

    /// The content of every record of a file, checksums compared.
    fn records(mut bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut records = Vec::new();
        while !bytes.is_empty() {
            let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
            let check = |content: &[u8], at: usize| {
                let stored = u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
                assert_eq!(stored, masked(crc32c(content)));
            };
            check(&bytes[..8], 8);
            let content = &bytes[12..12 + length];
            check(content, 12 + length);
            records.push(content.to_vec());
            bytes = &bytes[16 + length..];
        }
        records
    }

    #[test]
    fn files_hold_the_version_then_points() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = EventWriter::create(folder.path(), Some(299)).unwrap();
        writer.scalars(300, [("loss", 0.5), ("lr", 1e-3)]).unwrap();
        writer.flush().unwrap();
        let other = EventWriter::create(folder.path(), None).unwrap();
        assert_ne!(writer.path(), other.path());

        let records = records(&std::fs::read(writer.path()).unwrap());
        assert_eq!(records.len(), 3);
        // Field 1 as a double takes 9 bytes; field 3 follows: 13 characters.
        assert_eq!(records[0][9..11], [3 << 3 | 2, 13]);
        assert_eq!(&records[0][11..], b"brain.Event:2");
        // Field 2 is the step as a varint, 300 = 0b10_0101100; field 7 the session's start.
        assert_eq!(records[1][9..], [2 << 3, 0xac, 0x02, 7 << 3 | 2, 2, 1 << 3, 1]);
        let first = [&[1 << 3 | 2, 4][..], b"loss", &[2 << 3 | 5], &0.5_f32.to_le_bytes()].concat();
        assert_eq!(records[2][9..16], [2 << 3, 0xac, 0x02, 5 << 3 | 2, 24, 1 << 3 | 2, 11]);
        assert_eq!(records[2][16..27], first);
    }
}
