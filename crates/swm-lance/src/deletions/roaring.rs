//! Bitmaps of Roaring: for each 65,536 numbers that have some set, a list, the bits, or runs.

use std::ops::Range;

use super::{add, take};
use crate::block::number;
use crate::error::{Result, damaged};

/// How a bitmap begins that has no runs.
const PLAIN: u64 = 12_346;
/// How one begins that may have some.
const WITH_RUNS: u64 = 12_347;
/// Numbers of a container.
const CONTAINER: u64 = 1 << 16;
const CONTAINER_BYTES: usize = (CONTAINER / 8) as usize;
/// More numbers than these are stored as bits.
const MAX_LISTED: u64 = 4096;
/// From so many containers on, bitmaps with runs have positions of the containers, too.
const WITH_POSITIONS: usize = 4;

/// The numbers that are set.
pub(super) fn ranges(mut bytes: &[u8]) -> Result<Vec<Range<u64>>> {
    let bytes = &mut bytes;
    let cookie = number(take(bytes, 4)?);
    let (count, runs, has_positions) = match (cookie & 0xffff, cookie) {
        (WITH_RUNS, _) => {
            let count = (cookie >> 16) as usize + 1;
            (count, take(bytes, count.div_ceil(8))?, count >= WITH_POSITIONS)
        }
        (_, PLAIN) => (number(take(bytes, 4)?) as usize, &[][..], true),
        _ => return Err(damaged("it does not begin as a bitmap of Roaring")),
    };
    if count as u64 > CONTAINER {
        return Err(damaged(format!("it claims {count} containers")));
    }
    let heads = take(bytes, count * 4)?;
    take(bytes, if has_positions { count * 4 } else { 0 })?;
    let mut ranges = Vec::new();
    for (index, head) in heads.chunks_exact(4).enumerate() {
        let (base, expected) = (number(&head[..2]) * CONTAINER, number(&head[2..]) + 1);
        let mut found = 0;
        let mut add = |from: u64, count: u64| {
            found += count;
            match from + count <= CONTAINER {
                true => add(&mut ranges, base + from..base + from + count),
                false => Err(damaged("a run is longer than its container")),
            }
        };
        if runs.get(index / 8).is_some_and(|byte| byte >> (index % 8) & 1 == 1) {
            let count = number(take(bytes, 2)?) as usize;
            let runs = take(bytes, count * 4)?;
            runs.chunks_exact(4).try_for_each(|run| add(number(&run[..2]), number(&run[2..]) + 1))?;
        } else if expected <= MAX_LISTED {
            let list = take(bytes, expected as usize * 2)?;
            list.chunks_exact(2).try_for_each(|at| add(number(at), 1))?;
        } else {
            for (at, word) in (0..).step_by(64).zip(take(bytes, CONTAINER_BYTES)?.chunks_exact(8)) {
                let mut word = number(word);
                while word != 0 {
                    let from = word.trailing_zeros();
                    let count = (!(word >> from)).trailing_zeros();
                    add(at + u64::from(from), count.into())?;
                    word &= u64::MAX.checked_shl(from + count).unwrap_or(0);
                }
            }
        }
        if found != expected {
            return Err(damaged(format!("a container has {found} numbers, and {expected} are recorded")));
        }
    }
    match bytes.is_empty() {
        true => Ok(ranges),
        false => Err(damaged(format!("{} bytes follow its last container", bytes.len()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A head: numbers of a container, by its place among all.
    fn head(key: u16, count: u32) -> Vec<u8> {
        [key.to_le_bytes(), ((count - 1) as u16).to_le_bytes()].concat()
    }

    fn shorts(values: &[u16]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    /// A list, bits and runs, with the numbers 1, 2, 5; 65,536 + 0..5,000 and the last; and 3 × 65,536 + all.
    fn all_kinds() -> Vec<u8> {
        let mut bits = vec![0u8; CONTAINER_BYTES];
        bits[..625].fill(0xff);
        bits[CONTAINER_BYTES - 1] = 0x80;
        let heads = [head(0, 3), head(1, 5001), head(3, 65_536)].concat();
        let start = (2u32 << 16 | WITH_RUNS as u32).to_le_bytes();
        [&start[..], &[0b100], &heads, &shorts(&[1, 2, 5]), &bits, &shorts(&[1, 0, 65_535])].concat()
    }

    #[test]
    fn lists_bits_and_runs_are_read() {
        let expected = [1..3, 5..6, 65_536..70_536, 131_071..131_072, 196_608..262_144];
        assert_eq!(ranges(&all_kinds()).unwrap(), expected);
        // Without runs: the count by itself, and positions, which are not needed.
        let plain = [
            &[0x3a, 0x30, 0, 0, 2, 0, 0, 0][..],
            &head(7, 1),
            &head(8, 2),
            &[9; 8],
            &shorts(&[4, 0, 65_535]),
        ];
        assert_eq!(ranges(&plain.concat()).unwrap(), [458_756..458_757, 524_288..524_289, 589_823..589_824]);
        assert_eq!(ranges(&[0x3a, 0x30, 0, 0, 0, 0, 0, 0]).unwrap(), []);
        // From four containers on, there are positions in both kinds.
        let heads: Vec<u8> = (0..4).flat_map(|key| head(key, 1)).collect();
        let start = (3u32 << 16 | WITH_RUNS as u32).to_le_bytes();
        let four = [&start[..], &[0], &heads, &[9; 16], &shorts(&[0; 4])].concat();
        assert_eq!(ranges(&four).unwrap().len(), 4);
    }

    #[test]
    fn damaged_bitmaps_are_errors() {
        let sound = all_kinds();
        for end in 0..sound.len() {
            assert!(ranges(&sound[..end]).is_err(), "cut at {end}");
        }
        assert!(ranges(&[&sound[..], &[0]].concat()).is_err());
        // Any change of a byte of heads, lists and runs is an error, or other numbers in order; of the marks of runs, bits are unused.
        for at in (0..4).chain(5..30).chain(sound.len() - 10..sound.len()) {
            for change in 1..=255 {
                let mut flipped = sound.clone();
                flipped[at] ^= change;
                if let Ok(found) = ranges(&flipped) {
                    assert!(found.windows(2).all(|pair| pair[0].end < pair[1].start), "byte {at} ^ {change}");
                    assert_ne!(found, ranges(&sound).unwrap(), "byte {at} ^ {change}");
                }
            }
        }
        // Many containers, and twice the same one.
        assert!(ranges(&[0x3a, 0x30, 0, 0, 0xff, 0xff, 0xff, 0xff]).is_err());
        let twice =
            [&[0x3a, 0x30, 0, 0, 2, 0, 0, 0][..], &head(7, 1), &head(7, 1), &[9; 8], &shorts(&[4, 4])];
        assert!(ranges(&twice.concat()).is_err());
    }
}
