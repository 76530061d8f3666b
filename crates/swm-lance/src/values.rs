//! Rows of a column, as they are read.

use std::ops::Range;

use crate::block::{Block, Items};
use crate::error::{Result, damaged};
use crate::kind::Kind;

/// Rows of a column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Values {
    items: Items,
    /// Items of a row that is no list.
    width: usize,
    /// Of lists: where the items of each row begin, and the last ones end.
    starts: Option<Vec<usize>>,
    /// Which rows are there; `None`: all.
    rows_valid: Option<Vec<bool>>,
    /// Which items are there; `None`: all.
    items_valid: Option<Vec<bool>>,
    rows: usize,
}

impl Values {
    /// No rows.
    pub(crate) fn empty(kind: &Kind) -> Result<Self> {
        let (item, is_list) = match kind {
            Kind::List(item) => (item.as_ref(), true),
            kind => (kind, false),
        };
        let (size, width) =
            item.shape().ok_or_else(|| damaged(format!("there are no values of type {kind}")))?;
        let starts = is_list.then(|| vec![0]);
        Ok(Self { items: Items::empty(size), width, starts, rows_valid: None, items_valid: None, rows: 0 })
    }

    /// How many rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Whether a row is there, and not missing.
    pub fn is_valid(&self, row: usize) -> bool {
        row < self.rows && self.rows_valid.as_ref().is_none_or(|valid| valid[row])
    }

    /// Whether an item is there. The items of a missing row are not.
    pub fn is_item_valid(&self, item: usize) -> bool {
        self.items_valid.as_ref().is_none_or(|valid| valid.get(item) == Some(&true))
            && (self.starts.is_some() || self.is_valid(item / self.width.max(1)))
    }

    /// Whether all rows and items are there.
    pub fn is_complete(&self) -> bool {
        let is_all =
            |valid: &Option<Vec<bool>>| valid.as_ref().is_none_or(|valid| valid.iter().all(|&valid| valid));
        is_all(&self.rows_valid) && is_all(&self.items_valid)
    }

    /// The items of a row: one, those of a fixed-size list, or those of a list.
    pub fn items(&self, row: usize) -> Range<usize> {
        match &self.starts {
            Some(starts) => match (starts.get(row), starts.get(row + 1)) {
                (Some(&start), Some(&end)) => start..end,
                _ => 0..0,
            },
            None => row * self.width..(row + 1) * self.width,
        }
    }

    /// The bytes of an item: a little-endian number, a byte 0 or 1, a text, or bytes. `None` if there is no such item.
    pub fn item(&self, item: usize) -> Option<&[u8]> {
        self.items.get(item)
    }

    /// All items of one size, end to end; those that are missing are zeros. Empty for texts and bytes.
    pub fn numbers(&self) -> &[u8] {
        match &self.items {
            Items::Fixed { bytes, .. } => bytes,
            Items::Variable { .. } => &[],
        }
    }

    /// Adds rows that are no lists.
    pub(crate) fn push(&mut self, block: &Block, range: Range<usize>, valid: Option<&[bool]>) -> Result<()> {
        if block.width != self.width || self.starts.is_some() {
            return Err(damaged(format!(
                "its rows have {} values, and {} were expected",
                block.width, self.width
            )));
        }
        let items = range.start * self.width..range.end * self.width;
        let before = self.items.count();
        self.items.extend(&block.items, items.clone())?;
        let items_valid = block.valid.as_ref().and_then(|valid| valid.get(items.clone()));
        add(&mut self.items_valid, before, items_valid, items.len());
        add(&mut self.rows_valid, self.rows, valid, range.len());
        self.rows += range.len();
        Ok(())
    }

    /// Adds a row that is a list.
    pub(crate) fn push_list(
        &mut self,
        block: &Block,
        items: Range<usize>,
        valid: Option<&[bool]>,
        is_valid: bool,
    ) -> Result<()> {
        self.push_items(BlockRef { items: &block.items, width: block.width }, items, valid, is_valid)
    }

    fn push_items(
        &mut self,
        block: BlockRef<'_>,
        items: Range<usize>,
        valid: Option<&[bool]>,
        is_valid: bool,
    ) -> Result<()> {
        let (Some(starts), 1) = (&mut self.starts, block.width) else {
            return Err(damaged("its rows are lists, which was not expected"));
        };
        let before = self.items.count();
        self.items.extend(block.items, items.clone())?;
        add(&mut self.items_valid, before, valid, items.len());
        add(&mut self.rows_valid, self.rows, Some(&[is_valid]), 1);
        starts.push(before + items.len());
        self.rows += 1;
        Ok(())
    }

    /// Adds a row that is a list of the rows of others.
    pub(crate) fn push_list_of(&mut self, other: &Self, rows: Range<usize>, is_valid: bool) -> Result<()> {
        let valid: Vec<bool> = rows.clone().map(|row| other.is_item_valid(row)).collect();
        let block = BlockRef { items: &other.items, width: other.width };
        self.push_items(block, rows, Some(&valid), is_valid)
    }

    /// Adds rows of others that are lists.
    pub(crate) fn extend_lists(&mut self, other: &Self, rows: Range<usize>) -> Result<()> {
        let (Some(starts), Some(others)) = (&mut self.starts, &other.starts) else {
            return Err(damaged("its rows are no lists"));
        };
        let wanted =
            others.get(rows.start..=rows.end).ok_or_else(|| damaged("it has fewer lists than rows"))?;
        let (first, last, before) = (wanted[0], wanted[wanted.len() - 1], self.items.count());
        self.items.extend(&other.items, first..last)?;
        starts.extend(wanted[1..].iter().map(|start| start - first + before));
        let items_valid = other.items_valid.as_ref().and_then(|valid| valid.get(first..last));
        add(&mut self.items_valid, before, items_valid, last - first);
        let rows_valid = other.rows_valid.as_ref().and_then(|valid| valid.get(rows.clone()));
        add(&mut self.rows_valid, self.rows, rows_valid, rows.len());
        self.rows += rows.len();
        Ok(())
    }

    /// The bytes of an item; 0 where each has its own.
    pub(crate) fn item_size(&self) -> usize {
        self.items.size()
    }

    /// Adds rows that are missing.
    pub(crate) fn push_missing(&mut self, rows: usize) -> Result<()> {
        let before = self.items.count();
        match &mut self.starts {
            Some(starts) => starts.resize(starts.len() + rows, before),
            None => {
                self.items.push_zeros(rows * self.width);
                add(&mut self.items_valid, before, None, rows * self.width);
            }
        }
        add(&mut self.rows_valid, self.rows, Some(&vec![false; rows]), rows);
        self.rows += rows;
        Ok(())
    }
}

/// Items of single values.
#[derive(Clone, Copy)]
struct BlockRef<'a> {
    items: &'a Items,
    width: usize,
}

/// Adds `count` marks to `before` ones.
fn add(all: &mut Option<Vec<bool>>, before: usize, more: Option<&[bool]>, count: usize) {
    match (all.as_mut(), more) {
        (None, None) => {}
        (None, Some(more)) if more.iter().all(|&valid| valid) => {}
        (None, Some(more)) => {
            let mut marks = vec![true; before];
            marks.extend_from_slice(more);
            *all = Some(marks);
        }
        (Some(marks), Some(more)) => marks.extend_from_slice(more),
        (Some(marks), None) => marks.resize(before + count, true),
    }
}
