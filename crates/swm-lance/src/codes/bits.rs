//! Integers with fewer bits than their type has, in the order of FastLanes: 1,024 values are interleaved in words of their type.

use crate::error::{Result, damaged};

/// Values of a packed chunk.
pub(crate) const CHUNK: usize = 1024;
/// The order of groups of 8 rows.
const ORDER: [usize; 8] = [0, 4, 2, 6, 1, 5, 3, 7];

/// Bytes of a packed chunk.
pub(crate) fn packed_bytes(bits: usize) -> usize {
    CHUNK * bits / 8
}

/// Adds the first `count` values of a chunk, as little-endian words of `size` bytes. `packed` has [`packed_bytes`] bytes.
pub(crate) fn unpack(size: usize, bits: usize, packed: &[u8], count: usize, out: &mut Vec<u8>) -> Result<()> {
    let word_bits = size * 8;
    if bits > word_bits || packed.len() != packed_bytes(bits) || count > CHUNK {
        return Err(damaged(format!(
            "{} bytes do not hold {CHUNK} values of {bits} bits ({count} of {word_bits} bits are wanted)",
            packed.len()
        )));
    }
    let start = out.len();
    out.resize(start + count * size, 0);
    if bits == 0 {
        return Ok(());
    }
    let lanes = CHUNK / word_bits;
    let mask = u64::MAX >> (64 - bits);
    let word = |row: usize, lane: usize| crate::block::number(&packed[(row * lanes + lane) * size..][..size]);
    let out = &mut out[start..];
    for row in 0..word_bits {
        let (first, shift) = (row * bits / word_bits, row * bits % word_bits);
        let is_split = shift + bits > word_bits;
        for lane in 0..lanes {
            let at = ORDER[row / 8] * 16 + row % 8 * 128 + lane;
            if at >= count {
                continue;
            }
            let mut value = word(first, lane) >> shift;
            if is_split {
                value |= word(first + 1, lane) << (word_bits - shift);
            }
            out[at * size..][..size].copy_from_slice(&(value & mask).to_le_bytes()[..size]);
        }
    }
    Ok(())
}

/// A chunk that begins with a word that has the number of its bits.
pub(super) fn inline(size: usize, chunk: &[u8], count: usize) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    if count == 0 {
        return Ok(out);
    }
    let (head, packed) = chunk.split_at_checked(size).ok_or_else(|| damaged("packed integers are cut"))?;
    let bits = usize::try_from(crate::block::number(head)).unwrap_or(usize::MAX);
    if bits > size * 8 {
        return Err(damaged(format!("packed integers have {bits} bits, more than their type")));
    }
    unpack(size, bits, packed, count, &mut out)?;
    Ok(out)
}

/// Chunks without a head; the rest that is no chunk is packed too, or as it is.
pub(super) fn out_of_line(size: usize, bits: usize, bytes: &[u8], count: usize) -> Result<Vec<u8>> {
    if bits > size * 8 {
        return Err(damaged(format!("packed integers have {bits} bits, more than their type")));
    }
    let (whole, rest, chunk) = (count / CHUNK, count % CHUNK, packed_bytes(bits));
    let plain = whole.checked_mul(chunk).and_then(|bytes| bytes.checked_add(rest * size));
    let padded =
        whole.checked_mul(chunk).and_then(|bytes| bytes.checked_add(if rest > 0 { chunk } else { 0 }));
    let is_plain = plain == Some(bytes.len());
    if !is_plain && padded != Some(bytes.len()) || bits == 0 && whole > 0 {
        return Err(damaged(format!("{} bytes do not hold {count} values of {bits} bits", bytes.len())));
    }
    let (packed, tail) = bytes.split_at(whole * chunk);
    let mut out = Vec::new();
    for packed in packed.chunks_exact(chunk.max(1)) {
        unpack(size, bits, packed, CHUNK, &mut out)?;
    }
    match (rest, is_plain) {
        (0, _) => {}
        (_, true) => out.extend_from_slice(tail),
        (_, false) => unpack(size, bits, tail, rest, &mut out)?,
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packs as the layout is defined: a lane is a stream of bits over its words.
    fn pack(size: usize, bits: usize, values: &[u64]) -> Vec<u8> {
        let (word_bits, mut packed) = (size * 8, vec![0; packed_bytes(bits)]);
        let lanes = CHUNK / word_bits;
        for row in 0..word_bits {
            for lane in 0..lanes {
                let value = values[ORDER[row / 8] * 16 + row % 8 * 128 + lane];
                for bit in 0..bits {
                    let at = row * bits + bit;
                    let byte = (at / word_bits * lanes + lane) * size + at % word_bits / 8;
                    packed[byte] |= ((value >> bit & 1) as u8) << (at % 8);
                }
            }
        }
        packed
    }

    #[test]
    fn packed_integers_come_back() {
        for size in [1, 2, 4, 8] {
            for bits in 0..=size * 8 {
                let mask = if bits == 0 { 0 } else { u64::MAX >> (64 - bits) };
                let values: Vec<u64> = (0..CHUNK as u64)
                    .map(|at| at.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23) & mask)
                    .collect();
                let packed = pack(size, bits, &values);
                for count in [CHUNK, 1, 700] {
                    let mut out = Vec::new();
                    unpack(size, bits, &packed, count, &mut out).unwrap();
                    let found: Vec<u64> = out.chunks_exact(size).map(crate::block::number).collect();
                    assert_eq!(found, values[..count], "{bits} of {} bits", size * 8);
                }
            }
        }
    }

    #[test]
    fn sizes_that_do_not_fit_are_errors() {
        assert!(unpack(4, 33, &[0; 4224], 5, &mut Vec::new()).is_err());
        assert!(unpack(4, 3, &[0; 383], 5, &mut Vec::new()).is_err());
        assert!(inline(4, &[3, 0, 0], 5).is_err() && inline(2, &[17, 0], 5).is_err());
        assert_eq!(inline(2, &[0, 0], 2).unwrap(), [0; 4]);
        assert_eq!(out_of_line(2, 3, &[7, 0, 9, 0], 2).unwrap(), [7, 0, 9, 0]);
        assert!(out_of_line(2, 3, &[7, 0, 9], 2).is_err() && out_of_line(2, 0, &[], usize::MAX).is_err());
    }
}
