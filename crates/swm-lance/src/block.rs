//! Decoded values, end to end, before they are rows of a column.

use std::ops::Range;

use crate::error::{Result, damaged, unsupported};

/// Bytes of values in memory at once.
pub(crate) const MAX_BYTES: usize = 1 << 30;

/// The bytes of items.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Items {
    /// All of one size. Bits are bytes 0 or 1.
    Fixed { size: usize, bytes: Vec<u8> },
    /// Each ends where the next begins; the first offset is 0.
    Variable { offsets: Vec<usize>, bytes: Vec<u8> },
}

impl Items {
    pub(crate) fn empty(size: usize) -> Self {
        match size {
            0 => Self::Variable { offsets: vec![0], bytes: Vec::new() },
            size => Self::Fixed { size, bytes: Vec::new() },
        }
    }

    /// The bytes of an item; 0 where each has its own.
    pub(crate) fn size(&self) -> usize {
        match self {
            Self::Fixed { size, .. } => *size,
            Self::Variable { .. } => 0,
        }
    }

    pub(crate) fn count(&self) -> usize {
        match self {
            Self::Fixed { size, bytes } => bytes.len() / (*size).max(1),
            Self::Variable { offsets, .. } => offsets.len().saturating_sub(1),
        }
    }

    /// The bytes of an item that exists.
    pub(crate) fn get(&self, at: usize) -> Option<&[u8]> {
        match self {
            Self::Fixed { size, bytes } => bytes.get(at.checked_mul(*size)?..)?.get(..*size),
            Self::Variable { offsets, bytes } => bytes.get(*offsets.get(at)?..*offsets.get(at + 1)?),
        }
    }

    /// Adds items of the same size.
    pub(crate) fn extend(&mut self, other: &Self, range: Range<usize>) -> Result<()> {
        let missing = || damaged("it has fewer values than it claims");
        if range.is_empty() {
            return Ok(());
        }
        match (self, other) {
            (Self::Fixed { size, bytes }, Self::Fixed { size: other_size, bytes: more })
                if size == other_size =>
            {
                let more = more.get(range.start * *size..range.end * *size).ok_or_else(missing)?;
                check(bytes.len() + more.len())?;
                bytes.extend_from_slice(more);
                Ok(())
            }
            (Self::Variable { offsets, bytes }, Self::Variable { offsets: more_offsets, bytes: more }) => {
                let ends = more_offsets.get(range.start..=range.end).ok_or_else(missing)?;
                let (first, last) = (ends[0], ends[ends.len() - 1]);
                let base = bytes.len();
                check(base + last.saturating_sub(first))?;
                bytes.extend_from_slice(more.get(first..last).ok_or_else(missing)?);
                offsets.extend(ends[1..].iter().map(|end| end - first + base));
                Ok(())
            }
            (here, other) => Err(damaged(format!(
                "its values have {} bytes, and {} were expected (0: each its own)",
                other.size(),
                here.size()
            ))),
        }
    }

    /// Adds an item, whose size fits.
    pub(crate) fn push(&mut self, item: &[u8]) {
        match self {
            Self::Fixed { bytes, .. } => bytes.extend_from_slice(item),
            Self::Variable { offsets, bytes } => {
                bytes.extend_from_slice(item);
                offsets.push(bytes.len());
            }
        }
    }

    /// Adds items of zeros, or empty ones.
    pub(crate) fn push_zeros(&mut self, count: usize) {
        match self {
            Self::Fixed { size, bytes } => bytes.resize(bytes.len() + count * *size, 0),
            Self::Variable { offsets, bytes } => offsets.resize(offsets.len() + count, bytes.len()),
        }
    }
}

fn check(size: usize) -> Result<()> {
    match size <= MAX_BYTES {
        true => Ok(()),
        false => Err(unsupported(format!("{size} bytes of values in one read"))),
    }
}

/// Decoded values: each has as many items.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) items: Items,
    /// Which items of fixed-size lists are there; `None`: all.
    pub(crate) valid: Option<Vec<bool>>,
    /// Items of a value.
    pub(crate) width: usize,
}

impl Block {
    pub(crate) fn of(items: Items) -> Self {
        Self { items, valid: None, width: 1 }
    }

    pub(crate) fn fixed(size: usize, bytes: Vec<u8>) -> Self {
        Self::of(Items::Fixed { size, bytes })
    }

    /// How many values.
    pub(crate) fn count(&self) -> usize {
        self.items.count() / self.width.max(1)
    }

    /// Groups values into wider ones, of which `valid` has a mark for each value that there was.
    pub(crate) fn widened(mut self, width: usize, valid: Option<Vec<bool>>) -> Result<Self> {
        if let Some(outer) = valid {
            let inner = self.valid.take();
            let items = self.items.count();
            if outer.len() * self.width != items {
                return Err(damaged("the marks of missing values are of another number"));
            }
            let both =
                (0..items).map(|at| outer[at / self.width] && inner.as_ref().is_none_or(|inner| inner[at]));
            self.valid = Some(both.collect());
        }
        self.width *= width;
        Ok(self)
    }

    /// The numbers of unsigned integers, such as positions in a dictionary.
    pub(crate) fn numbers(&self) -> Result<Vec<u64>> {
        let Items::Fixed { size: size @ 1..=8, bytes } = &self.items else {
            return Err(damaged("its positions are no integers"));
        };
        Ok(bytes.chunks_exact(*size).map(number).collect())
    }
}

/// A little-endian number of up to 8 bytes.
pub(crate) fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

/// `count` bits from the bit `from` on, least significant first, as bytes 0 or 1; what is not there is 0.
pub(crate) fn bits(bytes: &[u8], from: usize, count: usize) -> Vec<u8> {
    (from..from + count).map(|at| bytes.get(at / 8).map_or(0, |byte| byte >> (at % 8) & 1)).collect()
}

/// As [`bits`], of marks; all have to be there.
pub(crate) fn marks(bytes: &[u8], from: usize, count: usize) -> Result<Vec<bool>> {
    match (from + count).div_ceil(8) <= bytes.len() {
        true => Ok(bits(bytes, from, count).into_iter().map(|bit| bit == 1).collect()),
        false => Err(damaged("the marks of missing values are cut")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_put_together() {
        let mut items = Items::empty(0);
        items.push(b"one");
        items.push_zeros(1);
        items.push(b"three");
        let mut other = Items::empty(0);
        other.push(b"zero");
        other.extend(&items, 1..3).unwrap();
        assert_eq!(
            (other.count(), other.get(1), other.get(2), other.get(3)),
            (3, Some(&b""[..]), Some(&b"three"[..]), None)
        );
        assert!(other.extend(&items, 2..4).is_err());
        assert!(other.extend(&Items::Fixed { size: 2, bytes: vec![0; 4] }, 0..1).is_err());
    }

    #[test]
    fn missing_lists_hide_their_items() {
        let block =
            Block::fixed(1, vec![1, 2, 3, 4]).widened(2, Some(vec![true, false, true, true])).unwrap();
        let block = block.widened(1, Some(vec![false, true])).unwrap();
        assert_eq!((block.count(), block.valid), (2, Some(vec![false, false, true, true])));
    }
}
