//! Pages of large values, each of which is read by itself.

use std::ops::Range;

use crate::block::{Block, Items, number};
use crate::error::{Result, damaged};
use crate::file::Page;
use crate::layout::Zipped;
use crate::store::{Bytes, read};
use crate::values::Values;

/// Adds rows.
pub(super) fn rows(
    file: &dyn Bytes,
    page: &Page,
    zipped: &Zipped,
    rows: Range<u64>,
    out: &mut Values,
) -> Result<()> {
    let Some(&data) = page.buffers.first() else { return Err(damaged("its buffer of values is missing")) };
    let (count, word) = ((rows.end - rows.start) as usize, zipped.word());
    if zipped.size.is_some() {
        let ends = row_ends(file, page, rows)?;
        let bytes = read(file, data.part(ends[0], ends[count] - ends[0])?)?;
        let mut walk = Walk { zipped, bytes: &bytes, items: Items::empty(0), valid: Vec::new() };
        for pair in ends.windows(2) {
            walk.bytes = &bytes[(pair[0] - ends[0]) as usize..(pair[1] - ends[0]) as usize];
            walk.next()?;
        }
        let block = Block::of(zipped.values.own_sizes(walk.items)?);
        return out.push(&block, 0..count, Some(&walk.valid));
    }
    let size = zipped.values.value_size()?;
    let stride = (word + size) as u64;
    let part = rows.start.checked_mul(stride).zip((count as u64).checked_mul(stride));
    let (from, all) = part.ok_or_else(|| damaged("its positions are too large"))?;
    let bytes = read(file, data.part(from, all)?)?;
    let (mut values, mut valid) = (Vec::with_capacity(count * size), Vec::with_capacity(count));
    for row in bytes.chunks_exact((word + size).max(1)) {
        let [_, definition] = zipped.split(number(&row[..word]));
        valid.push(definition == 0);
        values.extend_from_slice(&row[word..]);
    }
    out.push(&zipped.values.values(&values, count, out.item_size())?, 0..count, Some(&valid))
}

/// Where the rows of a page of values with their own sizes begin; the last one is the end.
fn row_ends(file: &dyn Bytes, page: &Page, rows: Range<u64>) -> Result<Vec<u64>> {
    let (Some(data), Some(index)) = (page.buffers.first(), page.buffers.get(1)) else {
        return Err(damaged("its index of rows is missing"));
    };
    let entries = page.rows + 1;
    let size = index.size / entries;
    if !matches!(size, 1 | 2 | 4 | 8) || index.size % entries != 0 {
        return Err(damaged(format!("its index has {} bytes for {} rows", index.size, page.rows)));
    }
    let bytes = read(file, index.part(rows.start * size, (rows.end - rows.start + 1) * size)?)?;
    let ends: Vec<u64> = bytes.chunks_exact(size as usize).map(number).collect();
    let is_wrong =
        ends.windows(2).any(|pair| pair[0] > pair[1]) || ends.last().is_none_or(|&end| end > data.size);
    match is_wrong {
        true => Err(damaged("its index of rows is not in order, or beyond the end")),
        false => Ok(ends),
    }
}

/// Values with levels before them, one behind the other.
pub(super) struct Walk<'a> {
    pub(super) zipped: &'a Zipped,
    pub(super) bytes: &'a [u8],
    /// What is there or missing.
    pub(super) items: Items,
    pub(super) valid: Vec<bool>,
}

impl<'a> Walk<'a> {
    fn take(&mut self, size: usize) -> Result<&'a [u8]> {
        let (head, rest) = self.bytes.split_at_checked(size).ok_or_else(|| damaged("its values are cut"))?;
        self.bytes = rest;
        Ok(head)
    }

    /// The levels of the next value, which is added if it is there or missing.
    pub(super) fn next(&mut self) -> Result<[u16; 2]> {
        let levels = self.zipped.split(number(self.take(self.zipped.word())?));
        let [_, definition] = levels;
        let is_valid = definition == 0;
        if definition > self.zipped.levels.visible {
            return Ok(levels);
        }
        let size = match self.zipped.size {
            Some(_) if !is_valid => 0,
            Some(size) => {
                let size = number(self.take(size)?);
                usize::try_from(size).map_err(|_| damaged("its values are cut"))?
            }
            None => self.zipped.values.value_size()?,
        };
        let value = self.take(size)?;
        self.items.push(value);
        self.valid.push(is_valid);
        Ok(levels)
    }
}
