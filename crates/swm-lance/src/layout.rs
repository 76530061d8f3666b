//! How a page of a file since version 2.1 is laid out, as its metadata describes it, and what its levels mean.

use crate::codes::Code;
use crate::error::{Result, damaged, unsupported};
use crate::proto::{choice, fields};

/// A page.
#[derive(Debug)]
pub(crate) enum Layout {
    /// Chunks of some kilobytes, each decoded as a whole.
    Chunks(Chunks),
    /// All values that are there are equal, or all are missing.
    Constant(Constant),
    /// Large values, each by itself.
    Zipped(Zipped),
}

#[derive(Debug)]
pub(crate) struct Chunks {
    pub(crate) repetition: Option<Code>,
    pub(crate) definition: Option<Code>,
    pub(crate) values: Code,
    /// Values are positions in one, which has so many items.
    pub(crate) dictionary: Option<(Code, usize)>,
    /// Of a chunk, without those of levels.
    pub(crate) buffers: usize,
    pub(crate) levels: Levels,
    /// Values of the page.
    pub(crate) items: u64,
    /// Whether sizes have 32 bits.
    pub(crate) is_large: bool,
}

#[derive(Debug)]
pub(crate) struct Constant {
    pub(crate) levels: Levels,
    pub(crate) value: Option<Vec<u8>>,
    pub(crate) repetition: Option<Code>,
    pub(crate) definition: Option<Code>,
    pub(crate) counts: [u64; 2],
}

#[derive(Debug)]
pub(crate) struct Zipped {
    pub(crate) levels: Levels,
    /// Bits of a level of repetition and of definition, in a word before each value.
    pub(crate) bits: [u32; 2],
    /// Bytes of the size before each value; `None`: all have the same one.
    pub(crate) size: Option<usize>,
    pub(crate) values: Code,
}

impl Zipped {
    /// Bytes of the word of levels.
    pub(crate) fn word(&self) -> usize {
        match self.bits[0] + self.bits[1] {
            0 => 0,
            1..=8 => 1,
            9..=16 => 2,
            _ => 4,
        }
    }

    /// The levels in a word: of repetition, of definition.
    pub(crate) fn split(&self, word: u64) -> [u16; 2] {
        let [repetition, definition] = self.bits;
        match (repetition, definition) {
            (0, _) => [0, word as u16],
            (_, 0) => [word as u16, 0],
            (_, definition) => [(word >> definition) as u16, (word & ((1 << definition) - 1)) as u16],
        }
    }
}

/// What levels of definition mean. 0 is a value that is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Levels {
    /// Up to this one, there is a value, which is missing.
    pub(crate) visible: u16,
    pub(crate) list: Option<ListLevels>,
}

/// The levels of lists; above all of these, a structure around the list is missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ListLevels {
    /// An empty one.
    pub(crate) empty: Option<u16>,
}

impl Levels {
    /// Layers are listed from the innermost one on.
    fn of(layers: &[u64]) -> Result<Self> {
        let (mut levels, mut next) = (Self::default(), 1u16);
        let mut level = || {
            next += 1;
            next - 1
        };
        if layers.len() > MAX_LAYERS {
            return Err(damaged("its values are nested too deeply"));
        }
        for layer in layers {
            match layer {
                1 => {}
                3 => {
                    let here = level();
                    if levels.list.is_none() {
                        levels.visible = here;
                    }
                }
                2 | 4..=6 if levels.list.is_some() => return Err(unsupported("lists of lists")),
                2 => levels.list = Some(ListLevels { empty: None }),
                4 => {
                    level();
                    levels.list = Some(ListLevels { empty: None });
                }
                5 => levels.list = Some(ListLevels { empty: Some(level()) }),
                6 => {
                    level();
                    levels.list = Some(ListLevels { empty: Some(level()) });
                }
                other => return Err(unsupported(format!("a layer of values with the number {other}"))),
            }
        }
        Ok(levels)
    }
}

/// Layers of a column.
const MAX_LAYERS: usize = 64;
/// Buffers of a chunk.
const MAX_BUFFERS: u64 = 64;

impl Layout {
    pub(crate) fn parse(message: &[u8]) -> Result<Self> {
        match choice(message)? {
            Some((1, message)) => Ok(Self::Chunks(chunks(message)?)),
            Some((2, message)) => Ok(Self::Constant(constant(message)?)),
            Some((3, message)) => Ok(Self::Zipped(zipped(message)?)),
            Some((4, _)) => Err(unsupported("the layout BlobLayout is not read")),
            Some((number, _)) => Err(unsupported(format!("a layout with the number {number} is not read"))),
            None => Err(damaged("its layout is not named")),
        }
    }
}

fn chunks(message: &[u8]) -> Result<Chunks> {
    let (mut repetition, mut definition, mut values, mut dictionary) = (None, None, None, None);
    let (mut layers, mut buffers, mut entries, mut items, mut is_large) = (Vec::new(), 0, 0, 0, false);
    for field in fields(message) {
        let (number, value) = field?;
        match number {
            1 => repetition = Some(Code::parse(value.bytes()?)?),
            2 => definition = Some(Code::parse(value.bytes()?)?),
            3 => values = Some(Code::parse(value.bytes()?)?),
            4 => dictionary = Some(Code::parse(value.bytes()?)?),
            5 => entries = value.number()?,
            6 => value.numbers(&mut layers)?,
            7 => buffers = value.number()?,
            9 => items = value.number()?,
            10 => is_large = value.flag()?,
            _ => {}
        }
    }
    let entries = usize::try_from(entries).map_err(|_| damaged("its dictionary is too large"))?;
    if buffers > MAX_BUFFERS {
        return Err(damaged(format!("its chunks have {buffers} buffers")));
    }
    Ok(Chunks {
        repetition,
        definition,
        values: values.ok_or_else(|| damaged("the encoding of its values is missing"))?,
        dictionary: dictionary.map(|code| (code, entries)),
        buffers: buffers as usize,
        levels: Levels::of(&layers)?,
        items,
        is_large,
    })
}

fn constant(message: &[u8]) -> Result<Constant> {
    let (mut layers, mut value, mut repetition, mut definition, mut counts) =
        (Vec::new(), None, None, None, [0; 2]);
    for field in fields(message) {
        let (number, found) = field?;
        match number {
            5 => found.numbers(&mut layers)?,
            6 => value = Some(found.bytes()?.to_vec()),
            7 => repetition = Some(Code::parse(found.bytes()?)?),
            8 => definition = Some(Code::parse(found.bytes()?)?),
            9 => counts[0] = found.number()?,
            10 => counts[1] = found.number()?,
            _ => {}
        }
    }
    Ok(Constant { levels: Levels::of(&layers)?, value, repetition, definition, counts })
}

fn zipped(message: &[u8]) -> Result<Zipped> {
    let (mut layers, mut bits, mut size, mut values) = (Vec::new(), [0; 2], None, None);
    for field in fields(message) {
        let (number, found) = field?;
        match number {
            1 | 2 => bits[number as usize - 1] = found.small()?,
            4 => {
                size = Some(match found.number()? {
                    bits @ (8 | 16 | 32 | 64) => bits as usize / 8,
                    bits => return Err(unsupported(format!("sizes of values with {bits} bits"))),
                });
            }
            3 => size = None,
            7 => values = Some(Code::parse(found.bytes()?)?),
            8 => found.numbers(&mut layers)?,
            _ => {}
        }
    }
    if bits.iter().any(|&bits| bits > 16) {
        return Err(damaged(format!("its levels have {bits:?} bits")));
    }
    let values = values.ok_or_else(|| damaged("the encoding of its values is missing"))?;
    Ok(Zipped { levels: Levels::of(&layers)?, bits, size, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_count_from_the_innermost_layer_on() {
        assert_eq!(
            Levels::of(&[3, 6, 3]).unwrap(),
            Levels { visible: 1, list: Some(ListLevels { empty: Some(3) }) }
        );
        assert_eq!(Levels::of(&[3, 3]).unwrap(), Levels { visible: 2, list: None });
        assert_eq!(
            Levels::of(&[1, 4]).unwrap(),
            Levels { visible: 0, list: Some(ListLevels { empty: None }) }
        );
        assert!(Levels::of(&[1, 2, 2]).unwrap_err().is_unsupported() && Levels::of(&[7]).is_err());
    }

    #[test]
    fn words_of_levels_are_split() {
        let zipped = |bits| Zipped { levels: Levels::default(), bits, size: None, values: Code::Flat(8) };
        assert_eq!((zipped([1, 2]).word(), zipped([1, 2]).split(0b110)), (1, [1, 2]));
        assert_eq!((zipped([0, 1]).split(1), zipped([1, 0]).split(1)), ([0, 1], [1, 0]));
        assert_eq!((zipped([8, 1]).word(), zipped([0, 0]).word(), zipped([16, 16]).word()), (2, 0, 4));
    }
}
