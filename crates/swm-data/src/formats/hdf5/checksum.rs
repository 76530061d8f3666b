//! Checksums of chunks.

use crate::dataset::CHANGED;
use crate::error::{Result, invalid};

/// Bytes behind a chunk that has a checksum.
pub(super) const BYTES: usize = 4;

/// Compares the checksum at the end of a chunk.
pub(super) fn check_chunk(stored: &[u8]) -> Result<()> {
    let is_right = stored
        .split_last_chunk::<BYTES>()
        .is_some_and(|(bytes, checksum)| fletcher32(bytes) == u32::from_le_bytes(*checksum));
    if is_right { Ok(()) } else { Err(invalid(CHANGED)) }
}

/// Words that are summed side by side.
const LANES: usize = 8;

/// HDF5's checksum of chunks: Fletcher's over big-endian words of 16 bits (`H5checksum.c`).
pub(super) fn fletcher32(bytes: &[u8]) -> u32 {
    let (words, rest) = bytes.as_chunks::<2>();
    let (mut low, mut high) = (0u32, 0u32);
    let fold = |sum: u32| (sum & 0xffff) + (sum >> 16);
    // So many words cannot overflow the sums.
    for piece in words.chunks(44 * LANES) {
        // Every lane has sums of its own, in one vector: word b of B in lane l counts LANES (B - b) - l times in `high`.
        let (blocks, rest) = piece.as_chunks::<LANES>();
        let (mut lows, mut highs) = ([0u32; LANES], [0u32; LANES]);
        for block in blocks {
            for ((word, low), high) in block.iter().zip(&mut lows).zip(&mut highs) {
                *low += u32::from(u16::from_be_bytes(*word));
                *high += *low;
            }
        }
        let late: u32 = (0..).zip(lows).map(|(lane, low)| lane * low).sum();
        high += (blocks.len() * LANES) as u32 * low + LANES as u32 * highs.iter().sum::<u32>() - late;
        low += lows.iter().sum::<u32>();
        for &word in rest {
            low += u32::from(u16::from_be_bytes(word));
            high += low;
        }
        (low, high) = (fold(low), fold(high));
    }
    if let [last] = rest {
        low += u32::from(*last) << 8;
        high += low;
        (low, high) = (fold(low), fold(high));
    }
    fold(high) << 16 | fold(low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_side_by_side_sum_as_one_after_the_other() {
        let bytes: Vec<u8> =
            (0..3001u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 13) as u8 | 0x80).collect();
        for len in [0, 1, 2, 15, 16, 17, 703, 704, 705, 3001] {
            let (mut low, mut high) = (0u64, 0u64);
            for word in bytes[..len].chunks(2) {
                low += u64::from(word[0]) << 8 | word.get(1).map_or(0, |&byte| u64::from(byte));
                high += low;
            }
            // Sums modulo 65,535 are never 0 but where every word is.
            let fold = |sum: u64| if sum == 0 { 0 } else { (sum - 1) % 0xffff + 1 };
            assert_eq!(u64::from(fletcher32(&bytes[..len])), fold(high) << 16 | fold(low), "{len} bytes");
        }
    }
}
