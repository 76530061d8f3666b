//! Whole chunks of Blosc 1, with all codecs but Snappy, with or without shuffle of bytes or bits. What HDF5 files hold is decoded in
//! part, see `formats/hdf5/blosc.rs`.
//!
//! Source of the format: c-blosc 1.21, `README_CHUNK_FORMAT.rst`, and `bitshuffle` for the order of bits.

use std::borrow::Cow;
use std::io::Read as _;

use swm_data::codecs::{lz4, unshuffle};
use swm_data::error::{FormatError, guarded};

/// Bytes before the starts of blocks.
const HEADER: usize = 16;
const SHUFFLED: u8 = 0x01;
const STORED: u8 = 0x02;
const BIT_SHUFFLED: u8 = 0x04;
const NOT_SPLIT: u8 = 0x10;
/// A block is split into one stream per byte of an element up to this element size…
const MAX_SPLITS: usize = 16;
/// …and from this many elements on.
const MIN_SPLIT_ELEMENTS: usize = 128;
/// A block of Zstandard can hold 128 KiB in 4 bytes; this bounds what a forged head can make us allocate.
const MAX_RATIO: usize = 1 << 15;

/// What is wrong with a chunk.
type Wrong = Cow<'static, str>;

/// The values of a chunk, of which there are `most` bytes at most.
pub(super) fn decode(source: &[u8], most: usize) -> Result<Vec<u8>, Wrong> {
    let header = source.get(..HEADER).ok_or("shorter than its header")?;
    let (flags, element) = (header[2], usize::from(header[3]).max(1));
    let (total, block_size) = (word(source, 4)?, word(source, 8)?);
    if total > most {
        return Err(format!("of {total} bytes, {most} were claimed").into());
    }
    if flags & STORED != 0 {
        let stored = source.get(HEADER..HEADER + total).ok_or("cut short")?;
        return Ok(stored.to_vec());
    }
    if total == 0 {
        return Ok(Vec::new());
    }
    if block_size == 0 || total / MAX_RATIO > source.len() {
        return Err("of an impossible size".into());
    }
    let codec = stream_decoder(flags >> 5)?;
    let mut out = vec![0; total];
    let mut shuffled = Vec::new();
    for (index, block) in out.chunks_mut(block_size).enumerate() {
        let start = word(source, HEADER + 4 * index)?;
        let is_split = flags & NOT_SPLIT == 0
            && block.len() == block_size
            && element <= MAX_SPLITS
            && block_size / element >= MIN_SPLIT_ELEMENTS;
        let count = if is_split { element } else { 1 };
        // Shuffling needs elements of several bytes, or bits of any.
        let shuffle = match () {
            () if flags & SHUFFLED != 0 && element > 1 => Some(false),
            () if flags & BIT_SHUFFLED != 0 && (block.len() / element).is_multiple_of(8) => Some(true),
            () => None,
        };
        match shuffle {
            None => streams(source, start, count, codec, block)?,
            Some(of_bits) => {
                shuffled.clear();
                shuffled.resize(block.len(), 0);
                streams(source, start, count, codec, &mut shuffled)?;
                match of_bits {
                    true => unshuffle_bits(&shuffled, element, block),
                    false => unshuffle(&shuffled, element, block),
                }
            }
        }
    }
    Ok(out)
}

/// Fills the bytes of one stream.
type Stream = fn(&[u8], &mut [u8]) -> Result<(), Wrong>;

fn stream_decoder(codec: u8) -> Result<Stream, Wrong> {
    match codec {
        0 => Ok(blosclz),
        1 => Ok(|source, out| match lz4(source, out) == Some(out.len()) {
            true => Ok(()),
            false => Err("no valid LZ4 data".into()),
        }),
        3 => Ok(|source, out| {
            let read = flate2::read::ZlibDecoder::new(source).read_exact(out);
            read.map_err(|_| "no valid zlib data".into())
        }),
        4 => Ok(|source, out| {
            let read = guarded(|| {
                let mut decoder =
                    ruzstd::decoding::StreamingDecoder::new(source).map_err(FormatError::other)?;
                decoder.read_exact(out).map_err(FormatError::from)
            });
            read.map_err(|_| "no valid Zstandard data".into())
        }),
        2 => Err("compressed by Snappy, which is not read".into()),
        other => Err(format!("compressed by the codec {other} of Blosc, which is unknown").into()),
    }
}

/// A block is one or more streams: a length, then so many bytes; bytes of full length are not compressed.
fn streams(source: &[u8], mut at: usize, count: usize, decode: Stream, out: &mut [u8]) -> Result<(), Wrong> {
    let size = out.len() / count;
    if size == 0 || size * count != out.len() {
        return Err("of an impossible size".into());
    }
    for part in out.chunks_exact_mut(size) {
        let length = word(source, at)?;
        at = at.checked_add(4).ok_or("cut short")?;
        let end = at.checked_add(length).ok_or("cut short")?;
        let stream = source.get(at..end).ok_or("cut short")?;
        at = end;
        match length == part.len() {
            true => part.copy_from_slice(stream),
            false => decode(stream, part)?,
        }
    }
    Ok(())
}

/// First bit 0 of the lowest byte of all elements, eight of them in a byte, then bit 1, …; a rest that fills no element follows as it is.
fn unshuffle_bits(shuffled: &[u8], element: usize, out: &mut [u8]) {
    let elements = out.len() / element;
    let plane = elements / 8;
    for byte in 0..element {
        for group in 0..plane {
            let bits: [u8; 8] = std::array::from_fn(|bit| shuffled[(byte * 8 + bit) * plane + group]);
            for member in 0..8 {
                let value =
                    bits.iter().enumerate().fold(0, |value, (bit, row)| value | (row >> member & 1) << bit);
                out[(group * 8 + member) * element + byte] = value;
            }
        }
    }
    let rest = elements * element;
    out[rest..].copy_from_slice(&shuffled[rest..]);
}

/// A stream of BloscLZ: literals of up to 32 bytes, and matches at distances of 13 or 16 bits.
fn blosclz(source: &[u8], out: &mut [u8]) -> Result<(), Wrong> {
    /// Beyond, a distance has two bytes more.
    const FAR: usize = 8191;
    const CUT: &str = "cut short in BloscLZ data";
    let (mut read, mut written) = (0, 0);
    let next = |read: &mut usize| -> Result<usize, Wrong> {
        let byte = *source.get(*read).ok_or(CUT)?;
        *read += 1;
        Ok(usize::from(byte))
    };
    // The first is always a literal.
    let mut control = next(&mut read)? & 31;
    loop {
        if control < 32 {
            let count = control + 1;
            let from = source.get(read..read + count).ok_or(CUT)?;
            out.get_mut(written..written + count).ok_or("longer than its size")?.copy_from_slice(from);
            (read, written) = (read + count, written + count);
        } else {
            let (mut length, high) = ((control >> 5) - 1, (control & 31) << 8);
            if length == 6 {
                loop {
                    let more = next(&mut read)?;
                    length += more;
                    if more != 255 {
                        break;
                    }
                }
            }
            let low = next(&mut read)?;
            let mut distance = high + low + 1;
            if low == 255 && high == 31 << 8 {
                distance = (next(&mut read)? << 8) + next(&mut read)? + FAR + 1;
            }
            let end = written + length + 3;
            if distance > written || end > out.len() {
                return Err("no valid BloscLZ data".into());
            }
            for at in written..end {
                out[at] = out[at - distance];
            }
            written = end;
        }
        if read >= source.len() {
            break;
        }
        control = next(&mut read)?;
    }
    match written == out.len() {
        true => Ok(()),
        false => Err("shorter than its size".into()),
    }
}

fn word(source: &[u8], at: usize) -> Result<usize, Wrong> {
    let bytes = source.get(at..).and_then(|bytes| bytes.first_chunk::<4>()).ok_or("cut short")?;
    Ok(u32::from_le_bytes(*bytes) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One block of one stream.
    fn chunk(flags: u8, element: u8, total: usize, stream: &[u8]) -> Vec<u8> {
        let mut chunk = vec![2, 1, flags | NOT_SPLIT, element];
        for word in [total, total, HEADER + 8 + stream.len(), HEADER + 4, stream.len()] {
            chunk.extend((word as u32).to_le_bytes());
        }
        chunk.extend(stream);
        chunk
    }

    #[test]
    fn bits_come_back_to_their_elements() {
        // Eight elements of two bytes: 1, 2, 3, … 8. Bit 0 of the low byte is set in 1, 3, 5, 7.
        let mut shuffled = [0; 16];
        shuffled[..4].copy_from_slice(&[0b0101_0101, 0b0110_0110, 0b0111_1000, 0b1000_0000]);
        let expected: Vec<u8> = (1..=8u16).flat_map(u16::to_le_bytes).collect();
        let stored = chunk(BIT_SHUFFLED | 1 << 5, 2, 16, &shuffled);
        assert_eq!(decode(&stored, 16).unwrap(), expected);
        assert!(decode(&stored, 15).is_err(), "more than was claimed");
    }

    #[test]
    fn matches_of_blosclz_repeat_what_was_written() {
        // Three literals, then a match of length 3 + 5 at distance 3, then one literal.
        let stream = [2, b'a', b'b', b'c', 6 << 5, 2, 0, b'd'];
        let mut out = [0; 12];
        blosclz(&stream, &mut out).unwrap();
        assert_eq!(&out, b"abcabcabcabd");
        // A long match of distance 1: 3 + 6 + 4.
        let mut out = [0; 14];
        blosclz(&[0, b'x', 7 << 5, 4, 0], &mut out).unwrap();
        assert_eq!(&out, b"xxxxxxxxxxxxxx");
        for cut in 0..stream.len() {
            assert!(blosclz(&stream[..cut], &mut [0; 12]).is_err(), "{cut}");
        }
        assert!(blosclz(&[0, b'x', 1 << 5, 5], &mut [0; 4]).is_err(), "a distance before the beginning");
    }

    #[test]
    fn forged_chunks_are_refused_without_large_allocations() {
        let good = chunk(1 << 5, 1, 20, &[0; 20]);
        assert_eq!(decode(&good, 20).unwrap(), [0; 20]);
        for cut in 0..good.len() {
            assert!(decode(&good[..cut], 20).is_err(), "{cut}");
        }
        let mut huge = good.clone();
        huge[4..12].fill(0x7f);
        assert!(decode(&huge, usize::MAX).is_err());
        let mut snappy = chunk(2 << 5, 1, 20, &[0; 3]);
        assert!(decode(&snappy, 20).unwrap_err().contains("Snappy"));
        snappy[2] = 7 << 5;
        assert!(decode(&snappy, 20).unwrap_err().contains("unknown"));
    }
}
