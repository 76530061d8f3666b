//! How chunks are compressed. What is written is bounded by what the description of the array claims.

use std::io::{self, Read};

use swm_data::codecs::lz4;
use swm_data::dataset::CHANGED;
use swm_data::error::{At as _, FormatError, Result, guarded, invalid};

use super::blosc;

/// One step between a file and the values of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    Blosc,
    Zstd,
    Gzip,
    Zlib,
    /// A length, then a block.
    Lz4,
    /// A checksum behind the bytes.
    Crc32c,
}

/// What is read; its names are those of the versions 2 and 3, and of numcodecs in version 3.
const CODECS: &[(&str, Codec)] = &[
    ("blosc", Codec::Blosc),
    ("zstd", Codec::Zstd),
    ("gzip", Codec::Gzip),
    ("zlib", Codec::Zlib),
    ("lz4", Codec::Lz4),
    ("crc32c", Codec::Crc32c),
];

impl Codec {
    pub(super) fn named(name: &str) -> Option<Self> {
        let name = name.strip_prefix("numcodecs.").unwrap_or(name);
        CODECS.iter().find(|(known, _)| *known == name).map(|(_, codec)| *codec)
    }

    /// The bytes before this step, of which there are `most` at most.
    pub(super) fn decode(self, bytes: Vec<u8>, most: usize) -> Result<Vec<u8>> {
        let source = bytes.as_slice();
        let decoded = match self {
            Self::Blosc => {
                blosc::decode(source, most).map_err(|reason| invalid(format!("a chunk is {reason}")))
            }
            // A chunk of another program may make the decoder panic.
            Self::Zstd => guarded(|| {
                let decoder = ruzstd::decoding::StreamingDecoder::new(source).map_err(FormatError::other)?;
                Ok(all(decoder, most)?)
            }),
            Self::Gzip => all(flate2::read::MultiGzDecoder::new(source), most).map_err(FormatError::from),
            Self::Zlib => all(flate2::read::ZlibDecoder::new(source), most).map_err(FormatError::from),
            Self::Lz4 => block(source, most),
            Self::Crc32c => return checked(bytes),
        };
        decoded.at(format_args!("a chunk cannot be unpacked ({})", self.name()))
    }

    fn name(self) -> &'static str {
        CODECS.iter().find(|(_, codec)| *codec == self).map_or("", |(name, _)| name)
    }
}

/// All that a decoder gives; more than there should be is one byte more.
fn all(decoder: impl Read, most: usize) -> io::Result<Vec<u8>> {
    let mut out = Vec::new();
    decoder.take(most as u64 + 1).read_to_end(&mut out)?;
    Ok(out)
}

/// A block of LZ4 behind its length.
fn block(source: &[u8], most: usize) -> Result<Vec<u8>> {
    let (length, block) = source.split_first_chunk::<4>().ok_or_else(|| invalid("it is cut short"))?;
    let length = u32::from_le_bytes(*length) as usize;
    // A byte of LZ4 never stands for more than 255.
    if length > most || length / 256 > block.len() {
        return Err(invalid(format!("it claims to have {length} bytes")));
    }
    let mut out = vec![0; length];
    match lz4(block, &mut out) == Some(length) {
        true => Ok(out),
        false => Err(invalid("no valid LZ4 data")),
    }
}

/// The bytes before their checksum.
pub(super) fn checked(mut bytes: Vec<u8>) -> Result<Vec<u8>> {
    let (content, sum) = bytes.split_last_chunk::<4>().ok_or_else(|| invalid("a checksum is missing"))?;
    if crc32c(content) != u32::from_le_bytes(*sum) {
        return Err(invalid(CHANGED));
    }
    bytes.truncate(bytes.len() - 4);
    Ok(bytes)
}

/// CRC-32C, Castagnoli's polynomial, of all bytes.
pub(crate) fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let (mut table, mut index) = ([0; 256], 0);
        while index < 256 {
            let (mut value, mut bit) = (index as u32, 0);
            while bit < 8 {
                value = if value & 1 == 1 { value >> 1 ^ 0x82f6_3b78 } else { value >> 1 };
                bit += 1;
            }
            table[index] = value;
            index += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum: u32, &byte| sum >> 8 ^ TABLE[(sum as u8 ^ byte) as usize])
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn checksums_are_those_of_the_standard() {
        // RFC 3720, B.4.
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        let mut bytes = b"123456789".to_vec();
        bytes.extend(0xe306_9283_u32.to_le_bytes());
        assert_eq!(checked(bytes.clone()).unwrap(), b"123456789");
        bytes[3] ^= 1;
        assert!(checked(bytes).unwrap_err().to_string().contains("checksum is wrong"));
        assert!(checked(vec![1, 2]).is_err());
    }

    #[test]
    fn what_was_compressed_comes_back_and_more_is_noticed() {
        let text: Vec<u8> = (0..5000u32).flat_map(|at| (at / 7 % 251).to_le_bytes()).collect();
        let zlib = {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(&text).unwrap();
            encoder.finish().unwrap()
        };
        let gzip = {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(&text).unwrap();
            encoder.finish().unwrap()
        };
        let mut lz4 = (text.len() as u32).to_le_bytes().to_vec();
        lz4.extend(lz4_flex::block::compress(&text));
        for (codec, bytes) in [(Codec::Zlib, zlib), (Codec::Gzip, gzip), (Codec::Lz4, lz4)] {
            assert_eq!(codec.decode(bytes.clone(), text.len()).unwrap(), text, "{codec:?}");
            let short = codec.decode(bytes.clone(), 100);
            assert!(short.is_err() || short.unwrap().len() == 101, "{codec:?}");
            for cut in 0..bytes.len() {
                let _ = codec.decode(bytes[..cut].to_vec(), text.len());
            }
        }
        assert_eq!(Codec::named("numcodecs.zlib"), Some(Codec::Zlib));
        assert_eq!(Codec::named("imagecodecs_jpegxl"), None);
    }
}
