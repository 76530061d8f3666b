//! Chunks of messages: where they lie, and their bytes. Ours are not compressed, so that a message can be read where it
//! lies; other programs compress them with LZ4 (frames) or Zstandard, and then a chunk is read as a whole.

use std::io::{self, Read};

use swm_files::{ReadAt, read_exact_at};

use super::records::{HEAD, Reader};
use crate::error::{At as _, Result, invalid, unsupported};

/// Bytes of a chunk's head up to its messages, with the longest name of a compression.
const HEAD_BYTES: u64 = 64;
/// A compressed chunk above this size, in either form, is taken for damage: it must fit in memory.
const MAX_COMPRESSED: u64 = 256 << 20;

/// How the messages of a chunk are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lz4,
    Zstd,
}

impl Compression {
    /// As the format calls it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        }
    }
}

/// A chunk in the file.
#[derive(Clone, Debug)]
pub(super) struct Chunk {
    pub(super) at: u64,
    /// Bytes of its record, of its messages as they are stored, and of its messages.
    pub(super) length: u64,
    pub(super) stored: u64,
    pub(super) size: u64,
    pub(super) compression: Compression,
    /// Of its messages; 0 stands for "no checksum".
    pub(super) checksum: u32,
    pub(super) times: [u64; 2],
    /// For every channel in it, where its message index begins.
    pub(super) indexes: Vec<(u16, u64)>,
    /// Bytes of all its message indexes.
    pub(super) indexes_length: u64,
}

impl Chunk {
    /// Reads the head of a chunk record that begins at `at` and has `length` bytes of content.
    pub(super) fn read(file: &dyn ReadAt, at: u64, length: u64) -> Result<Self> {
        let mut bytes = vec![0; length.min(HEAD_BYTES) as usize];
        read_exact_at(file, &mut bytes, at + HEAD)?;
        let mut reader = Reader(&bytes);
        let times = [reader.u64()?, reader.u64()?];
        let (size, checksum, compression) = (reader.u64()?, reader.u32()?, reader.text()?);
        let known = [Compression::None, Compression::Lz4, Compression::Zstd];
        let Some(compression) = known.into_iter().find(|known| known.name() == compression) else {
            return Err(unsupported(format!(
                "its chunks are compressed by `{compression}`, which is unknown; use `mcap compress --compression none`"
            )));
        };
        let stored = reader.u64()?;
        let is_plain = compression == Compression::None;
        let fits = if is_plain { stored == size } else { stored.max(size) <= MAX_COMPRESSED };
        if !fits || stored != length - (bytes.len() - reader.0.len()) as u64 {
            return Err(invalid("a chunk has another size than it says"));
        }
        let indexes = Vec::new();
        Ok(Self {
            at,
            length: HEAD + length,
            stored,
            size,
            compression,
            checksum,
            times,
            indexes,
            indexes_length: 0,
        })
    }

    /// Where its messages begin: behind its own head.
    pub(super) fn messages_at(&self) -> u64 {
        self.at + self.length - self.stored
    }

    /// Reads its messages, as they were before they were compressed.
    pub(super) fn messages(&self, file: &dyn ReadAt, out: &mut Vec<u8>) -> Result<()> {
        out.resize(self.stored as usize, 0);
        read_exact_at(file, out, self.messages_at())?;
        let stored: &[u8] = out;
        let mut messages = Vec::new();
        // One byte more than there should be, so that more are noticed.
        let unpacked = match self.compression {
            Compression::None => return Ok(()),
            Compression::Lz4 => {
                lz4_flex::frame::FrameDecoder::new(stored).take(self.size + 1).read_to_end(&mut messages)
            }
            Compression::Zstd => ruzstd::decoding::StreamingDecoder::new(stored)
                .map_err(io::Error::other)
                .and_then(|decoder| decoder.take(self.size + 1).read_to_end(&mut messages)),
        };
        if unpacked.at("a chunk cannot be unpacked")? as u64 != self.size {
            return Err(invalid("a chunk has another size than it says"));
        }
        *out = messages;
        Ok(())
    }
}

/// Messages of chunks, read one by one; holds the last chunk that had to be unpacked.
#[derive(Debug, Default)]
pub(super) struct Messages {
    unpacked: Option<usize>,
    bytes: Vec<u8>,
    record: Vec<u8>,
}

impl Messages {
    /// The record that begins at the byte `at` of the file, which has `length` bytes.
    pub(super) fn outside(&mut self, file: &dyn ReadAt, length: u64, at: u64) -> Result<(u8, &[u8])> {
        let mut head = [0; HEAD as usize];
        read_exact_at(file, &mut head, at)?;
        let size = Reader(&head[1..]).u64()?;
        if size > length.saturating_sub(at + HEAD) {
            return Err(invalid("a message reaches behind the file"));
        }
        self.record.resize(size as usize, 0);
        read_exact_at(file, &mut self.record, at + HEAD)?;
        Ok((head[0], &self.record))
    }

    /// The record (opcode, length, content) that begins at the byte `offset` of a chunk's messages.
    pub(super) fn record(
        &mut self,
        file: &dyn ReadAt,
        chunks: &[Chunk],
        (index, offset): (usize, u64),
    ) -> Result<(u8, &[u8])> {
        let chunk = chunks.get(index).ok_or(invalid("a message lies in no chunk"))?;
        let left =
            chunk.size.checked_sub(offset + HEAD).ok_or(invalid("a message reaches behind its chunk"))?;
        let length = |head: &[u8]| match Reader(&head[1..]).u64()? {
            length if length <= left => Ok(length as usize),
            _ => Err(invalid("a message reaches behind its chunk")),
        };
        if chunk.compression == Compression::None {
            let (mut head, at) = ([0; HEAD as usize], chunk.messages_at() + offset);
            read_exact_at(file, &mut head, at)?;
            self.record.resize(length(&head)?, 0);
            read_exact_at(file, &mut self.record, at + HEAD)?;
            return Ok((head[0], &self.record));
        }
        if self.unpacked != Some(index) {
            self.unpacked = None;
            chunk.messages(file, &mut self.bytes)?;
            self.unpacked = Some(index);
        }
        let (head, rest) = self.bytes[offset as usize..].split_at(HEAD as usize);
        Ok((head[0], &rest[..length(head)?]))
    }
}
