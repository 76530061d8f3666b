//! Pages whose values are all equal, or missing.

use std::ops::Range;

use crate::block::{Block, Items, number};
use crate::error::{Result, damaged};
use crate::file::Page;
use crate::kind::Kind;
use crate::layout::Constant;
use crate::store::{Bytes, read};
use crate::values::Values;

/// Adds rows.
pub(super) fn rows(
    file: &dyn Bytes,
    page: &Page,
    constant: &Constant,
    kind: &Kind,
    rows: Range<u64>,
    out: &mut Values,
) -> Result<()> {
    let count = (rows.end - rows.start) as usize;
    let Some(scalar) = scalar(file, page, constant, kind)? else { return out.push_missing(count) };
    let [_, definition] = levels_of(file, page, constant)?;
    let levels = match &definition {
        None => None,
        Some(levels) => {
            let levels = levels.get(rows.start as usize..rows.end as usize);
            Some(levels.ok_or_else(|| damaged("it has fewer levels than rows"))?)
        }
    };
    let width = kind.shape().map_or(1, |(_, width)| width);
    let value = Block { items: scalar, valid: None, width };
    for row in 0..count {
        match levels.is_none_or(|levels| levels[row] == 0) {
            true => out.push(&value, 0..1, None)?,
            false => out.push_missing(1)?,
        }
    }
    Ok(())
}

/// The value that all have.
pub(super) fn scalar(
    file: &dyn Bytes,
    page: &Page,
    constant: &Constant,
    kind: &Kind,
) -> Result<Option<Items>> {
    let (size, width) = kind.shape().ok_or_else(|| damaged("it has no values"))?;
    let buffer = match (&constant.value, page.buffers.len()) {
        (Some(value), _) => value.clone(),
        (None, 1 | 3) => {
            let bytes = read(file, page.buffers[0])?;
            buffer_of_scalar(&bytes, size == 0)?
        }
        (None, _) => return Ok(None),
    };
    let mut items = Items::empty(size);
    let wrong = || damaged(format!("its constant has {} bytes", buffer.len()));
    match size {
        0 => items.push(&buffer),
        1 if *kind == Kind::Bool => items.push(&[buffer.first().ok_or_else(wrong)? & 1]),
        size if buffer.len() == size * width => items.push(&buffer),
        _ => return Err(wrong()),
    }
    Ok(Some(items))
}

/// A constant that is large: sizes of its buffers, and these; bytes have offsets before them.
fn buffer_of_scalar(bytes: &[u8], has_offsets: bool) -> Result<Vec<u8>> {
    let cut = || damaged("its constant is cut");
    let word = |at: usize| bytes.get(at * 4..at * 4 + 4).map(number).ok_or_else(cut);
    let expected = if has_offsets { 2 } else { 1 };
    if word(0)? != expected {
        return Err(damaged(format!("its constant has {} buffers, not {expected}", word(0)?)));
    }
    let last = usize::try_from(word(expected as usize)?).map_err(|_| cut())?;
    let start =
        bytes.len().checked_sub(last).filter(|&start| start >= 4 + 4 * expected as usize).ok_or_else(cut)?;
    Ok(bytes[start..].to_vec())
}

/// Levels of a constant: as they are, or coded.
pub(super) fn levels_of(file: &dyn Bytes, page: &Page, constant: &Constant) -> Result<[Option<Vec<u16>>; 2]> {
    let buffers = match page.buffers[..] {
        [repetition, definition] | [_, repetition, definition] => [repetition, definition],
        _ => return Ok([None, None]),
    };
    let codes = [&constant.repetition, &constant.definition];
    let mut found = [None, None];
    for (index, (buffer, code)) in buffers.into_iter().zip(codes).enumerate() {
        if buffer.size == 0 {
            continue;
        }
        let bytes = read(file, buffer)?;
        let count = usize::try_from(constant.counts[index]).map_err(|_| damaged("it has too many levels"))?;
        found[index] = Some(match code {
            Some(code) => code.levels(&bytes, count)?,
            None => bytes.chunks_exact(2).map(|level| number(level) as u16).collect(),
        });
    }
    Ok(found)
}
