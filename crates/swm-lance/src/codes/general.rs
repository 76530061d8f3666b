//! LZ4 and Zstandard, each after its decoded size.

use std::io::Read as _;

use crate::error::{Result, damaged, unsupported};

/// No part of a table is decoded to more than this.
const MAX_BYTES: usize = 1 << 28;
/// LZ4 makes no more of a byte, and so many of nothing.
const LZ4_RATIO: usize = 255;
const SLACK: usize = 64;
/// How a frame of Zstandard begins.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// How bytes are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scheme {
    Lz4,
    Zstd,
}

impl Scheme {
    /// By its number, as files since 2.1 have it.
    pub(super) fn numbered(number: u64) -> Result<Self> {
        match number {
            1 => Ok(Self::Lz4),
            2 => Ok(Self::Zstd),
            other => Err(unsupported(format!("a compression with the number {other} is not known"))),
        }
    }

    /// By its name, as files of 2.0 have it; `None` for none.
    pub(crate) fn named(name: &str) -> Result<Option<Self>> {
        match name {
            "none" => Ok(None),
            "lz4" => Ok(Some(Self::Lz4)),
            "zstd" => Ok(Some(Self::Zstd)),
            other => Err(unsupported(format!("the compression `{other}` is not known"))),
        }
    }

    pub(crate) fn decode(self, bytes: &[u8]) -> Result<Vec<u8>> {
        match self {
            Self::Lz4 => lz4(bytes),
            Self::Zstd => zstd(bytes),
        }
    }
}

fn lz4(bytes: &[u8]) -> Result<Vec<u8>> {
    let (size, coded) = bytes.split_first_chunk().ok_or_else(|| damaged("bytes of LZ4 are cut"))?;
    let size = u32::from_le_bytes(*size) as usize;
    if size > MAX_BYTES.min(coded.len().saturating_mul(LZ4_RATIO) + SLACK) {
        return Err(damaged(format!("{} bytes of LZ4 claim to be {size}", coded.len())));
    }
    let mut out = vec![0; size];
    match lz4_flex::block::decompress_into(coded, &mut out) {
        Ok(decoded) if decoded == size => Ok(out),
        Ok(decoded) => Err(damaged(format!("bytes of LZ4 are {decoded} and not {size}"))),
        Err(error) => Err(damaged(format!("bytes of LZ4: {error}"))),
    }
}

fn zstd(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    if bytes.is_empty() {
        return Ok(out);
    }
    // The first writers stored no size. A size that looks like the start of a frame has a bit set that a frame has not.
    let is_plain = bytes.len() < 8 || bytes.starts_with(&ZSTD) && bytes[4] & 0x10 == 0;
    let (expected, frame) = match bytes.split_first_chunk() {
        Some((size, frame)) if !is_plain => (usize::try_from(u64::from_le_bytes(*size)).ok(), frame),
        _ => (None, bytes),
    };
    let limit = expected.unwrap_or(MAX_BYTES);
    if limit > MAX_BYTES {
        return Err(damaged(format!("{} bytes of Zstandard claim to be {limit}", frame.len())));
    }
    let decoder = ruzstd::decoding::StreamingDecoder::new(frame);
    let decoder = decoder.map_err(|error| damaged(format!("bytes of Zstandard: {error}")))?;
    decoder
        .take(limit as u64 + 1)
        .read_to_end(&mut out)
        .map_err(|error| damaged(format!("bytes of Zstandard: {error}")))?;
    match expected {
        Some(expected) if out.len() != expected => {
            Err(damaged(format!("bytes of Zstandard are not the {expected} that they claim to be")))
        }
        _ if out.len() > MAX_BYTES => Err(unsupported("bytes of Zstandard are too many to read at once")),
        _ => Ok(out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compressed_bytes_come_back() {
        let bytes: Vec<u8> = (0..4000u32).map(|at| (at / 37) as u8).collect();
        let lz4 = lz4_flex::block::compress_prepend_size(&bytes);
        assert_eq!(Scheme::Lz4.decode(&lz4).unwrap(), bytes);
        let frame =
            ruzstd::encoding::compress_to_vec(&bytes[..], ruzstd::encoding::CompressionLevel::Fastest);
        assert_eq!(Scheme::Zstd.decode(&frame).unwrap(), bytes);
        let mut sized = 4000u64.to_le_bytes().to_vec();
        sized.extend_from_slice(&frame);
        assert_eq!(Scheme::Zstd.decode(&sized).unwrap(), bytes);
        sized[0] ^= 1;
        assert!(Scheme::Zstd.decode(&sized).is_err() && Scheme::Zstd.decode(&sized[..200]).is_err());
        sized[7] = 1;
        assert!(Scheme::Zstd.decode(&sized).unwrap_err().to_string().contains("claim"));
        let huge = [0xff, 0xff, 0xff, 0x7f, 1, 2, 3];
        assert!(Scheme::Lz4.decode(&huge).unwrap_err().to_string().contains("claim"));
    }
}
