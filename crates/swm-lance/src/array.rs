//! How values are coded in files of version 2.0: a tree over buffers of a page, of which any range of rows is read.

use crate::block::{Block, Items, bits as unpack_bits, marks};
use crate::codes::bits::{CHUNK, packed_bytes, unpack};
use crate::codes::fsst::Symbols;
use crate::codes::general::Scheme;
use crate::error::{Result, damaged, unsupported};
use crate::proto::{choice, fields};
use crate::store::{Bytes, Extent, read};

/// Levels of nested codes.
const MAX_DEPTH: usize = 12;
/// Entries of a dictionary, at most.
const MAX_ENTRIES: usize = 1 << 16;

/// A code of values.
#[derive(Debug)]
pub(crate) enum Array {
    Flat {
        bits: usize,
        buffer: Extent,
        scheme: Option<Scheme>,
    },
    /// Some values are missing.
    Marked {
        valid: Box<Self>,
        values: Box<Self>,
    },
    /// All are missing.
    Missing,
    Fixed {
        width: usize,
        items: Box<Self>,
    },
    Binary {
        ends: Box<Self>,
        bytes: Box<Self>,
        adjustment: u64,
    },
    FixedBinary {
        size: usize,
        bytes: Box<Self>,
    },
    /// Position 0 is of what is missing.
    Dictionary {
        positions: Box<Self>,
        entries: Box<Self>,
        count: usize,
    },
    Fsst(Symbols, Box<Self>),
    /// Numbers of fewer bits, one behind the other.
    Packed {
        bits: usize,
        size: usize,
        buffer: Extent,
        is_signed: bool,
    },
    /// As those of later versions.
    PackedChunks {
        bits: usize,
        size: usize,
        buffer: Extent,
    },
    /// Where lists end, of values in another column; so many are of this page.
    List {
        ends: Box<Self>,
        adjustment: u64,
        items: u64,
    },
    Struct,
}

/// Values, and which of them are there.
pub(crate) struct Part {
    pub(crate) block: Block,
    pub(crate) valid: Option<Vec<bool>>,
}

impl Array {
    /// `buffers` are those of the page.
    pub(crate) fn parse(message: &[u8], buffers: &[Extent]) -> Result<Self> {
        Self::parse_at(message, buffers, MAX_DEPTH)
    }

    fn parse_at(message: &[u8], buffers: &[Extent], depth: usize) -> Result<Self> {
        let depth = depth.checked_sub(1).ok_or_else(|| damaged("its encodings are nested too deeply"))?;
        let (kind, message) = choice(message)?.ok_or_else(|| damaged("an encoding is not named"))?;
        let (mut numbers, mut parts) = ([0u64; 5], [None; 5]);
        for field in fields(message) {
            let (field, value) = field?;
            let Some(at) = usize::try_from(field).ok().filter(|&at| at < 5) else { continue };
            match value {
                crate::proto::Value::Number(number) => numbers[at] = number,
                crate::proto::Value::Bytes(bytes) => parts[at] = Some(bytes),
            }
        }
        let part = |at: usize| parts[at].ok_or_else(|| damaged("a part of an encoding is missing"));
        let child = |at: usize| Self::parse_at(part(at)?, buffers, depth).map(Box::new);
        let bits = |at: usize| usize::try_from(numbers[at]).ok().filter(|&bits| bits <= 1 << 31);
        match kind {
            1 => {
                let bits = bits(1).filter(|&bits| bits == 1 || bits > 0 && bits % 8 == 0);
                let bits = bits.ok_or_else(|| unsupported(format!("values of {} bits", numbers[1])))?;
                let scheme = match parts[3] {
                    None => None,
                    Some(compression) => scheme(compression)?,
                };
                match scheme.is_some() && bits == 1 {
                    false => Ok(Self::Flat { bits, buffer: buffer(part(2)?, buffers)?, scheme }),
                    true => Err(unsupported("compressed bits")),
                }
            }
            2 => match choice(message)? {
                Some((1, message)) => Self::parse_at(only(message)?, buffers, depth),
                Some((2, message)) => {
                    let [mut valid, mut values] = [None; 2];
                    for field in fields(message) {
                        match field? {
                            (1, value) => valid = Some(value.bytes()?),
                            (2, value) => values = Some(value.bytes()?),
                            _ => {}
                        }
                    }
                    let (Some(valid), Some(values)) = (valid, values) else {
                        return Err(damaged("a part of an encoding is missing"));
                    };
                    Ok(Self::Marked {
                        valid: Box::new(Self::parse_at(valid, buffers, depth)?),
                        values: Box::new(Self::parse_at(values, buffers, depth)?),
                    })
                }
                _ => Ok(Self::Missing),
            },
            3 => {
                let width = bits(1).filter(|width| (1..=1 << 28).contains(width));
                let width = width.ok_or_else(|| damaged(format!("lists of {} values", numbers[1])))?;
                Ok(Self::Fixed { width, items: child(2)? })
            }
            4 => Ok(Self::List { ends: child(1)?, adjustment: numbers[2], items: numbers[3] }),
            5 => Ok(Self::Struct),
            6 => Ok(Self::Binary { ends: child(1)?, bytes: child(2)?, adjustment: numbers[3] }),
            7 => {
                let count = bits(3).filter(|&count| count <= MAX_ENTRIES);
                let count = count.ok_or_else(|| damaged("its dictionary is too large"))?;
                Ok(Self::Dictionary { positions: child(1)?, entries: child(2)?, count })
            }
            8 => Ok(Self::Fsst(Symbols::parse(part(2)?)?, child(1)?)),
            10 | 12 => {
                let (Some(bits @ 1..=64), Some(of @ (8 | 16 | 32 | 64))) = (bits(1), bits(2)) else {
                    return Err(unsupported(format!("{} of {} bits", numbers[1], numbers[2])));
                };
                let (size, buffer) = (of / 8, buffer(part(3)?, buffers)?);
                match (kind, bits <= of) {
                    (_, false) => Err(damaged(format!("numbers of {bits} bits in {of}"))),
                    (10, _) => Ok(Self::Packed { bits, size, buffer, is_signed: numbers[4] != 0 }),
                    _ => Ok(Self::PackedChunks { bits, size, buffer }),
                }
            }
            11 => {
                let size = bits(2).filter(|&size| size > 0);
                Ok(Self::FixedBinary {
                    size: size.ok_or_else(|| damaged("bytes of no size"))?,
                    bytes: child(1)?,
                })
            }
            other => {
                let name = match other {
                    9 => "PackedStruct",
                    13 => "Constant",
                    14 => "InlineBitpacking",
                    15 => "OutOfLineBitpacking",
                    _ => "unknown",
                };
                Err(unsupported(format!("the encoding {name} (number {other}) of files 2.0 is not read")))
            }
        }
    }

    /// Values from one on; `leaf` has the size of an item and the items of a value, for those that are all missing.
    pub(crate) fn read(
        &self,
        file: &dyn Bytes,
        first: u64,
        count: usize,
        leaf: (usize, usize),
    ) -> Result<Part> {
        let all = |block| Ok(Part { block, valid: None });
        match self {
            Self::Flat { bits, buffer, scheme } => all(flat(file, (*bits, *buffer, *scheme), first, count)?),
            Self::Missing => {
                let (size, width) = leaf;
                let mut items = Items::empty(size);
                items.push_zeros(count * width);
                Ok(Part { block: Block { items, valid: None, width }, valid: Some(vec![false; count]) })
            }
            Self::Marked { valid, values } => {
                let marks = valid.read(file, first, count, (1, 1))?.block;
                let Items::Fixed { size: 1, bytes } = marks.items else {
                    return Err(damaged("its marks of missing values are no bits"));
                };
                let Part { block, valid } = values.read(file, first, count, leaf)?;
                let both = bytes
                    .iter()
                    .enumerate()
                    .map(|(at, &mark)| mark == 1 && valid.as_ref().is_none_or(|valid| valid[at]));
                Ok(Part { block, valid: Some(both.collect()) })
            }
            Self::Fixed { width, items } => {
                let (inner, wide) = count
                    .checked_mul(*width)
                    .zip(first.checked_mul(*width as u64))
                    .ok_or_else(|| damaged("lists have too many values"))?;
                let leaf = (leaf.0, leaf.1 / width);
                let Part { block, valid } = items.read(file, wide, inner, leaf)?;
                all(block.widened(*width, valid)?)
            }
            Self::Binary { ends, bytes, adjustment } => {
                binary(file, (ends, bytes, *adjustment), first, count)
            }
            Self::FixedBinary { size, bytes } => {
                let items = count.checked_mul(*size).zip(first.checked_mul(*size as u64));
                let (count_of_bytes, first) = items.ok_or_else(|| damaged("its bytes are too many"))?;
                let Items::Fixed { size: 1, bytes } =
                    bytes.read(file, first, count_of_bytes, (1, 1))?.block.items
                else {
                    return Err(damaged("its bytes are none"));
                };
                let offsets = (0..=count).map(|at| at * size).collect();
                all(Block::of(Items::Variable { offsets, bytes }))
            }
            Self::Dictionary { positions, entries, count: entries_count } => {
                let positions = positions.read(file, first, count, (1, 1))?.block.numbers()?;
                let entries = entries.read(file, 0, *entries_count, leaf)?;
                let mut items = Items::empty(entries.block.items.size());
                let mut valid = Vec::with_capacity(positions.len());
                for position in positions {
                    let at = usize::try_from(position).unwrap_or(usize::MAX).checked_sub(1);
                    valid.push(at.is_some());
                    match at {
                        None => items.push_zeros(1),
                        Some(at) => {
                            let entry = entries.block.items.get(at);
                            let missing = || damaged(format!("its dictionary has no entry {position}"));
                            items.push(entry.ok_or_else(missing)?);
                        }
                    }
                }
                Ok(Part { block: Block::of(items), valid: Some(valid) })
            }
            Self::Fsst(symbols, values) => {
                let Part { block, valid } = values.read(file, first, count, leaf)?;
                Ok(Part { block: Block::of(symbols.decode(block.items)?), valid })
            }
            Self::Packed { bits, size, buffer, is_signed } => {
                let from =
                    first.checked_mul(*bits as u64).ok_or_else(|| damaged("its positions are too large"))?;
                let end = from
                    .checked_add((count * bits) as u64)
                    .ok_or_else(|| damaged("its positions are too large"))?;
                let bytes = read(file, buffer.part(from / 8, end.div_ceil(8) - from / 8)?)?;
                let mut out = Vec::new();
                for at in 0..count {
                    let value = unpack_bits(&bytes, (from % 8) as usize + at * bits, *bits);
                    let value = value.iter().rev().fold(0u64, |value, &bit| value << 1 | u64::from(bit));
                    let is_negative = *is_signed && value >> (bits - 1) == 1;
                    let sign = if is_negative && *bits < 64 { u64::MAX << bits } else { 0 };
                    out.extend_from_slice(&(value | sign).to_le_bytes()[..*size]);
                }
                all(Block::fixed(*size, out))
            }
            Self::PackedChunks { bits, size, buffer } => {
                let mut out = Vec::new();
                let (mut at, end) = (first, first + count as u64);
                while at < end {
                    let (chunk, skip) = (at / CHUNK as u64, (at % CHUNK as u64) as usize);
                    let take = (CHUNK - skip).min((end - at) as usize);
                    let bytes = packed_bytes(*bits) as u64;
                    let from =
                        chunk.checked_mul(bytes).ok_or_else(|| damaged("its positions are too large"))?;
                    let packed = read(file, buffer.part(from, bytes)?)?;
                    let mut values = Vec::new();
                    unpack(*size, *bits, &packed, skip + take, &mut values)?;
                    out.extend_from_slice(&values[skip * size..]);
                    at += take as u64;
                }
                all(Block::fixed(*size, out))
            }
            Self::List { .. } => Err(damaged("its values are lists, which was not expected")),
            Self::Struct => Err(damaged("it has no values")),
        }
    }

    /// Of a page of lists: where each ends in the values of the page, and whether it is there.
    pub(crate) fn lists(&self, file: &dyn Bytes, count: usize) -> Result<Vec<(u64, bool)>> {
        let Self::List { ends, adjustment, .. } = self else {
            return Err(damaged("its values are no lists"));
        };
        let ends = ends.read(file, 0, count, (8, 1))?.block.numbers()?;
        adjusted(&ends, *adjustment)
    }
}

/// Ends of values; an addition marks those of missing values.
fn adjusted(ends: &[u64], adjustment: u64) -> Result<Vec<(u64, bool)>> {
    let mut last = 0;
    let split = |&end: &u64| match end >= adjustment {
        true => (end - adjustment, false),
        false => (end, true),
    };
    let ends: Vec<(u64, bool)> = ends.iter().map(split).collect();
    for &(end, _) in &ends {
        if end < last {
            return Err(damaged("ends of values are not in order"));
        }
        last = end;
    }
    Ok(ends)
}

fn flat(
    file: &dyn Bytes,
    (bits, buffer, scheme): (usize, Extent, Option<Scheme>),
    first: u64,
    count: usize,
) -> Result<Block> {
    let too_large = || damaged("its positions are too large");
    if bits == 1 {
        let end = first.checked_add(count as u64).ok_or_else(too_large)?;
        let bytes = read(file, buffer.part(first / 8, end.div_ceil(8) - first / 8)?)?;
        let skip = (first % 8) as usize;
        let bits = marks(&bytes, skip, count)?.into_iter().map(u8::from).collect();
        return Ok(Block::fixed(1, bits));
    }
    let size = bits / 8;
    let from = first.checked_mul(size as u64).ok_or_else(too_large)?;
    let bytes = (count as u64).checked_mul(size as u64).ok_or_else(too_large)?;
    let values = match scheme {
        None => read(file, buffer.part(from, bytes)?)?,
        Some(scheme) => {
            let decoded = scheme.decode(&read(file, buffer)?)?;
            let range = Extent { at: 0, size: decoded.len() as u64 }.part(from, bytes)?;
            decoded[range.at as usize..][..range.size as usize].to_vec()
        }
    };
    Ok(Block::fixed(size, values))
}

fn binary(
    file: &dyn Bytes,
    (ends, bytes, adjustment): (&Array, &Array, u64),
    first: u64,
    count: usize,
) -> Result<Part> {
    let before = first.min(1);
    let found = ends.read(file, first - before, count + before as usize, (8, 1))?.block.numbers()?;
    let mut ends = adjusted(&found, adjustment)?;
    let start = if before == 1 && !ends.is_empty() { ends.remove(0).0 } else { 0 };
    let last = ends.last().map_or(start, |&(end, _)| end);
    let size = usize::try_from(last - start).map_err(|_| damaged("its bytes are too many"))?;
    let bytes = match size {
        0 => Vec::new(),
        size => match bytes.read(file, start, size, (1, 1))?.block.items {
            Items::Fixed { size: 1, bytes } => bytes,
            _ => return Err(damaged("its bytes are none")),
        },
    };
    let offsets = std::iter::once(0).chain(ends.iter().map(|&(end, _)| (end - start) as usize)).collect();
    let valid = ends.iter().map(|&(_, is_valid)| is_valid).collect();
    Ok(Part { block: Block::of(Items::Variable { offsets, bytes }), valid: Some(valid) })
}

/// The only field of a message.
fn only(message: &[u8]) -> Result<&[u8]> {
    let (_, part) = choice(message)?.ok_or_else(|| damaged("a part of an encoding is missing"))?;
    Ok(part)
}

fn buffer(message: &[u8], buffers: &[Extent]) -> Result<Extent> {
    let (mut index, mut place) = (0, 0);
    for field in fields(message) {
        match field? {
            (1, value) => index = value.small()?,
            (2, value) => place = value.small()?,
            _ => {}
        }
    }
    if place != 0 {
        return Err(unsupported("buffers outside of pages"));
    }
    let buffer = buffers.get(index as usize);
    buffer.copied().ok_or_else(|| damaged(format!("the page has no buffer {index}")))
}

fn scheme(message: &[u8]) -> Result<Option<Scheme>> {
    for field in fields(message) {
        if let (1, name) = field? {
            return Scheme::named(&name.text()?);
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::Memory;

    #[test]
    fn packed_numbers_are_read_from_any_bit() {
        // 5 bits each: 3, -1, 10, -16.
        let bits = 0b10000_01010_11111_00011u32.to_le_bytes();
        let file = Memory(bits[..3].to_vec());
        let packed =
            |is_signed| Array::Packed { bits: 5, size: 2, buffer: Extent { at: 0, size: 3 }, is_signed };
        let values = |array: &Array, first, count| {
            let numbers = array.read(&file, first, count, (2, 1)).unwrap().block.numbers().unwrap();
            numbers.into_iter().map(|number| number as u16 as i16).collect::<Vec<_>>()
        };
        assert_eq!(values(&packed(true), 0, 4), [3, -1, 10, -16]);
        assert_eq!(values(&packed(true), 1, 2), [-1, 10]);
        assert_eq!(values(&packed(false), 2, 2), [10, 16]);
        assert!(packed(true).read(&file, 3, 3, (2, 1)).is_err());
    }

    #[test]
    fn missing_values_have_marked_ends() {
        assert_eq!(adjusted(&[2, 9, 2, 5], 7).unwrap(), [(2, true), (2, false), (2, true), (5, true)]);
        assert!(adjusted(&[2, 1], 7).is_err());
    }
}
