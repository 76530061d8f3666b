//! Decoding of LZ4 blocks. Images of flat color are long overlapping matches (the same pixel again and again),
//! which this decoder writes as patterns of 16 bytes and in doubling pieces; there is no encoder and no frame format here.
//!
//! Source of the format: <https://github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md>.

/// The shortest match.
const MIN_MATCH: usize = 4;

/// Bytes that are copied at once where it does no harm to copy too many.
const WIDE: usize = 16;
/// From here on a repetition is copied in doubling pieces.
const LONG: usize = 8 * WIDE;

/// Decodes `source` into `out` and returns how many bytes it filled; `None` for damaged input or too small an `out`.
/// Bytes of `out` behind those may have changed too.
pub fn decode(source: &[u8], out: &mut [u8]) -> Option<usize> {
    let (mut read, mut written) = (0_usize, 0_usize);
    loop {
        let token = usize::from(*source.get(read)?);
        read += 1;

        let literals = length(source, &mut read, token >> 4)?;
        let end = written.checked_add(literals)?;
        match (wide(source, read), wide_mut(out, written)) {
            // Most are short: 16 bytes of a fixed size are faster than the right number of them.
            (Some(from), Some(into)) if literals <= WIDE => {
                *into = *from;
            }
            _ => {
                let from = source.get(read..read.checked_add(literals)?)?;
                out.get_mut(written..end)?.copy_from_slice(from);
            }
        }
        read += literals;
        written = end;
        if read == source.len() {
            return Some(written);
        }

        let distance = usize::from(u16::from_le_bytes(*source.get(read..)?.first_chunk()?));
        read += 2;
        let end = length(source, &mut read, token & 15)?.checked_add(MIN_MATCH)?.checked_add(written)?;
        if distance == 0 || distance > written || end > out.len() {
            return None;
        }
        repeat(out, written, distance, end);
        written = end;
    }
}

fn wide(bytes: &[u8], at: usize) -> Option<&[u8; WIDE]> {
    bytes.get(at..)?.first_chunk()
}

fn wide_mut(bytes: &mut [u8], at: usize) -> Option<&mut [u8; WIDE]> {
    bytes.get_mut(at..)?.first_chunk_mut()
}

/// A length of 15 goes on in the next bytes, until one is below 255.
fn length(source: &[u8], read: &mut usize, nibble: usize) -> Option<usize> {
    if nibble < 15 {
        return Some(nibble);
    }
    let mut length = nibble;
    loop {
        let byte = *source.get(*read)?;
        *read += 1;
        length = length.checked_add(usize::from(byte))?;
        if byte != 255 {
            return Some(length);
        }
    }
}

/// Fills `out[from..end]` with what stands `distance` bytes earlier, and perhaps some bytes behind `end` with anything.
fn repeat(out: &mut [u8], from: usize, distance: usize, end: usize) {
    let start = from - distance;
    if end + WIDE > out.len() || (distance >= WIDE && end - from > LONG) {
        double(out, start, from, end);
        return;
    }
    if distance >= WIDE {
        let mut at = 0;
        while from + at < end {
            let Some(&bytes) = wide(out, start + at) else { return };
            let Some(into) = wide_mut(out, from + at) else { return };
            *into = bytes;
            at += WIDE;
        }
        return;
    }
    let Some(&bytes) = wide(out, start) else { return };
    let (pattern, period) = repeated(bytes, distance);
    let near = end.min(from + LONG);
    let mut at = from;
    while at < near {
        let Some(into) = wide_mut(out, at) else { return };
        *into = pattern;
        at += period;
    }
    // `at` is a whole number of periods behind `from`.
    if at < end {
        double(out, from, at, end);
    }
}

/// The first `distance` bytes again and again, and how many of the 16 are whole repetitions.
fn repeated(bytes: [u8; WIDE], distance: usize) -> ([u8; WIDE], usize) {
    let (factor, period) = PATTERNS[distance];
    let mask = (1_u128 << (8 * distance)) - 1;
    ((u128::from_le_bytes(bytes) & mask).wrapping_mul(factor).to_le_bytes(), period)
}

/// For distances below 16, the number whose product with so many bytes repeats them, and the longest period up to 16.
const PATTERNS: [(u128, usize); WIDE] = {
    let mut table = [(0, WIDE); WIDE];
    let mut distance = 1;
    while distance < WIDE {
        let mut factor = 0;
        let mut shift = 0;
        while shift < WIDE {
            factor |= 1 << (8 * shift);
            shift += distance;
        }
        table[distance] = (factor, WIDE / distance * distance);
        distance += 1;
    }
    table
};

/// Fills `out[from..end]` with what stands at `start`, `from - start` bytes earlier. Each copy doubles what can be copied.
fn double(out: &mut [u8], start: usize, from: usize, end: usize) {
    let mut at = from;
    while at < end {
        let piece = (at - start).min(end - at);
        out.copy_within(start..start + piece, at);
        at += piece;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_overlapping_matches() {
        // 3 literals, a match of 7 at distance 3, then 5 literals (every block ends with literals).
        let source = [0x33, b'a', b'b', b'c', 3, 0, 0x50, b'v', b'w', b'x', b'y', b'z'];
        let mut out = [0; 15];
        assert_eq!(decode(&source, &mut out), Some(15));
        assert_eq!(&out, b"abcabcabcavwxyz");
    }

    #[test]
    fn long_runs_of_one_byte() {
        // One literal, a match of 4 + 15 + 255 + 10 at distance 1, then no literals.
        let source = [0x1f, 7, 1, 0, 255, 10, 0x00];
        let mut out = [0; 285];
        assert_eq!(decode(&source, &mut out), Some(285));
        assert!(out.iter().all(|&byte| byte == 7));
    }

    /// A plain decoder of one sequence: literals, a match, and literals again.
    fn plain(first: &[u8], distance: usize, length: usize, last: &[u8]) -> Vec<u8> {
        let mut out = first.to_vec();
        for _ in 0..length {
            out.push(out[out.len() - distance]);
        }
        out.extend(last);
        out
    }

    #[test]
    fn every_distance_and_length_is_as_byte_by_byte() {
        let first: Vec<u8> = (0..14).map(|i: u8| i.wrapping_mul(37)).collect();
        for literals in 1..=14 {
            for distance in 1..=literals {
                for length in (4..60).chain([127, 128, 129, 200, 1000]) {
                    for tail in [0_usize, 3, 40] {
                        let last = vec![7; tail];
                        let expected = plain(&first[..literals], distance, length, &last);
                        let mut source = vec![(literals << 4 | (length - 4).min(15)) as u8];
                        source.extend(&first[..literals]);
                        source.extend((distance as u16).to_le_bytes());
                        let mut more = length - 4;
                        if more >= 15 {
                            more -= 15;
                            source.extend(vec![255; more / 255]);
                            source.push((more % 255) as u8);
                        }
                        source.push((tail.min(15) << 4) as u8);
                        if tail >= 15 {
                            source.push((tail - 15) as u8);
                        }
                        source.extend(&last);
                        for room in [0, 5, 64] {
                            let mut out = vec![0; expected.len() + room];
                            assert_eq!(decode(&source, &mut out), Some(expected.len()));
                            assert_eq!(out[..expected.len()], expected, "{literals} {distance} {length}");
                        }
                        assert_eq!(decode(&source, &mut vec![0; expected.len() - 1]), None);
                    }
                }
            }
        }
    }

    #[test]
    fn far_matches_are_as_byte_by_byte() {
        let first: Vec<u8> = (0..100).map(|i: u8| i.wrapping_mul(37)).collect();
        for distance in 15..=100 {
            for length in [4, 15, 16, 17, 40, 99, 128, 129, 140, 600] {
                let mut out = first.clone();
                out.resize(100 + length + 50, 0);
                repeat(&mut out, 100, distance, 100 + length);
                assert_eq!(out[..100 + length], plain(&first, distance, length, &[]));
            }
        }
    }

    #[test]
    fn damaged_input_is_refused() {
        let mut out = [0; 64];
        for source in [
            &[][..],
            &[0x10],                       // the literal is missing
            &[0x10, 1, 0, 0, 0],           // distance 0
            &[0x10, 1, 2, 0, 0],           // distance before the start
            &[0x1f, 1, 1, 0, 255, 255],    // the length never ends
            &[0x1f, 1, 1, 0, 255, 200, 0], // longer than the output
        ] {
            assert_eq!(decode(source, &mut out), None, "{source:?}");
        }
    }
}
