//! Decoding of LZ4 blocks. Pictures of flat colour are long overlapping matches (the same pixel again and again),
//! which this decoder copies in doubling pieces; there is no encoder and no frame format here.
//!
//! Source of the format: <https://github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md>.

/// The shortest match.
const MIN_MATCH: usize = 4;

/// Decodes `source` into `out` and returns how many bytes it filled; `None` for damaged input or too small an `out`.
pub(super) fn decode(source: &[u8], out: &mut [u8]) -> Option<usize> {
    let (mut read, mut written) = (0_usize, 0_usize);
    loop {
        let token = usize::from(*source.get(read)?);
        read += 1;

        let literals = length(source, &mut read, token >> 4)?;
        let end = written.checked_add(literals)?;
        out.get_mut(written..end)?.copy_from_slice(source.get(read..read.checked_add(literals)?)?);
        read += literals;
        written = end;
        if read == source.len() {
            return Some(written);
        }

        let distance = usize::from(u16::from_le_bytes([*source.get(read)?, *source.get(read + 1)?]));
        read += 2;
        let end = length(source, &mut read, token & 15)?.checked_add(MIN_MATCH)?.checked_add(written)?;
        if distance == 0 || distance > written || end > out.len() {
            return None;
        }
        repeat(out, written, distance, end);
        written = end;
    }
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

/// Fills `out[from..end]` with what stands `distance` bytes earlier. Each copy doubles the run that can be copied.
fn repeat(out: &mut [u8], from: usize, distance: usize, end: usize) {
    let start = from - distance;
    if distance == 1 {
        let byte = out[start];
        out[from..end].fill(byte);
        return;
    }
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
