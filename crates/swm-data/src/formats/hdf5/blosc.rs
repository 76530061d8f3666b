//! Decoding of Blosc 1 chunks (HDF5 filter 32001) that hold LZ4 blocks, with or without byte shuffle: what the
//! reference and this program write. Only the blocks that overlap the wanted bytes are decoded. Other codecs and
//! bit shuffle are left to the HDF5 library.
//!
//! Source of the format: c-blosc 1.21, `README_CHUNK_FORMAT.rst`.

use std::ops::Range;

use super::lz4;

/// Bytes before the first block.
pub(super) const HEADER: usize = 16;
const SHUFFLED: u8 = 0x01;
const STORED: u8 = 0x02;
const BIT_SHUFFLED: u8 = 0x04;
const NOT_SPLIT: u8 = 0x10;
/// Upper three bits of the flags.
const CODEC_LZ4: u8 = 1;
/// A block is split into one stream per byte of an element up to this element size…
const MAX_SPLITS: usize = 16;
/// …and from this many elements on.
const MIN_SPLIT_ELEMENTS: usize = 128;

/// Buffers that are kept between calls.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    shuffled: Vec<u8>,
    block: Vec<u8>,
}

/// Decodes bytes `wanted` of the chunk `source`, which must hold `total` bytes, into `out`.
pub(super) fn decode(
    source: &[u8],
    total: usize,
    wanted: Range<usize>,
    out: &mut [u8],
    scratch: &mut Scratch,
) -> Result<(), &'static str> {
    let chunk = Chunk::parse(source, total)?;
    if wanted.end > total || wanted.len() != out.len() {
        return Err("asked for bytes behind its end");
    }
    if chunk.flags & STORED != 0 {
        let stored = source.get(HEADER + wanted.start..HEADER + wanted.end).ok_or("cut short")?;
        out.copy_from_slice(stored);
        return Ok(());
    }
    let mut filled = 0;
    while filled < out.len() {
        let at = wanted.start + filled;
        let index = at / chunk.block_size;
        let start = index * chunk.block_size;
        let size = chunk.block_size.min(total - start);
        let take = (start + size - at).min(out.len() - filled);
        if take == size {
            chunk.block(index, &mut out[filled..filled + take], &mut scratch.shuffled)?;
        } else {
            scratch.block.resize(size, 0);
            chunk.block(index, &mut scratch.block, &mut scratch.shuffled)?;
            out[filled..filled + take].copy_from_slice(&scratch.block[at - start..at - start + take]);
        }
        filled += take;
    }
    Ok(())
}

/// A chunk whose header has been checked.
struct Chunk<'a> {
    source: &'a [u8],
    flags: u8,
    element: usize,
    block_size: usize,
    total: usize,
}

impl<'a> Chunk<'a> {
    fn parse(source: &'a [u8], total: usize) -> Result<Self, &'static str> {
        let header = source.get(..HEADER).ok_or("shorter than its header")?;
        let (flags, element) = (header[2], usize::from(header[3]));
        let block_size = word(source, 8)?;
        if word(source, 4)? != total {
            return Err("of another size than its column says");
        }
        if flags & STORED == 0 {
            if flags >> 5 != CODEC_LZ4 || flags & BIT_SHUFFLED != 0 {
                return Err("compressed otherwise than its column says");
            }
            // A byte of LZ4 never stands for more than 255: this bounds what a forged header can make us allocate.
            if block_size == 0 || element == 0 || block_size.min(total) / 256 > source.len() {
                return Err("of an impossible block size");
            }
        }
        Ok(Self { source, flags, element, block_size, total })
    }

    /// Decodes block `index` into `out`, which has its size.
    fn block(&self, index: usize, out: &mut [u8], shuffled: &mut Vec<u8>) -> Result<(), &'static str> {
        let leftover = (index + 1) * self.block_size > self.total;
        let split = self.flags & NOT_SPLIT == 0
            && !leftover
            && self.element <= MAX_SPLITS
            && self.block_size / self.element >= MIN_SPLIT_ELEMENTS;
        let streams = if split { self.element } else { 1 };
        let at = word(self.source, HEADER + 4 * index)?;
        if self.flags & SHUFFLED == 0 || self.element == 1 {
            return self.streams(at, streams, out);
        }
        shuffled.resize(out.len(), 0);
        self.streams(at, streams, shuffled)?;
        unshuffle(shuffled, self.element, out);
        Ok(())
    }

    /// A block is one or more streams: a length, then so many bytes; bytes of full length are not compressed.
    fn streams(&self, mut at: usize, streams: usize, out: &mut [u8]) -> Result<(), &'static str> {
        let size = out.len() / streams;
        for part in out.chunks_exact_mut(size.max(1)).take(streams) {
            let length = word(self.source, at)?;
            at += 4;
            let end = at.checked_add(length).ok_or("cut short")?;
            let stream = self.source.get(at..end).ok_or("cut short")?;
            at = end;
            if length == part.len() {
                part.copy_from_slice(stream);
            } else if lz4::decode(stream, part) != Some(part.len()) {
                return Err("no valid LZ4 data");
            }
        }
        Ok(())
    }
}

/// First the lowest byte of every element, then the next, …; a rest that fills no element stands as it is. `shuffled` is as long
/// as `out`, and an element has at least one byte.
pub fn unshuffle(shuffled: &[u8], element: usize, out: &mut [u8]) {
    let elements = out.len() / element;
    for byte in 0..element {
        let lane = &shuffled[byte * elements..(byte + 1) * elements];
        for (target, &source) in out[byte..].iter_mut().step_by(element).zip(lane) {
            *target = source;
        }
    }
    let rest = elements * element;
    out[rest..].copy_from_slice(&shuffled[rest..]);
}

fn word(source: &[u8], at: usize) -> Result<usize, &'static str> {
    let bytes = source.get(at..at.checked_add(4).ok_or("cut short")?).ok_or("cut short")?;
    Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two blocks of 8 bytes and a rest of 4, elements of 1 byte.
    fn chunk() -> Vec<u8> {
        let mut chunk = vec![2, 1, CODEC_LZ4 << 5 | NOT_SPLIT | SHUFFLED, 1];
        for word in [20u32, 8, 0, 28, 40, 46] {
            chunk.extend(word.to_le_bytes());
        }
        chunk.extend([8, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8]); // not compressed
        chunk.extend([5, 0, 0, 0, 0x13, 9, 1, 0, 0x00]); // nine, eight times
        let last = chunk.len() as u32;
        chunk[24..28].copy_from_slice(&last.to_le_bytes());
        chunk.extend([4, 0, 0, 0, 10, 11, 12, 13]);
        chunk
    }

    #[test]
    fn any_range_of_a_chunk_can_be_decoded() {
        let all = [1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 9, 9, 9, 9, 9, 10, 11, 12, 13];
        for start in 0..all.len() {
            for end in start..=all.len() {
                let mut out = vec![0; end - start];
                decode(&chunk(), 20, start..end, &mut out, &mut Scratch::default()).unwrap();
                assert_eq!(out, all[start..end]);
            }
        }
    }

    #[test]
    fn unshuffling_keeps_the_rest() {
        let mut out = [0; 7];
        unshuffle(&[1, 3, 5, 2, 4, 6, 9], 2, &mut out);
        assert_eq!(out, [1, 2, 3, 4, 5, 6, 9]);
    }

    #[test]
    fn forged_chunks_are_refused_without_large_allocations() {
        let mut out = vec![0; 20];
        for cut in 0..chunk().len() {
            assert!(decode(&chunk()[..cut], 20, 0..20, &mut out, &mut Scratch::default()).is_err(), "{cut}");
        }
        let mut huge = chunk();
        huge[4..12].fill(0x7f);
        let total = 0x7f7f_7f7f;
        assert!(decode(&huge, total, 0..20, &mut out, &mut Scratch::default()).is_err());
    }
}
