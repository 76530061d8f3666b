//! Types of stored elements, as little-endian bytes, and their values as columns; formats of raw bytes share them.

use crate::error::{Result, invalid, wrong_type};
use swm_core::{Dtype, SliceMut};

/// How the elements of a column stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Element {
    /// One byte, 0 or 1: h5py's enumeration.
    Bool,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
    /// So many bytes of UTF-8, padded with zeros.
    FixedText(usize),
    /// UTF-8 of any length, on the file's heap.
    Text,
    /// ASCII of any length, on the file's heap.
    AsciiText,
}

impl Element {
    /// The column type that holds every value: small integers are widened; u64 beyond the range of i64 saturates.
    pub(super) fn dtype(self) -> Dtype {
        match self {
            Element::Bool => Dtype::Bool,
            Element::U8 => Dtype::U8,
            Element::I8 | Element::I16 | Element::I32 | Element::U16 => Dtype::I32,
            Element::I64 | Element::U32 | Element::U64 => Dtype::I64,
            Element::F32 => Dtype::F32,
            Element::F64 => Dtype::F64,
            Element::FixedText(_) | Element::Text | Element::AsciiText => Dtype::Str,
        }
    }

    /// Bytes per element in the file; `None` for what stands on the heap.
    pub(super) fn size(self) -> Option<usize> {
        match self {
            Element::Bool | Element::I8 | Element::U8 => Some(1),
            Element::I16 | Element::U16 => Some(2),
            Element::I32 | Element::U32 | Element::F32 => Some(4),
            Element::I64 | Element::U64 | Element::F64 => Some(8),
            Element::FixedText(size) => Some(size),
            Element::Text | Element::AsciiText => None,
        }
    }
}

/// Fills `out`, which has as many values as `bytes` holds elements.
pub(super) fn from_bytes(element: Element, bytes: &[u8], out: SliceMut<'_>) -> Result<()> {
    macro_rules! numbers {
        ($out:ident, $from:ty, $size:literal) => {
            for (value, bytes) in $out.iter_mut().zip(bytes.as_chunks::<$size>().0) {
                *value = <$from>::from_le_bytes(*bytes).into();
            }
        };
    }
    match (element, out) {
        (Element::Bool, SliceMut::Bool(out)) => {
            for (value, &byte) in out.iter_mut().zip(bytes) {
                *value = byte != 0;
            }
        }
        (Element::U8, SliceMut::U8(out)) => out.copy_from_slice(bytes),
        (Element::I8, SliceMut::I32(out)) => numbers!(out, i8, 1),
        (Element::I16, SliceMut::I32(out)) => numbers!(out, i16, 2),
        (Element::U16, SliceMut::I32(out)) => numbers!(out, u16, 2),
        (Element::I32, SliceMut::I32(out)) => numbers!(out, i32, 4),
        (Element::U32, SliceMut::I64(out)) => numbers!(out, u32, 4),
        (Element::I64, SliceMut::I64(out)) => numbers!(out, i64, 8),
        (Element::U64, SliceMut::I64(out)) => {
            for (value, bytes) in out.iter_mut().zip(bytes.as_chunks::<8>().0) {
                *value = i64::try_from(u64::from_le_bytes(*bytes)).unwrap_or(i64::MAX);
            }
        }
        (Element::F32, SliceMut::F32(out)) => numbers!(out, f32, 4),
        (Element::F64, SliceMut::F64(out)) => numbers!(out, f64, 8),
        (Element::FixedText(size), SliceMut::Str(out)) => {
            for (value, bytes) in out.iter_mut().zip(bytes.chunks_exact(size.max(1))) {
                *value = text(bytes)?;
            }
        }
        (element, out) => {
            return Err(wrong_type(format!("{element:?} elements were asked for as {}", out.dtype())));
        }
    }
    Ok(())
}

/// Text up to the padding.
pub(super) fn text(bytes: &[u8]) -> Result<String> {
    let end = bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    let text = std::str::from_utf8(&bytes[..end]);
    text.map(str::to_owned).map_err(|_| invalid("a text is not valid UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_widened_and_saturate() {
        let mut out = [0i32; 2];
        from_bytes(Element::I16, &[0xff, 0xff, 1, 0], SliceMut::I32(&mut out)).unwrap();
        assert_eq!(out, [-1, 1]);
        let mut out = [0i64; 2];
        let mut bytes = [0xff; 16];
        bytes[8..].copy_from_slice(&7u64.to_le_bytes());
        from_bytes(Element::U64, &bytes, SliceMut::I64(&mut out)).unwrap();
        assert_eq!(out, [i64::MAX, 7]);
    }

    #[test]
    fn text_loses_its_padding_and_must_be_utf8() {
        let mut out = [String::new(), String::new()];
        from_bytes(Element::FixedText(3), b"ab\0xyz", SliceMut::Str(&mut out)).unwrap();
        assert_eq!(out, ["ab", "xyz"]);
        assert!(from_bytes(Element::FixedText(3), b"\xff\xff\0xyz", SliceMut::Str(&mut out)).is_err());
    }
}
