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

/// HDF5's checksum of chunks: Fletcher's over big-endian words of 16 bits (`H5checksum.c`).
fn fletcher32(bytes: &[u8]) -> u32 {
    let (words, rest) = bytes.as_chunks::<2>();
    let (mut low, mut high) = (0u32, 0u32);
    let fold = |sum: u32| (sum & 0xffff) + (sum >> 16);
    // So many words cannot overflow the sums.
    for piece in words.chunks(360) {
        // Eight words at once: the sum of the eight sums that `low` goes through has a closed form.
        let (blocks, rest) = piece.as_chunks::<8>();
        for block in blocks {
            let (mut sum, mut weighted) = (0, 0);
            for (word, weight) in block.iter().zip([8, 7, 6, 5, 4, 3, 2, 1]) {
                let value = u32::from(u16::from_be_bytes(*word));
                sum += value;
                weighted += weight * value;
            }
            high += 8 * low + weighted;
            low += sum;
        }
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
    fn eight_words_at_once_sum_as_one_after_the_other() {
        let bytes: Vec<u8> =
            (0..3001u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 13) as u8 | 0x80).collect();
        for len in [0, 1, 2, 15, 16, 17, 719, 720, 721, 3001] {
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
