//! Pages of chunks: small parts, each decoded as a whole.

use std::ops::Range;
use std::sync::Arc;

use crate::block::{Block, Items, number};
use crate::cursor::Cursor;
use crate::error::{Result, damaged};
use crate::file::Page;
use crate::layout::Chunks;
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
    pub(super) firsts: Vec<u64>,
    pub(super) dictionary: Option<Block>,
}

/// Values of a chunk, and their levels.
#[derive(Debug)]
pub(crate) struct Chunk {
    pub(crate) block: Block,
    pub(super) repetition: Option<Vec<u16>>,
    pub(super) definition: Option<Vec<u16>>,
}

/// Adds rows.
pub(super) fn rows(
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
pub(super) fn looked_up(
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
pub(super) struct Ahead {
    bytes: Vec<u8>,
    /// Chunks that are there.
    chunks: Range<usize>,
}

impl Ahead {
    /// The bytes of the first of some chunks.
    pub(super) fn chunk(
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
pub(super) fn table<'a>(file: &dyn Bytes, page: &'a Page, layout: &Chunks) -> Result<&'a ChunkTable> {
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
pub(super) fn decode(bytes: &[u8], layout: &Chunks, items: usize) -> Result<Chunk> {
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

/// A chunk with the bytes that it holds in memory.
pub(crate) fn held(chunk: &Arc<Chunk>) -> usize {
    let levels = |levels: &Option<Vec<u16>>| levels.as_ref().map_or(0, |levels| levels.len() * 2);
    let items = match &chunk.block.items {
        Items::Fixed { bytes, .. } => bytes.len(),
        Items::Variable { offsets, bytes } => offsets.len() * size_of::<usize>() + bytes.len(),
    };
    items + levels(&chunk.repetition) + levels(&chunk.definition)
}
