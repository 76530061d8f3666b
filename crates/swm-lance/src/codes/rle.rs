//! Runs of equal values: a buffer of values, and one of how often each is there.

use super::Code;
use crate::block::{Block, number};
use crate::error::{Result, damaged};

/// The two buffers of a block that is one.
pub(super) fn split(block: &[u8]) -> Result<[&[u8]; 2]> {
    let cut = || damaged("a block of runs is cut");
    let (size, rest) = block.split_first_chunk().ok_or_else(cut)?;
    let size = usize::try_from(u64::from_le_bytes(*size)).map_err(|_| cut())?;
    let (values, lengths) = rest.split_at_checked(size).ok_or_else(cut)?;
    Ok([values, lengths])
}

/// `count` values. Runs may go on beyond the end: writers put the rest into the next chunk too.
pub(super) fn decode(
    values: &Code,
    lengths: &Code,
    [stored, stored_lengths]: [&[u8]; 2],
    count: usize,
) -> Result<Block> {
    let (size, length_size) = (values.word()?, lengths.word()?);
    // A number of values is known of one of them first.
    let (values, lengths) = match (values.plain(stored)?, lengths.plain(stored_lengths)?) {
        (Some(values), Some(lengths)) => (values, lengths),
        (Some(values), None) => {
            let lengths = lengths.block(stored_lengths, values.len() / size)?.bytes()?;
            (values, lengths)
        }
        (None, Some(lengths)) => {
            let values = values.block(stored, lengths.len() / length_size)?.bytes()?;
            (values, lengths)
        }
        (None, None) => return Err(damaged("neither the values of runs nor their lengths are plain")),
    };
    if values.len() % size != 0
        || lengths.len() % length_size != 0
        || values.len() / size != lengths.len() / length_size
    {
        return Err(damaged("runs have other numbers of values than of lengths"));
    }
    let mut out = Vec::new();
    let mut left = count;
    for (value, length) in values.chunks_exact(size).zip(lengths.chunks_exact(length_size)) {
        let length = number(length);
        if length == 0 {
            return Err(damaged("a run is empty"));
        }
        let here = usize::try_from(length).unwrap_or(usize::MAX).min(left);
        for _ in 0..here {
            out.extend_from_slice(value);
        }
        left -= here;
    }
    match left {
        0 => Ok(Block::fixed(size, out)),
        left => Err(damaged(format!("runs end {left} values before they should"))),
    }
}
