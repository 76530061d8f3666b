//! Rows of a fragment that are deleted: a list in a file of Arrow, or from about 5,000 rows on a bitmap of Roaring.
//!
//! Source of the layouts: the formats' own pages, arrow.apache.org (columnar format, IPC files) and RoaringFormatSpec.

mod arrow;
mod roaring;

use std::ops::Range;

use crate::error::{At as _, Result, damaged, unsupported};
use crate::proto::fields;
use crate::store::{Extent, Store, read};

const FOLDER: &str = "_deletions";
/// A list is stored with at most so many bytes besides its numbers; bitmaps are smaller than lists.
const MOST_BESIDE: u64 = 1 << 16;
const NUMBER: u64 = size_of::<u32>() as u64;

/// Where deleted rows are listed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct DeletionFile {
    is_bitmap: bool,
    version: u64,
    id: u64,
    /// 0 in tables of the first writers.
    count: u64,
}

impl DeletionFile {
    pub(crate) fn parse(message: &[u8]) -> Result<Self> {
        let mut file = Self::default();
        for field in fields(message) {
            let (number, value) = field?;
            match number {
                1 => {
                    file.is_bitmap = match value.number()? {
                        0 => false,
                        1 => true,
                        kind => {
                            return Err(unsupported(format!("a list of deleted rows of the type {kind}")));
                        }
                    }
                }
                2 => file.version = value.number()?,
                3 => file.id = value.number()?,
                4 => file.count = value.number()?,
                7 => return Err(unsupported("its list of deleted rows is in another folder (base paths)")),
                _ => {}
            }
        }
        Ok(file)
    }

    /// The deleted rows of a fragment of `rows` rows, in order; parts that touch are one.
    pub(crate) fn read(&self, store: &dyn Store, fragment: u64, rows: u64) -> Result<Vec<Range<u64>>> {
        let Self { is_bitmap, version, id, count } = self;
        let ending = if *is_bitmap { "bin" } else { "arrow" };
        let path = format!("{FOLDER}/{fragment}-{version}-{id}.{ending}");
        let ranges = self.ranges(store, &path, rows).at(&path)?;
        let found: u64 = ranges.iter().map(|range| range.end - range.start).sum();
        if ranges.last().is_some_and(|range| range.end > rows) {
            return Err(damaged(format!("{path}: a row is deleted that its {rows} rows do not have")));
        }
        match *count == 0 || *count == found {
            true => Ok(ranges),
            false => {
                Err(damaged(format!("{path}: {found} rows are deleted, and the manifest records {count}")))
            }
        }
    }

    fn ranges(&self, store: &dyn Store, path: &str, rows: u64) -> Result<Vec<Range<u64>>> {
        let file = store.open(path)?;
        let size = file.length();
        if size > rows.saturating_mul(NUMBER).saturating_add(MOST_BESIDE) {
            return Err(damaged(format!("{size} bytes are too many for {rows} rows")));
        }
        let bytes = read(file.as_ref(), Extent { at: 0, size })?;
        if self.is_bitmap {
            return roaring::ranges(&bytes);
        }
        let mut all = arrow::numbers(&bytes, rows)?;
        all.sort_unstable();
        let mut ranges = Vec::new();
        all.into_iter().try_for_each(|row| add(&mut ranges, row.into()..u64::from(row) + 1))?;
        Ok(ranges)
    }
}

/// Adds a part behind the others.
fn add(ranges: &mut Vec<Range<u64>>, range: Range<u64>) -> Result<()> {
    match ranges.last_mut() {
        Some(last) if last.end > range.start => Err(damaged(format!("row {} is deleted twice", range.start))),
        Some(last) if last.end == range.start => {
            last.end = range.end;
            Ok(())
        }
        _ => {
            ranges.push(range);
            Ok(())
        }
    }
}

/// The next bytes.
fn take<'a>(bytes: &mut &'a [u8], size: usize) -> Result<&'a [u8]> {
    let (head, rest) = bytes.split_at_checked(size).ok_or_else(|| damaged("it is cut"))?;
    *bytes = rest;
    Ok(head)
}
