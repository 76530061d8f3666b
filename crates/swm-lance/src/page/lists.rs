//! Pages of lists, by the levels of their values.

use std::ops::Range;

use super::chunks::{Ahead, Chunk, decode, looked_up, table};
use super::constant::{levels_of, scalar};
use super::zipped::Walk;
use crate::block::{Block, Items};
use crate::cursor::Cursor;
use crate::error::{Result, damaged};
use crate::file::Page;
use crate::kind::Kind;
use crate::layout::{Chunks, Layout, Levels, Zipped};
use crate::store::{Bytes, read};
use crate::values::Values;

/// Levels of a page, and the values that are there or missing in it.
struct Leveled {
    block: Block,
    repetition: Vec<u16>,
    definition: Vec<u16>,
}

/// Adds rows that are lists. The page is decoded as a whole: a list may be in several chunks.
pub(super) fn rows(
    file: &dyn Bytes,
    page: &Page,
    layout: &Layout,
    kind: &Kind,
    rows: Range<u64>,
    cursor: &mut Cursor,
    out: &mut Values,
) -> Result<()> {
    let whole = match cursor.page(page.key) {
        Some(whole) => whole,
        None => {
            let mut whole = Values::empty(kind)?;
            all_lists(file, page, layout, kind, &mut whole)?;
            if whole.rows() as u64 != page.rows {
                return Err(damaged(format!(
                    "it has {} lists, and {} are expected",
                    whole.rows(),
                    page.rows
                )));
            }
            cursor.keep_page(page.key, whole)
        }
    };
    out.extend_lists(&whole, rows.start as usize..rows.end as usize)
}

fn all_lists(file: &dyn Bytes, page: &Page, layout: &Layout, kind: &Kind, out: &mut Values) -> Result<()> {
    let (levels, leveled) = match layout {
        Layout::Chunks(chunks) => (&chunks.levels, leveled_chunks(file, page, chunks)?),
        Layout::Zipped(zipped) => (&zipped.levels, leveled_zipped(file, page, zipped)?),
        Layout::Constant(constant) => {
            let [repetition, definition] = levels_of(file, page, constant)?;
            let Some(repetition) = repetition else { return out.push_missing(page.rows as usize) };
            let definition = definition.unwrap_or_else(|| vec![0; repetition.len()]);
            let Kind::List(item) = kind else { return Err(damaged("its values are no lists")) };
            let mut items = Items::empty(out.item_size());
            let scalar = scalar(file, page, constant, item)?;
            for _ in definition.iter().filter(|&&level| level <= constant.levels.visible) {
                match &scalar {
                    Some(scalar) => items.extend(scalar, 0..1)?,
                    None => items.push_zeros(1),
                }
            }
            (&constant.levels, Leveled { block: Block::of(items), repetition, definition })
        }
    };
    assemble(levels, &leveled, out)
}

/// Lists by their levels: of repetition, 0 goes on with one.
fn assemble(levels: &Levels, leveled: &Leveled, out: &mut Values) -> Result<()> {
    let Leveled { block, repetition, definition } = leveled;
    let Some(list) = levels.list else { return Err(damaged("its values are no lists")) };
    if repetition.len() != definition.len() {
        return Err(damaged("its levels have several numbers"));
    }
    let (mut at, mut item) = (0, 0);
    while at < repetition.len() {
        if repetition[at] == 0 {
            return Err(damaged("its first list has no beginning"));
        }
        let start = item;
        let mut valid = Vec::new();
        let first = definition[at];
        let is_list = first <= levels.visible || list.empty == Some(first);
        loop {
            let level = definition[at];
            if level <= levels.visible {
                valid.push(level == 0);
                item += 1;
            }
            at += 1;
            if repetition.get(at).is_none_or(|&level| level != 0) {
                break;
            }
        }
        out.push_list(block, start..item, Some(&valid), is_list)?;
    }
    match item == block.count() {
        true => Ok(()),
        false => Err(damaged(format!("its lists have {item} values, of {}", block.count()))),
    }
}

fn leveled_chunks(file: &dyn Bytes, page: &Page, layout: &Chunks) -> Result<Leveled> {
    let table = table(file, page, layout)?;
    let mut ahead = Ahead::default();
    let chunks = table.firsts.len() - 1;
    let (mut repetition, mut definition): (Vec<u16>, Vec<u16>) = (Vec::new(), Vec::new());
    let mut whole: Option<Block> = None;
    for index in 0..chunks {
        let bytes = ahead.chunk(file, page.buffers[1], table, index..chunks)?;
        let items = (table.firsts[index + 1] - table.firsts[index]) as usize;
        let Chunk { block, repetition: more, definition: levels } = decode(bytes, layout, items)?;
        let more = more.ok_or_else(|| damaged("its lists have no levels of repetition"))?;
        definition.extend(levels.unwrap_or_else(|| vec![0; more.len()]));
        repetition.extend(more);
        let block = match &table.dictionary {
            Some(dictionary) => looked_up(dictionary, &block, 0..items, None)?,
            None => block,
        };
        match &mut whole {
            None => whole = Some(block),
            Some(whole) => whole.items.extend(&block.items, 0..block.items.count())?,
        }
    }
    let block = whole.unwrap_or_else(|| Block::of(Items::empty(1)));
    Ok(Leveled { block, repetition, definition })
}

fn leveled_zipped(file: &dyn Bytes, page: &Page, zipped: &Zipped) -> Result<Leveled> {
    let Some(&data) = page.buffers.first() else { return Err(damaged("its buffer of values is missing")) };
    if zipped.word() == 0 {
        return Err(damaged("its lists have no levels"));
    }
    let bytes = read(file, data)?;
    let mut walk = Walk { zipped, bytes: &bytes, items: Items::empty(0), valid: Vec::new() };
    let (mut repetition, mut definition) = (Vec::new(), Vec::new());
    while !walk.bytes.is_empty() {
        let [repeated, defined] = walk.next()?;
        repetition.push(repeated);
        definition.push(defined);
    }
    let count = walk.items.count();
    let block = match (zipped.size, walk.items) {
        (Some(_), items) => Block::of(zipped.values.own_sizes(items)?),
        (None, Items::Variable { bytes, .. }) => zipped.values.values(&bytes, count, 0)?,
        (None, Items::Fixed { .. }) => return Err(damaged("its values are no lists")),
    };
    Ok(Leveled { block, repetition, definition })
}
