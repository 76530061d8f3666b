//! Reading rows of a page of a file since version 2.1.

mod chunks;
mod constant;
mod lists;
mod zipped;

use std::ops::Range;

pub(crate) use self::chunks::{Chunk, ChunkTable, held};
use crate::cursor::Cursor;
use crate::error::{Result, damaged};
use crate::file::Page;
use crate::kind::Kind;
use crate::layout::{Chunks, Constant, Layout, Zipped};
use crate::store::Bytes;
use crate::values::Values;

/// Adds rows of a page that are there.
pub(crate) fn rows(
    file: &dyn Bytes,
    page: &Page,
    layout: &Layout,
    kind: &Kind,
    rows: Range<u64>,
    cursor: &mut Cursor,
    out: &mut Values,
) -> Result<()> {
    if matches!(kind, Kind::List(_)) {
        return lists::rows(file, page, layout, kind, rows, cursor, out);
    }
    let levels = match layout {
        Layout::Chunks(Chunks { levels, .. })
        | Layout::Constant(Constant { levels, .. })
        | Layout::Zipped(Zipped { levels, .. }) => levels,
    };
    if levels.list.is_some() {
        return Err(damaged("its values are lists, which the schema does not have"));
    }
    match layout {
        Layout::Chunks(chunks) => chunks::rows(file, page, chunks, rows, cursor, out),
        Layout::Constant(constant) => constant::rows(file, page, constant, kind, rows, out),
        Layout::Zipped(zipped) => zipped::rows(file, page, zipped, rows, out),
    }
}
