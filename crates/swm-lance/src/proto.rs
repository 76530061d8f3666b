//! Reading messages of Protocol Buffers: a message is a slice, and its fields are an iterator. Nothing is allocated, and what calls for
//! nested messages limits their depth.

use crate::error::{Result, damaged};

/// The value of a field.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Value<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    pub(crate) fn number(self) -> Result<u64> {
        match self {
            Self::Number(number) => Ok(number),
            Self::Bytes(_) => Err(damaged("a field of a message holds bytes instead of a number")),
        }
    }

    /// Signed numbers of 32 bits are stored with 64.
    pub(crate) fn signed(self) -> Result<i32> {
        Ok(self.number()? as i32)
    }

    pub(crate) fn small(self) -> Result<u32> {
        u32::try_from(self.number()?).map_err(|_| damaged("a number of a message is too large"))
    }

    pub(crate) fn flag(self) -> Result<bool> {
        Ok(self.number()? != 0)
    }

    pub(crate) fn bytes(self) -> Result<&'a [u8]> {
        match self {
            Self::Bytes(bytes) => Ok(bytes),
            Self::Number(_) => Err(damaged("a field of a message holds a number instead of bytes")),
        }
    }

    pub(crate) fn text(self) -> Result<String> {
        let text = std::str::from_utf8(self.bytes()?);
        Ok(text.map_err(|_| damaged("a text of a message is not UTF-8"))?.to_owned())
    }

    /// Adds the values of a repeated field, which are in one block or by themselves.
    pub(crate) fn numbers(self, out: &mut Vec<u64>) -> Result<()> {
        match self {
            Self::Number(number) => out.push(number),
            Self::Bytes(mut bytes) => {
                while !bytes.is_empty() {
                    out.push(varint(&mut bytes)?);
                }
            }
        }
        Ok(())
    }
}

/// The fields of a message, with their numbers, in the order that they are stored in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fields<'a>(&'a [u8]);

/// The fields of a message.
pub(crate) fn fields(message: &[u8]) -> Fields<'_> {
    Fields(message)
}

impl<'a> Fields<'a> {
    fn read(&mut self) -> Result<(u32, Value<'a>)> {
        let key = varint(&mut self.0)?;
        let number = u32::try_from(key >> 3).map_err(|_| damaged("a field of a message has no number"))?;
        let value = match key & 7 {
            0 => Value::Number(varint(&mut self.0)?),
            1 => Value::Number(u64::from_le_bytes(take_array(&mut self.0)?)),
            2 => {
                let size = varint(&mut self.0)?;
                Value::Bytes(take(&mut self.0, size)?)
            }
            5 => Value::Number(u32::from_le_bytes(take_array(&mut self.0)?).into()),
            kind => return Err(damaged(format!("a field of a message is of the unknown type {kind}"))),
        };
        Ok((number, value))
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u32, Value<'a>)>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = self.read();
        if field.is_err() {
            self.0 = &[];
        }
        Some(field)
    }
}

/// The only field that is set of a choice, as its number and message; the last one counts.
pub(crate) fn choice(message: &[u8]) -> Result<Option<(u32, &[u8])>> {
    let mut found = None;
    for field in fields(message) {
        let (number, value) = field?;
        found = Some((number, value.bytes()?));
    }
    Ok(found)
}

fn take<'a>(bytes: &mut &'a [u8], size: u64) -> Result<&'a [u8]> {
    let size = usize::try_from(size).ok().filter(|&size| size <= bytes.len());
    let size = size.ok_or_else(|| damaged("a message is cut"))?;
    let (head, rest) = bytes.split_at(size);
    *bytes = rest;
    Ok(head)
}

fn take_array<const SIZE: usize>(bytes: &mut &[u8]) -> Result<[u8; SIZE]> {
    let (head, rest) = bytes.split_first_chunk().ok_or_else(|| damaged("a message is cut"))?;
    *bytes = rest;
    Ok(*head)
}

fn varint(bytes: &mut &[u8]) -> Result<u64> {
    let mut number = 0;
    for shift in (0..70).step_by(7) {
        let [byte] = take_array(bytes)?;
        // Of the tenth byte, one bit counts.
        number |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
        if byte < 0x80 {
            return Ok(number);
        }
    }
    Err(damaged("a number of a message has more than 64 bits"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read() {
        let message = [0x08, 0x96, 0x01, 0x12, 2, b'o', b'k', 0x1a, 3, 1, 0x96, 0x01, 0x25, 1, 0, 0, 0];
        let read: Vec<_> = fields(&message).collect::<Result<_>>().unwrap();
        assert_eq!(read.iter().map(|(number, _)| *number).collect::<Vec<_>>(), [1, 2, 3, 4]);
        assert_eq!((read[0].1.number().unwrap(), read[1].1.text().unwrap()), (150, "ok".to_owned()));
        let mut numbers = Vec::new();
        read[2].1.numbers(&mut numbers).unwrap();
        assert_eq!(numbers, [1, 150]);
        assert!(read[0].1.bytes().is_err() && read[1].1.number().is_err());
        let minus = [0x20, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01];
        assert_eq!(fields(&minus).next().unwrap().unwrap().1.signed().unwrap(), -1);
    }

    #[test]
    fn damaged_messages_are_errors() {
        for message in [&[0x08][..], &[0x12, 9, 1], &[0x0b], &[0x80; 11], &[0x09, 1, 2]] {
            assert!(fields(message).any(|field| field.is_err()), "{message:?}");
        }
    }
}
