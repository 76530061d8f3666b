//! Reading rows of a page of a file since version 2.1.

use std::ops::Range;
use std::sync::Arc;

use crate::block::{Block, Items, number};
use crate::cursor::Cursor;
use crate::error::{Result, damaged};
use crate::file::Page;
use crate::kind::Kind;
use crate::layout::{Chunks, Constant, Layout, Levels, Zipped};
use crate::store::{Bytes, Extent, read};
use crate::values::Values;

/// What parts of a chunk, and chunks, are aligned to.
const ALIGNMENT: usize = 8;
/// Values of a chunk.
const MAX_CHUNK: u64 = 1 << 15;
/// Bytes that are read at once, where several chunks are.
const READ_AHEAD: u64 = 1 << 20;

/// Where the chunks of a page are, and its dictionary.
#[derive(Debug)]
pub(crate) struct ChunkTable {
    /// Positions in the buffer of values; the last one is the end.
    starts: Vec<u64>,
    /// The first value of each; the last one is the end.
    firsts: Vec<u64>,
    dictionary: Option<Block>,
}

/// Values of a chunk, and their levels.
#[derive(Debug)]
pub(crate) struct Chunk {
    pub(crate) block: Block,
    repetition: Option<Vec<u16>>,
    definition: Option<Vec<u16>>,
}

/// Levels of a page, and the values that are there or missing in it.
struct Leveled {
    block: Block,
    repetition: Vec<u16>,
    definition: Vec<u16>,
}

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
        return lists(file, page, layout, kind, rows, cursor, out);
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
        Layout::Chunks(chunks) => from_chunks(file, page, chunks, rows, cursor, out),
        Layout::Constant(constant) => from_constant(file, page, constant, kind, rows, out),
        Layout::Zipped(zipped) => from_zipped(file, page, zipped, rows, out),
    }
}

fn from_chunks(
    file: &dyn Bytes,
    page: &Page,
    layout: &Chunks,
    rows: Range<u64>,
    cursor: &mut Cursor,
    out: &mut Values,
) -> Result<()> {
    let table = table(file, page, layout)?;
    let mut at = rows.start;
    let mut ahead = Ahead::default();
    let end_chunk = table.firsts.partition_point(|&first| first < rows.end);
    while at < rows.end {
        let index = table.firsts.partition_point(|&first| first <= at).checked_sub(1);
        let index = index
            .filter(|&index| index + 1 < table.firsts.len())
            .ok_or_else(|| damaged("it has fewer values than rows"))?;
        let chunk = match cursor.chunk(page.key, index) {
            Some(chunk) => chunk,
            None => {
                let bytes = ahead.chunk(file, page.buffers[1], table, index..end_chunk)?;
                let chunk = decode(bytes, layout, (table.firsts[index + 1] - table.firsts[index]) as usize)?;
                cursor.keep(page.key, index, chunk)
            }
        };
        let (first, end) = (table.firsts[index], table.firsts[index + 1].min(rows.end));
        let range = (at - first) as usize..(end - first) as usize;
        let valid = match &chunk.definition {
            None => None,
            Some(levels) => {
                let levels = levels
                    .get(range.clone())
                    .ok_or_else(|| damaged("a chunk has fewer levels than values"))?;
                Some(levels.iter().map(|&level| level == 0).collect::<Vec<_>>())
            }
        };
        match &table.dictionary {
            None => out.push(&chunk.block, range, valid.as_deref())?,
            Some(dictionary) => {
                let block = looked_up(dictionary, &chunk.block, range.clone(), valid.as_deref())?;
                out.push(&block, 0..range.len(), valid.as_deref())?;
            }
        }
        at = end;
    }
    Ok(())
}

/// Values of a dictionary; those that are missing have any position.
fn looked_up(
    dictionary: &Block,
    positions: &Block,
    range: Range<usize>,
    valid: Option<&[bool]>,
) -> Result<Block> {
    let mut part = Items::empty(positions.items.size());
    part.extend(&positions.items, range)?;
    let positions = Block::of(part).numbers()?;
    let mut items = Items::empty(dictionary.items.size());
    let mut marks = dictionary.valid.as_ref().map(|_| Vec::new());
    for (row, position) in positions.into_iter().enumerate() {
        let is_valid = valid.is_none_or(|valid| valid[row]);
        let at = usize::try_from(position).ok().filter(|&at| at < dictionary.count());
        match at {
            Some(at) => {
                let range = at * dictionary.width..(at + 1) * dictionary.width;
                if let (Some(marks), Some(valid)) = (&mut marks, &dictionary.valid) {
                    marks.extend_from_slice(&valid[range.clone()]);
                }
                items.extend(&dictionary.items, range)?;
            }
            None if is_valid => {
                return Err(damaged(format!(
                    "its dictionary of {} values has none at {position}",
                    dictionary.count()
                )));
            }
            None => {
                items.push_zeros(dictionary.width);
                marks.iter_mut().for_each(|marks| marks.resize(marks.len() + dictionary.width, true));
            }
        }
    }
    Ok(Block { items, valid: marks, width: dictionary.width })
}

/// Bytes of chunks that are read together.
#[derive(Default)]
struct Ahead {
    bytes: Vec<u8>,
    /// Chunks that are there.
    chunks: Range<usize>,
}

impl Ahead {
    /// The bytes of the first of some chunks.
    fn chunk(
        &mut self,
        file: &dyn Bytes,
        buffer: Extent,
        table: &ChunkTable,
        chunks: Range<usize>,
    ) -> Result<&[u8]> {
        let index = chunks.start;
        let start = table.starts[index];
        if !self.chunks.contains(&index) {
            let last = chunks.end.min(table.starts.len() - 1).max(index + 1);
            let end = (index + 1..=last)
                .rev()
                .find(|&end| end == index + 1 || table.starts[end] - start <= READ_AHEAD);
            let end = end.unwrap_or(index + 1);
            self.bytes = read(file, buffer.part(start, table.starts[end] - start)?)?;
            self.chunks = index..end;
        }
        let base = table.starts[self.chunks.start];
        let range = (start - base) as usize..(table.starts[index + 1] - base) as usize;
        self.bytes.get(range).ok_or_else(|| damaged("its chunks are cut"))
    }
}

/// The table of a page, which is read once.
fn table<'a>(file: &dyn Bytes, page: &'a Page, layout: &Chunks) -> Result<&'a ChunkTable> {
    if let Some(table) = page.chunks.get() {
        return Ok(table);
    }
    let [words, values, ..] = page.buffers[..] else {
        return Err(damaged("a page of chunks has too few buffers"));
    };
    let bytes = read(file, words)?;
    let size = if layout.is_large { 4 } else { 2 };
    if bytes.len() % size != 0 {
        return Err(damaged("its table of chunks is cut"));
    }
    let (mut starts, mut firsts) = (vec![0], vec![0]);
    let (mut start, mut first) = (0, 0u64);
    let count = bytes.len() / size;
    for (index, word) in bytes.chunks_exact(size).enumerate() {
        let word = number(word);
        start += ((word >> 4) + 1) * ALIGNMENT as u64;
        let left =
            layout.items.checked_sub(first).ok_or_else(|| damaged("its chunks have too many values"))?;
        let here = match word & 0xf {
            0 if index + 1 == count => left,
            0 => return Err(damaged("a chunk that is not the last one has no number of values")),
            log => 1 << log,
        };
        if here > left || here > MAX_CHUNK || index + 1 == count && here != left {
            return Err(damaged(format!("chunk {index} has {here} values, of {left} that are left")));
        }
        first += here;
        starts.push(start);
        firsts.push(first);
    }
    if first != layout.items || start > values.size {
        return Err(damaged(format!(
            "its chunks have {first} values in {start} bytes, of {} in {}",
            layout.items, values.size
        )));
    }
    let dictionary = match &layout.dictionary {
        None => None,
        Some((code, count)) => {
            let buffer = page.buffers.get(2).ok_or_else(|| damaged("its dictionary is missing"))?;
            Some(code.block(&read(file, *buffer)?, *count)?)
        }
    };
    Ok(page.chunks.get_or_init(|| ChunkTable { starts, firsts, dictionary }))
}

/// A chunk: sizes of its parts, levels, buffers of values.
fn decode(bytes: &[u8], layout: &Chunks, items: usize) -> Result<Chunk> {
    let mut at = 0;
    let mut head = |size: usize| {
        let part = bytes.get(at..at + size).ok_or_else(|| damaged("a chunk is cut"))?;
        at += size;
        Ok::<_, crate::LanceError>(number(part) as usize)
    };
    let count = head(2)?;
    let level_sizes = [&layout.repetition, &layout.definition].map(|code| code.as_ref().map(|_| head(2)));
    let size = if layout.is_large { 4 } else { 2 };
    let sizes = (0..layout.buffers).map(|_| head(size)).collect::<Result<Vec<_>>>()?;
    let mut part = |size: usize| {
        at = at.next_multiple_of(ALIGNMENT);
        let part =
            bytes.get(at..).and_then(|bytes| bytes.get(..size)).ok_or_else(|| damaged("a chunk is cut"))?;
        at += size;
        Ok::<_, crate::LanceError>(part)
    };
    let [repetition, definition] = level_sizes.map(|size| size.map(|size| part(size?)));
    let (repetition, definition) = (repetition.transpose()?, definition.transpose()?);
    let buffers = sizes.into_iter().map(part).collect::<Result<Vec<_>>>()?;
    let levels = |code: &Option<crate::codes::Code>, bytes: Option<&[u8]>| match (code, bytes) {
        (Some(code), Some(bytes)) => code.levels(bytes, count).map(Some),
        _ => Ok(None),
    };
    Ok(Chunk {
        block: layout.values.chunk(&buffers, items)?,
        repetition: levels(&layout.repetition, repetition)?,
        definition: levels(&layout.definition, definition)?,
    })
}

/// The value that all have.
fn scalar(file: &dyn Bytes, page: &Page, constant: &Constant, kind: &Kind) -> Result<Option<Items>> {
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
fn constant_levels(file: &dyn Bytes, page: &Page, constant: &Constant) -> Result<[Option<Vec<u16>>; 2]> {
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

fn from_constant(
    file: &dyn Bytes,
    page: &Page,
    constant: &Constant,
    kind: &Kind,
    rows: Range<u64>,
    out: &mut Values,
) -> Result<()> {
    let count = (rows.end - rows.start) as usize;
    let Some(scalar) = scalar(file, page, constant, kind)? else { return out.push_missing(count) };
    let [_, definition] = constant_levels(file, page, constant)?;
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

fn from_zipped(
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
struct Walk<'a> {
    zipped: &'a Zipped,
    bytes: &'a [u8],
    /// What is there or missing.
    items: Items,
    valid: Vec<bool>,
}

impl<'a> Walk<'a> {
    fn take(&mut self, size: usize) -> Result<&'a [u8]> {
        let (head, rest) = self.bytes.split_at_checked(size).ok_or_else(|| damaged("its values are cut"))?;
        self.bytes = rest;
        Ok(head)
    }

    /// The levels of the next value, which is added if it is there or missing.
    fn next(&mut self) -> Result<[u16; 2]> {
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

/// Adds rows that are lists. The page is decoded as a whole: a list may be in several chunks.
fn lists(
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
            let [repetition, definition] = constant_levels(file, page, constant)?;
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

/// A chunk with the bytes that it holds in memory.
pub(crate) fn held(chunk: &Arc<Chunk>) -> usize {
    let levels = |levels: &Option<Vec<u16>>| levels.as_ref().map_or(0, |levels| levels.len() * 2);
    let items = match &chunk.block.items {
        Items::Fixed { bytes, .. } => bytes.len(),
        Items::Variable { offsets, bytes } => offsets.len() * size_of::<usize>() + bytes.len(),
    };
    items + levels(&chunk.repetition) + levels(&chunk.definition)
}
