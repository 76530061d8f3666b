//! The records of an MCAP file, as bytes: an opcode, a length, content. Chunks are not compressed, so that a message can
//! be read where it lies.
//!
//! Source of the format: the MCAP specification, <https://mcap.dev/spec>.

use crate::error::{Result, invalid};
use std::collections::BTreeMap;

/// The first and the last bytes of a file.
pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Opcode and length before the content of a record.
pub(super) const HEAD: u64 = 9;
/// What stands before the data of a message: channel, sequence, two times.
pub(super) const MESSAGE_HEAD: usize = 22;

pub(super) const HEADER: u8 = 0x01;
pub(super) const FOOTER: u8 = 0x02;
pub(super) const SCHEMA: u8 = 0x03;
pub(super) const CHANNEL: u8 = 0x04;
pub(super) const MESSAGE: u8 = 0x05;
pub(super) const CHUNK: u8 = 0x06;
pub(super) const MESSAGE_INDEX: u8 = 0x07;
pub(super) const CHUNK_INDEX: u8 = 0x08;
pub(super) const STATISTICS: u8 = 0x0B;
pub(super) const METADATA: u8 = 0x0C;
pub(super) const METADATA_INDEX: u8 = 0x0D;
pub(super) const DATA_END: u8 = 0x0F;

/// Writes content in the encoding of the format: little-endian numbers, texts and lists behind their length in bytes.
#[derive(Clone, Debug, Default)]
pub(super) struct Content(pub(super) Vec<u8>);

impl Content {
    pub(super) fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn text(self, text: &str) -> Self {
        self.list(text.as_bytes())
    }

    /// Bytes behind their number in 32 bits.
    pub(super) fn list(self, bytes: &[u8]) -> Self {
        self.u32(bytes.len() as u32).raw(bytes)
    }

    pub(super) fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    pub(super) fn map(self, entries: &[(&str, String)]) -> Self {
        let inner = entries.iter().fold(Self::default(), |inner, (key, value)| inner.text(key).text(value));
        self.list(&inner.0)
    }

    /// The whole record.
    pub(super) fn record(self, opcode: u8) -> Vec<u8> {
        let mut bytes = vec![opcode];
        bytes.extend((self.0.len() as u64).to_le_bytes());
        bytes.extend(self.0);
        bytes
    }
}

/// Reads content in the encoding of the format.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl<'a> Reader<'a> {
    pub(super) fn raw(&mut self, count: usize) -> Result<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count).ok_or(invalid("a record is cut short"))?;
        self.0 = rest;
        Ok(bytes)
    }

    fn number(&mut self, width: usize) -> Result<u64> {
        Ok(self.raw(width)?.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte)))
    }

    pub(super) fn u16(&mut self) -> Result<u16> {
        Ok(self.number(2)? as u16)
    }

    pub(super) fn u32(&mut self) -> Result<u32> {
        Ok(self.number(4)? as u32)
    }

    pub(super) fn u64(&mut self) -> Result<u64> {
        self.number(8)
    }

    pub(super) fn text(&mut self) -> Result<&'a str> {
        let length = self.u32()? as usize;
        std::str::from_utf8(self.raw(length)?).map_err(|_| invalid("a text is not valid UTF-8"))
    }

    pub(super) fn map(&mut self) -> Result<BTreeMap<&'a str, &'a str>> {
        let length = self.u32()? as usize;
        let mut inner = Self(self.raw(length)?);
        let mut entries = BTreeMap::new();
        while !inner.0.is_empty() {
            let key = inner.text()?;
            entries.insert(key, inner.text()?);
        }
        Ok(entries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_comes_back() {
        let bytes =
            Content::default().u16(7).u64(1 << 40).text("é").map(&[("a", "1".into()), ("b", "2".into())]).0;
        let mut reader = Reader(&bytes);
        assert_eq!((reader.u16().unwrap(), reader.u64().unwrap()), (7, 1 << 40));
        assert_eq!(reader.text().unwrap(), "é");
        assert_eq!(reader.map().unwrap(), BTreeMap::from([("a", "1"), ("b", "2")]));
        assert!(reader.u16().is_err());
        for cut in 0..bytes.len() {
            let mut reader = Reader(&bytes[..cut]);
            let read = reader
                .u16()
                .and_then(|_| reader.u64())
                .and_then(|_| reader.text())
                .and_then(|_| reader.map());
            assert!(read.is_err(), "{cut}");
        }
    }
}
