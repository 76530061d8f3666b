//! How values are coded in files since version 2.1: a tree, which describes buffers. The same code has up to three forms: chunks (small
//! parts of a page, each decoded as a whole), blocks (one buffer that is a whole, such as a dictionary), and single values (large ones,
//! of which each is decoded by itself).

pub(crate) mod bits;
pub(crate) mod fsst;
pub(crate) mod general;
mod rle;

use self::fsst::Symbols;
pub(crate) use self::general::Scheme;
use crate::block::{Block, Items, bits as unpack_bits, marks, number};
use crate::error::{Result, damaged, unsupported};
use crate::proto::{choice, fields};

/// Levels of nested codes.
const MAX_DEPTH: usize = 10;
/// Values of a code of a column in one call: what a chunk has at most, and a dictionary or level of a page.
const MAX_VALUES: usize = 1 << 26;

/// A code of values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Code {
    /// So many bits of each value, one behind the other.
    Flat(usize),
    /// Offsets of so many bytes, and bytes.
    Variable(usize),
    /// A value that all have; `None`: they are missing.
    Constant(Option<Vec<u8>>),
    /// Words of so many bytes, packed in fewer bits.
    OutOfLine {
        size: usize,
        bits: usize,
    },
    /// Words of so many bytes; each chunk has the number of its bits.
    Inline(usize),
    Fsst(Symbols, Box<Self>),
    Runs {
        values: Box<Self>,
        lengths: Box<Self>,
    },
    /// The first bytes of all values, then the second ones: so many bytes of each.
    Split(usize),
    General(Scheme, Box<Self>),
    /// As many values in each.
    Fixed {
        width: usize,
        has_marks: bool,
        items: Box<Self>,
    },
}

impl Code {
    pub(crate) fn parse(message: &[u8]) -> Result<Self> {
        Self::parse_at(message, MAX_DEPTH)
    }

    fn parse_at(message: &[u8], depth: usize) -> Result<Self> {
        let depth = depth.checked_sub(1).ok_or_else(|| damaged("its encodings are nested too deeply"))?;
        let (kind, message) = choice(message)?.ok_or_else(|| damaged("an encoding is not named"))?;
        let mut numbers = [0u64; 8];
        let mut parts: [Option<&[u8]>; 8] = [None; 8];
        for field in fields(message) {
            let (field, value) = field?;
            let Some(at) = usize::try_from(field).ok().filter(|&at| at < 8) else { continue };
            match value {
                crate::proto::Value::Number(number) => numbers[at] = number,
                crate::proto::Value::Bytes(bytes) => parts[at] = Some(bytes),
            }
        }
        let part = |at: usize| parts[at].ok_or_else(|| damaged("a part of an encoding is missing"));
        let child = |at: usize| Self::parse_at(part(at)?, depth).map(Box::new);
        let plain = |at: usize| match parts[at] {
            None => Ok(()),
            Some(_) => Err(unsupported("buffers inside of an encoding are compressed")),
        };
        match kind {
            1 => {
                plain(2)?;
                let bits =
                    usize::try_from(numbers[1]).ok().filter(|&bits| bits == 1 || bits > 0 && bits % 8 == 0);
                let bits = bits.filter(|&bits| bits <= 1 << 31);
                Ok(Self::Flat(bits.ok_or_else(|| unsupported(format!("values of {} bits", numbers[1])))?))
            }
            2 => {
                plain(2)?;
                match *child(1)? {
                    Self::Flat(bits @ (32 | 64)) => Ok(Self::Variable(bits / 8)),
                    other => Err(unsupported(format!("the encoding {} of offsets", other.name()))),
                }
            }
            3 => Ok(Self::Constant(parts[1].map(<[u8]>::to_vec))),
            4 => Ok(Self::OutOfLine { size: word(numbers[1])?, bits: packed_bits(part(3)?)? }),
            5 => {
                plain(2)?;
                Ok(Self::Inline(word(numbers[1])?))
            }
            6 => match *child(2)? {
                values @ Self::Variable(_) => Ok(Self::Fsst(Symbols::parse(part(1)?)?, Box::new(values))),
                other => Err(unsupported(format!("the encoding {} inside of FSST", other.name()))),
            },
            8 => Ok(Self::Runs { values: child(1)?, lengths: child(2)? }),
            9 => match *child(1)? {
                Self::Flat(bits @ (32 | 64)) => Ok(Self::Split(bits / 8)),
                other => Err(unsupported(format!("the encoding {} of split bytes", other.name()))),
            },
            10 => {
                let scheme = fields(part(1)?).find_map(|field| match field {
                    Ok((1, value)) => Some(value.number()),
                    _ => None,
                });
                Ok(Self::General(Scheme::numbered(scheme.unwrap_or(Ok(0))?)?, child(3)?))
            }
            11 => {
                let width = usize::try_from(numbers[1]).ok().filter(|width| (1..=1 << 28).contains(width));
                let width = width.ok_or_else(|| damaged(format!("lists of {} values", numbers[1])))?;
                let items = child(2)?;
                let of_all = items.width().checked_mul(width).filter(|&of_all| of_all <= 1 << 28);
                of_all.ok_or_else(|| damaged("lists have more values than can be counted"))?;
                Ok(Self::Fixed { width, has_marks: numbers[3] != 0, items })
            }
            other => {
                let name = match other {
                    7 => "Dictionary",
                    12 => "PackedStruct",
                    13 => "VariablePackedStruct",
                    14 => "Range",
                    15 => "Delta",
                    _ => "unknown",
                };
                Err(unsupported(format!("the encoding {name} (number {other}) is not read")))
            }
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Flat(_) => "Flat",
            Self::Variable(_) => "Variable",
            Self::Constant(_) => "Constant",
            Self::OutOfLine { .. } => "OutOfLineBitpacking",
            Self::Inline(_) => "InlineBitpacking",
            Self::Fsst(..) => "Fsst",
            Self::Runs { .. } => "Rle",
            Self::Split(_) => "ByteStreamSplit",
            Self::General(..) => "General",
            Self::Fixed { .. } => "FixedSizeList",
        }
    }

    /// Items of a value.
    fn width(&self) -> usize {
        match self {
            Self::Fixed { width, items, .. } => width * items.width(),
            _ => 1,
        }
    }

    /// Bytes of a value that is an integer.
    fn word(&self) -> Result<usize> {
        match self {
            Self::Flat(bits @ (8 | 16 | 32 | 64)) => Ok(bits / 8),
            Self::OutOfLine { size, .. } => Ok(*size),
            Self::General(_, values) => values.word(),
            other => Err(unsupported(format!("the encoding {} of runs", other.name()))),
        }
    }

    /// The bytes of values whose number need not be known.
    fn plain(&self, bytes: &[u8]) -> Result<Option<Vec<u8>>> {
        match self {
            Self::Flat(_) => Ok(Some(bytes.to_vec())),
            Self::General(scheme, values) if matches!(**values, Self::Flat(_)) => {
                Ok(Some(scheme.decode(bytes)?))
            }
            _ => Ok(None),
        }
    }

    fn refused<T>(&self, form: &str) -> Result<T> {
        Err(unsupported(format!("the encoding {} of {form} is not read", self.name())))
    }

    /// The values of a chunk.
    pub(crate) fn chunk(&self, buffers: &[&[u8]], count: usize) -> Result<Block> {
        check(count)?;
        let one = || match buffers {
            [one] => Ok(*one),
            _ => Err(damaged(format!("a chunk has {} buffers, and {} has one", buffers.len(), self.name()))),
        };
        match self {
            Self::Flat(bits) => flat(*bits, one()?, count),
            Self::Variable(size) => variable(*size, one()?, 0, count),
            Self::Inline(size) => Ok(Block::fixed(*size, bits::inline(*size, one()?, count)?)),
            Self::Fsst(symbols, values) => {
                Ok(Block::of(symbols.decode(values.chunk(buffers, count)?.items)?))
            }
            Self::Runs { values, lengths } => match *buffers {
                [stored, stored_lengths] => rle::decode(values, lengths, [stored, stored_lengths], count),
                _ => Err(damaged("runs have two buffers")),
            },
            Self::Split(size) => split(*size, one()?, count),
            Self::General(scheme, values) => {
                let (&first, rest) =
                    buffers.split_first().ok_or_else(|| damaged("a chunk has no buffers"))?;
                let decoded = scheme.decode(first)?;
                let buffers: Vec<&[u8]> = std::iter::once(&decoded[..]).chain(rest.iter().copied()).collect();
                values.chunk(&buffers, count)
            }
            Self::Fixed { width, has_marks, items } => {
                let inner = count.checked_mul(*width).ok_or_else(|| damaged("lists have too many values"))?;
                let (valid, rest) = match (has_marks, buffers.split_first()) {
                    (false, _) => (None, buffers),
                    (true, Some((first, rest))) => (Some(marks(first, 0, inner)?), rest),
                    (true, None) => return Err(damaged("a chunk has no buffers")),
                };
                items.chunk(rest, inner)?.widened(*width, valid)
            }
            Self::Constant(_) | Self::OutOfLine { .. } => self.refused("a chunk"),
        }
    }

    /// The values of a block.
    pub(crate) fn block(&self, bytes: &[u8], count: usize) -> Result<Block> {
        check(count)?;
        match self {
            Self::Flat(bits) => flat(*bits, bytes, count),
            Self::Variable(_) => variable_block(bytes, count),
            Self::Constant(Some(value)) if !value.is_empty() => {
                Ok(Block::fixed(value.len(), value.repeat(count)))
            }
            Self::OutOfLine { size, bits } => {
                Ok(Block::fixed(*size, bits::out_of_line(*size, *bits, bytes, count)?))
            }
            Self::Inline(size) => Ok(Block::fixed(*size, bits::inline(*size, bytes, count)?)),
            Self::Runs { values, lengths } => rle::decode(values, lengths, rle::split(bytes)?, count),
            Self::General(scheme, values) => values.block(&scheme.decode(bytes)?, count),
            Self::Fixed { .. } => self.values(bytes, count, 0),
            _ => self.refused("a block"),
        }
    }

    /// Bytes of a single value, with the marks of what is missing in it.
    pub(crate) fn value_size(&self) -> Result<usize> {
        let (mut size, mut width, mut code) = (0usize, 1usize, self);
        while let Self::Fixed { width: here, has_marks, items } = code {
            width *= here;
            size += if *has_marks { width.div_ceil(8) } else { 0 };
            code = items;
        }
        match code {
            // All items are missing, and have no bytes.
            Self::Constant(None) => Ok(size),
            Self::Flat(bits) => {
                let of_items = bits.checked_mul(width).ok_or_else(|| damaged("values are too large"))?;
                Ok(size + of_items.div_ceil(8))
            }
            other => other.refused("single values"),
        }
    }

    /// Single values of one size, end to end; their items have `item` bytes if all are missing.
    pub(crate) fn values(&self, bytes: &[u8], count: usize, item: usize) -> Result<Block> {
        let size = self.value_size()?;
        if count.checked_mul(size).is_none_or(|all| all > bytes.len()) {
            return Err(damaged(format!("{} bytes do not hold {count} values of {size} bytes", bytes.len())));
        }
        let mut layers = Vec::new();
        let (mut width, mut code) = (1, self);
        while let Self::Fixed { width: here, has_marks, items } = code {
            width *= here;
            layers.push((*here, width, has_marks.then(Vec::new)));
            code = items;
        }
        let bits = match code {
            Self::Flat(bits) => *bits,
            Self::Constant(None) if item > 0 => 0,
            other => return other.refused("single values"),
        };
        let mut items = Vec::new();
        for mut value in bytes.chunks_exact(size.max(1)).take(count) {
            for (_, width, valid) in &mut layers {
                if let Some(valid) = valid {
                    let (head, rest) = value.split_at(width.div_ceil(8));
                    valid.extend(marks(head, 0, *width)?);
                    value = rest;
                }
            }
            match bits {
                0 => items.resize(items.len() + width * item, 0),
                1 => items.extend(unpack_bits(value, 0, width)),
                _ => items.extend_from_slice(value),
            }
        }
        let size = match bits {
            0 => item,
            bits => bits.div_ceil(8),
        };
        let mut block = Block::fixed(size, items);
        for (width, _, valid) in layers.into_iter().rev() {
            block = block.widened(width, valid)?;
        }
        Ok(block)
    }

    /// A single value that has its own size.
    pub(crate) fn own_sizes(&self, values: Items) -> Result<Items> {
        match self {
            Self::Variable(_) => Ok(values),
            Self::Fsst(symbols, _) => symbols.decode(values),
            Self::General(scheme, _) => {
                let mut out = Items::empty(0);
                for at in 0..values.count() {
                    match values.get(at).unwrap_or_default() {
                        [] => out.push(&[]),
                        value => out.push(&scheme.decode(value)?),
                    }
                }
                Ok(out)
            }
            other => other.refused("values of their own sizes"),
        }
    }

    /// Levels of repetition or definition.
    pub(crate) fn levels(&self, bytes: &[u8], count: usize) -> Result<Vec<u16>> {
        let block = self.block(bytes, count)?;
        match &block.items {
            Items::Fixed { size: 2, bytes } if block.count() == count => {
                Ok(bytes.chunks_exact(2).map(|level| number(level) as u16).collect())
            }
            _ => Err(damaged("levels do not have 16 bits")),
        }
    }
}

impl Block {
    fn bytes(self) -> Result<Vec<u8>> {
        match self.items {
            Items::Fixed { bytes, .. } => Ok(bytes),
            Items::Variable { .. } => Err(damaged("values of runs have their own sizes")),
        }
    }
}

fn check(count: usize) -> Result<()> {
    match count <= MAX_VALUES {
        true => Ok(()),
        false => Err(damaged(format!("{count} values in one part of a page"))),
    }
}

/// The bits of packed integers, which are flat values of any number of bits.
fn packed_bits(message: &[u8]) -> Result<usize> {
    let Some((1, flat)) = choice(message)? else {
        return Err(unsupported("another encoding than Flat of packed integers"));
    };
    for field in fields(flat) {
        match field? {
            (1, bits) => {
                let bits = usize::try_from(bits.number()?).ok().filter(|bits| (1..=64).contains(bits));
                return bits.ok_or_else(|| damaged("packed integers have no number of bits"));
            }
            (2, _) => break,
            _ => {}
        }
    }
    Err(unsupported("buffers inside of an encoding are compressed"))
}

/// Bytes of a word with so many bits.
fn word(bits: u64) -> Result<usize> {
    match bits {
        8 | 16 | 32 | 64 => Ok(bits as usize / 8),
        bits => Err(unsupported(format!("packed integers of {bits} bits"))),
    }
}

fn flat(bits: usize, bytes: &[u8], count: usize) -> Result<Block> {
    let size = count.checked_mul(bits).map(|bits| bits.div_ceil(8)).filter(|&size| size <= bytes.len());
    let size = size
        .ok_or_else(|| damaged(format!("{} bytes do not hold {count} values of {bits} bits", bytes.len())))?;
    Ok(match bits {
        1 => Block::fixed(1, unpack_bits(bytes, 0, count)),
        bits => Block::fixed(bits / 8, bytes[..size].to_vec()),
    })
}

fn split(size: usize, bytes: &[u8], count: usize) -> Result<Block> {
    if count.checked_mul(size) != Some(bytes.len()) {
        return Err(damaged(format!("{} bytes do not hold {count} values of {size} bytes", bytes.len())));
    }
    let mut out = vec![0; bytes.len()];
    for (at, byte) in out.iter_mut().enumerate() {
        *byte = bytes[at % size * count + at / size];
    }
    Ok(Block::fixed(size, out))
}

/// `count` values between offsets, which begin at `from` and count from the start of the bytes.
fn variable(size: usize, bytes: &[u8], from: usize, count: usize) -> Result<Block> {
    let wrong = || damaged("offsets are not in order, or beyond the end");
    let offsets = bytes.get(from..).and_then(|bytes| bytes.get(..(count + 1).checked_mul(size)?));
    let offsets = offsets.ok_or_else(|| damaged("offsets are cut"))?.chunks_exact(size).map(number);
    let offsets: Vec<usize> = offsets.map(|offset| usize::try_from(offset).unwrap_or(usize::MAX)).collect();
    let (first, last) = (offsets[0], offsets[count]);
    if offsets.windows(2).any(|pair| pair[0] > pair[1]) {
        return Err(wrong());
    }
    let values = bytes.get(first..last).ok_or_else(wrong)?.to_vec();
    let offsets = offsets.into_iter().map(|offset| offset - first).collect();
    Ok(Block::of(Items::Variable { offsets, bytes: values }))
}

/// A block of values with offsets: a head, the offsets, the bytes.
fn variable_block(bytes: &[u8], count: usize) -> Result<Block> {
    let cut = || damaged("a block of texts is cut");
    let head: &[u8; 4] = bytes.first_chunk().ok_or_else(cut)?;
    // Before 2.1 was stable, the number of bits was one byte, and that of values followed.
    let is_old = head[1..] != [0; 3];
    let (size, head) = match (head[0], is_old) {
        (32, false) => (4, 8),
        (64, false) => (8, 16),
        (32, true) => (4, 9),
        (64, true) => (8, 17),
        (bits, _) => return Err(unsupported(format!("offsets of {bits} bits"))),
    };
    let start = number(bytes.get(head - size..head).ok_or_else(cut)?);
    let start = usize::try_from(start).ok().filter(|&start| start <= bytes.len()).ok_or_else(cut)?;
    if (count + 1).checked_mul(size).and_then(|all| all.checked_add(head)) != Some(start) {
        return Err(damaged(format!("a block of texts does not have the {count} that it should")));
    }
    let offsets = bytes[head..start].chunks_exact(size).map(number);
    let offsets: Vec<usize> = offsets.map(|offset| usize::try_from(offset).unwrap_or(usize::MAX)).collect();
    let values = &bytes[start..];
    if offsets[0] != 0 || offsets[count] > values.len() || offsets.windows(2).any(|pair| pair[0] > pair[1]) {
        return Err(damaged("offsets are not in order, or beyond the end"));
    }
    let values = values[..offsets[count]].to_vec();
    Ok(Block::of(Items::Variable { offsets, bytes: values }))
}
