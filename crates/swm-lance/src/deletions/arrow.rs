//! The only column of a file of Arrow: integers of 32 bits. Its descriptions are tables of FlatBuffers, read by position.

use crate::block::number;
use crate::codes::Scheme;
use crate::error::{Result, damaged, unsupported};

const MAGIC: &[u8] = b"ARROW1";
/// Behind the description of a file: its size, and the magic number.
const ENDING: usize = 4 + MAGIC.len();
/// What a message begins with, but those of the first writers.
const CONTINUED: u64 = 0xffff_ffff;
/// The place of a record batch in the file: position, size of its description, size of its buffers.
const BLOCK: usize = 24;
/// Rows of a column and how many are missing; position and size of a buffer.
const PAIR: usize = 16;
/// Numbers of kinds, as the format has them.
const RECORD_BATCH: u64 = 3;
const INTEGERS: u64 = 2;
const ZSTD: u64 = 1;
/// The size of a compressed buffer that is not compressed after all.
const PLAIN: u64 = u64::MAX;

/// The numbers of a file, of which there are at most `most`.
pub(super) fn numbers(file: &[u8], most: u64) -> Result<Vec<u32>> {
    let Some(end) =
        file.len().checked_sub(ENDING).filter(|_| file.starts_with(MAGIC) && file.ends_with(MAGIC))
    else {
        return Err(damaged("it is no file of Arrow, or cut"));
    };
    let size = number(&file[end..end + 4]);
    let start = usize::try_from(size).ok().and_then(|size| end.checked_sub(size));
    let footer = Table::root(&file[start.ok_or_else(|| damaged("it is cut"))?..end])?;
    check_schema(&footer)?;
    let mut all = Vec::new();
    for block in footer.structs(3, BLOCK)? {
        let (at, described, size) = (number(&block[..8]), number(&block[8..12]), number(&block[16..24]));
        let head = part(file, at, described)?;
        let buffers = part(file, at.saturating_add(described), size)?;
        // Of a message, the first 4 or 8 bytes are its size.
        let skipped = if head.get(..4).map(number) == Some(CONTINUED) { 8 } else { 4 };
        let message = Table::root(head.get(skipped..).unwrap_or_default())?;
        match (message.number(1, 1)?, message.table(2)?) {
            (RECORD_BATCH, Some(batch)) => batch_numbers(&batch, buffers, most, &mut all)?,
            _ => return Err(damaged("a part of it is no record batch")),
        }
    }
    Ok(all)
}

fn check_schema(footer: &Table<'_>) -> Result<()> {
    let schema = footer.table(1)?.ok_or_else(|| damaged("it has no schema"))?;
    if schema.number(0, 2)? != 0 {
        return Err(unsupported("its numbers are big-endian"));
    }
    let [Some(field), None] = [schema.table_of(1, 0)?, schema.table_of(1, 1)?] else {
        return Err(damaged("it has not one column"));
    };
    match (field.number(2, 1)?, field.table(3)?) {
        (INTEGERS, Some(kind)) if kind.number(0, 4)? == 32 => Ok(()),
        _ => Err(damaged("its column has no integers of 32 bits")),
    }
}

fn batch_numbers(batch: &Table<'_>, bytes: &[u8], most: u64, all: &mut Vec<u32>) -> Result<()> {
    let rows = batch.number(0, 8)?;
    if rows > most.saturating_sub(all.len() as u64) {
        return Err(damaged(format!("it lists more than the {most} rows that there are")));
    }
    match batch.structs(1, PAIR)?.next() {
        Some(column) if number(&column[..8]) == rows && number(&column[8..]) == 0 => {}
        _ => return Err(damaged("its column is of another length, or values of it are missing")),
    }
    // The first buffer has the bits of missing values.
    let Some(buffer) = batch.structs(2, PAIR)?.nth(1) else {
        return Err(damaged("its column has no values"));
    };
    let values = part(bytes, number(&buffer[..8]), number(&buffer[8..]))?;
    let decoded;
    let values = match batch.table(3)? {
        None => values,
        Some(compression) => match (compression.number(0, 1)?, values.split_first_chunk()) {
            (_, Some((&size, plain))) if u64::from_le_bytes(size) == PLAIN => plain,
            (ZSTD, Some((&size, _))) if u64::from_le_bytes(size) == rows * 4 => {
                decoded = Scheme::Zstd.decode(values)?;
                &decoded
            }
            (ZSTD, _) => return Err(damaged("its values are of another size")),
            (other, _) => return Err(unsupported(format!("a compression of Arrow with the number {other}"))),
        },
    };
    // Buffers may be longer, up to a border.
    let values = values.get(..rows as usize * 4).ok_or_else(|| damaged("its values are cut"))?;
    all.extend(values.chunks_exact(4).map(|value| number(value) as u32));
    Ok(())
}

/// A part of bytes.
fn part(bytes: &[u8], at: u64, size: u64) -> Result<&[u8]> {
    let range = usize::try_from(at).ok().zip(usize::try_from(at.saturating_add(size)).ok());
    range.and_then(|(at, end)| bytes.get(at..end)).ok_or_else(|| damaged("a part of it is beyond its end"))
}

/// A table of FlatBuffers: its first number is the distance to the list of where its fields are.
struct Table<'a> {
    bytes: &'a [u8],
    at: u64,
    fields: &'a [u8],
}

impl<'a> Table<'a> {
    /// The table to which the first number of a buffer points.
    fn root(bytes: &'a [u8]) -> Result<Self> {
        Self::at(bytes, number(part(bytes, 0, 4)?))
    }

    fn at(bytes: &'a [u8], at: u64) -> Result<Self> {
        let distance = number(part(bytes, at, 4)?) as u32 as i32;
        let list = at
            .checked_add_signed(-i64::from(distance))
            .ok_or_else(|| damaged("a table is beyond its start"))?;
        let size = number(part(bytes, list, 2)?);
        // Its own size and that of the table come first.
        let fields = part(bytes, list, size)?.get(4..).ok_or_else(|| damaged("a table has no fields"))?;
        Ok(Self { bytes, at, fields })
    }

    /// Where a field is, if the table has it.
    fn place(&self, index: usize) -> Option<u64> {
        let distance = number(self.fields.get(index * 2..index * 2 + 2)?);
        (distance != 0).then_some(self.at + distance)
    }

    /// A number of some bytes; 0 where it is left out.
    fn number(&self, index: usize, size: u64) -> Result<u64> {
        self.place(index).map_or(Ok(0), |at| Ok(number(part(self.bytes, at, size)?)))
    }

    /// Where a field points to.
    fn target(&self, index: usize) -> Result<Option<u64>> {
        let Some(at) = self.place(index) else { return Ok(None) };
        Ok(Some(at + number(part(self.bytes, at, 4)?)))
    }

    fn table(&self, index: usize) -> Result<Option<Self>> {
        self.target(index)?.map(|at| Self::at(self.bytes, at)).transpose()
    }

    /// A table of a list of them.
    fn table_of(&self, index: usize, item: u64) -> Result<Option<Self>> {
        let Some(at) = self.target(index)? else { return Ok(None) };
        if item >= number(part(self.bytes, at, 4)?) {
            return Ok(None);
        }
        let at = at + 4 + item * 4;
        Self::at(self.bytes, at + number(part(self.bytes, at, 4)?)).map(Some)
    }

    /// A list of structures of one size.
    fn structs(&self, index: usize, size: usize) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>> {
        let list = match self.target(index)? {
            None => &[],
            Some(at) => part(self.bytes, at + 4, number(part(self.bytes, at, 4)?) * size as u64)?,
        };
        Ok(list.chunks_exact(size))
    }
}
