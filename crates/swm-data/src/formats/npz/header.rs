//! The head of a `.npy` array: element type and shape as the text of a Python dictionary.
//!
//! Source of the format: numpy's `lib/format.py`, versions 1 to 3.

use swm_core::{Dtype, Field, SliceMut};

use crate::error::{FormatError, Result, invalid, unsupported, wrong_type};
use crate::formats::element::{self, Element};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Bytes of the head in arrays that we write: the same for any number of rows, so that it can be rewritten in place.
pub(super) const HEAD_BYTES: usize = 256;

/// Characters of a text in arrays that we write. Numpy stores four bytes for each.
pub(super) const TEXT_CHARACTERS: usize = 256;

/// The elements of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrayType {
    /// Numbers, and text of one byte per character.
    Plain(Element),
    /// Text of so many characters, four bytes each.
    Wide(usize),
}

impl ArrayType {
    /// The elements that a descriptor of numpy names, and whether they are big-endian.
    ///
    /// # Errors
    ///
    /// It names a type that is not read.
    pub fn parse(descriptor: &str) -> Result<(Self, bool)> {
        let unknown = || unsupported(format!("elements of type `{descriptor}` are not supported"));
        let (order, name) = descriptor.split_at_checked(1).ok_or_else(unknown)?;
        let size = || name.get(1..).and_then(|size| size.parse::<usize>().ok());
        let is_big = match (order, name) {
            ("|", "b1" | "u1" | "i1") => false,
            ("|", name) if name.starts_with('S') => false,
            // How numpy writes bfloat16 of the package ml_dtypes; other structures of two bytes have the order `|`.
            ("<", "V2") => return Ok((Self::Plain(Element::Bf16), false)),
            ("<", _) => false,
            (">", _) => true,
            _ => return Err(unknown()),
        };
        let elements = Self::Plain(match name {
            "b1" => Element::Bool,
            "u1" => Element::U8,
            "i1" => Element::I8,
            "i2" => Element::I16,
            "u2" => Element::U16,
            "i4" => Element::I32,
            "u4" => Element::U32,
            "i8" => Element::I64,
            "u8" => Element::U64,
            "f2" => Element::F16,
            "f4" => Element::F32,
            "f8" => Element::F64,
            _ if name.starts_with('S') => Element::FixedText(size().ok_or_else(unknown)?),
            _ if name.starts_with('U') => {
                let characters = size().filter(|&size| size <= 1 << 20).ok_or_else(unknown)?;
                return Ok((Self::Wide(characters), is_big));
            }
            _ => return Err(unknown()),
        });
        Ok((elements, is_big))
    }

    /// The column type that holds every value.
    #[must_use]
    pub fn dtype(self) -> Dtype {
        match self {
            Self::Plain(element) => element.dtype(),
            Self::Wide(_) => Dtype::Str,
        }
    }

    /// Bytes of one element.
    #[must_use]
    pub fn size(self) -> usize {
        match self {
            Self::Plain(element) => element.size().unwrap_or(0),
            Self::Wide(characters) => 4 * characters,
        }
    }

    /// Makes big-endian elements little-endian.
    pub fn swap(self, bytes: &mut [u8]) {
        let size = match self {
            Self::Plain(Element::FixedText(_)) => 1,
            Self::Plain(element) => element.size().unwrap_or(1),
            Self::Wide(_) => 4,
        };
        bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }

    /// Fills `out`, which has as many values as `bytes` holds elements.
    ///
    /// # Errors
    ///
    /// `out` is of another type, or a value is none that columns hold.
    pub fn convert(self, bytes: &[u8], out: SliceMut<'_>) -> Result<()> {
        match (self, out) {
            (Self::Plain(element), out) => element::from_bytes(element, bytes, out),
            (Self::Wide(_), SliceMut::Str(out)) => {
                let texts = bytes.chunks_exact(self.size().max(1));
                for (value, characters) in out.iter_mut().zip(texts) {
                    value.clear();
                    for &character in characters.as_chunks::<4>().0 {
                        match char::from_u32(u32::from_le_bytes(character)) {
                            Some('\0') => break,
                            Some(character) => value.push(character),
                            None => return Err(invalid("a text is not valid Unicode")),
                        }
                    }
                }
                Ok(())
            }
            (_, out) => Err(wrong_type(format!("texts were asked for as {}", out.dtype()))),
        }
    }
}

/// How the elements of a column are described in arrays that we write.
fn descriptor(dtype: Dtype) -> String {
    match dtype {
        Dtype::Bool => "|b1".to_owned(),
        Dtype::U8 => "|u1".to_owned(),
        Dtype::I32 => "<i4".to_owned(),
        Dtype::I64 => "<i8".to_owned(),
        Dtype::F32 => "<f4".to_owned(),
        Dtype::F64 => "<f8".to_owned(),
        Dtype::Str => format!("<U{TEXT_CHARACTERS}"),
    }
}

/// The head of an array of `rows` rows of `field`.
pub(super) fn format(field: &Field, rows: usize) -> Result<Vec<u8>> {
    let mut shape = format!("{rows},");
    for size in &field.shape {
        shape += &format!(" {size},");
    }
    let text =
        format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({shape}), }}", descriptor(field.dtype));
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend((HEAD_BYTES as u16 - 10).to_le_bytes());
    bytes.extend(text.as_bytes());
    if bytes.len() >= HEAD_BYTES {
        return Err(invalid(format!("column `{}` has too many dimensions", field.name)));
    }
    bytes.resize(HEAD_BYTES - 1, b' ');
    bytes.push(b'\n');
    Ok(bytes)
}

/// What the head of an array says.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Head {
    pub(super) elements: ArrayType,
    pub(super) is_big_endian: bool,
    pub(super) shape: Vec<usize>,
    /// Whether the first index varies fastest, as in Fortran.
    pub(super) is_by_column: bool,
    /// Where the values begin.
    pub(super) bytes: usize,
}

impl Head {
    /// Reads the head at the start of `bytes`.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self> {
        let wrong = |what: &str| invalid(format!("it is no numpy array: {what}"));
        if !bytes.starts_with(MAGIC) {
            return Err(wrong("it does not begin as one"));
        }
        let number = |at: usize, width: usize| {
            let bytes = bytes.get(at..at + width).ok_or_else(|| wrong("its head is cut short"))?;
            Ok::<_, FormatError>(bytes.iter().rev().fold(0, |value, &byte| value << 8 | usize::from(byte)))
        };
        let (start, length) = match number(6, 1)? {
            1 => (10usize, number(8, 2)?),
            2 | 3 => (12, number(8, 4)?),
            version => return Err(wrong(&format!("version {version} is unknown"))),
        };
        let text =
            bytes.get(start..start.saturating_add(length)).ok_or_else(|| wrong("its head is cut short"))?;
        let text = std::str::from_utf8(text).map_err(|_| wrong("its head is no text"))?;
        let value = |key: &str| {
            let at = text.find(key)? + key.len();
            Some(text[at..].trim_start_matches([' ', ':']))
        };
        let descriptor = value("'descr'").and_then(|rest| rest.strip_prefix('\''));
        let Some((descriptor, _)) = descriptor.and_then(|rest| rest.split_once('\'')) else {
            return Err(unsupported("elements of several types are not supported"));
        };
        let is_by_column = match value("'fortran_order'") {
            Some(rest) if rest.starts_with("False") => false,
            Some(rest) if rest.starts_with("True") => true,
            _ => return Err(wrong("its order of elements")),
        };
        let shape = value("'shape'").and_then(|rest| rest.strip_prefix('('));
        let Some((shape, _)) = shape.and_then(|rest| rest.split_once(')')) else {
            return Err(wrong("it has no shape"));
        };
        let sizes = shape.split(',').map(str::trim).filter(|size| !size.is_empty());
        let shape: Vec<usize> =
            sizes.map(|size| size.parse().map_err(|_| wrong("its shape"))).collect::<Result<_, _>>()?;
        if shape.len() > 32 {
            return Err(wrong("it has more than 32 dimensions"));
        }
        let (elements, is_big_endian) = ArrayType::parse(descriptor)?;
        Ok(Self { elements, is_big_endian, shape, is_by_column, bytes: start + length })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_come_back() {
        for (dtype, elements) in [
            (Dtype::Bool, ArrayType::Plain(Element::Bool)),
            (Dtype::F64, ArrayType::Plain(Element::F64)),
            (Dtype::Str, ArrayType::Wide(TEXT_CHARACTERS)),
        ] {
            for shape in [&[][..], &[7], &[64, 64, 3]] {
                let head = format(&Field::step("x", dtype, shape), 12).unwrap();
                let mut expected = vec![12];
                expected.extend(shape);
                assert_eq!(
                    Head::parse(&head).unwrap(),
                    Head {
                        elements,
                        is_big_endian: false,
                        shape: expected,
                        is_by_column: false,
                        bytes: HEAD_BYTES
                    }
                );
            }
        }
    }

    #[test]
    fn other_heads_are_refused() {
        let good = format(&Field::step("x", Dtype::F64, &[3]), 2).unwrap();
        let with = |old: &str, new: &str| {
            let text = String::from_utf8_lossy(&good[10..]).replace(old, new);
            Head::parse(&[&good[..10], text.as_bytes(), &[b' '; 9]].concat()).unwrap_err().to_string()
        };
        assert!(with("<f8", "<c8").contains("`<c8`"));
        assert!(with("<f8", "|V2").contains("`|V2`"));
        assert!(with("<f8", "").contains("``"));
        assert!(with("<f8", "|O").contains("`|O`"));
        assert!(with("<f8", "<U99999999999").contains("not supported"));
        assert!(with("False", "Maybe").contains("its order of elements"));
        assert!(with("(2,", "(-2").contains("shape"));
        for cut in 0..good.len() {
            assert!(Head::parse(&good[..cut]).is_err());
        }
    }
}
