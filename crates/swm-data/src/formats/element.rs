//! Types of stored elements, as little-endian bytes, and their values as columns; formats of raw bytes share them.

use crate::dataset::Steps;
use crate::error::{FormatError, Result, invalid, unsupported, wrong_type};
use swm_core::{Dtype, SliceMut};

/// Values of a column of u64 that are looked at where it is opened.
pub const LOOKED_AT: usize = 1 << 16;

/// How the elements of a column stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// One byte, 0 or 1: h5py's enumeration.
    Bool,
    /// One byte with a sign.
    I8,
    /// Two bytes with a sign.
    I16,
    /// Four bytes with a sign.
    I32,
    /// Eight bytes with a sign.
    I64,
    /// One byte.
    U8,
    /// Two bytes.
    U16,
    /// Four bytes.
    U32,
    /// Eight bytes.
    U64,
    /// IEEE 754's half precision, read as f32.
    F16,
    /// The upper half of an f32.
    Bf16,
    /// IEEE 754's single precision.
    F32,
    /// IEEE 754's double precision.
    F64,
    /// So many bytes of UTF-8, padded with zeros.
    FixedText(usize),
    /// UTF-8 of any length, on the file's heap.
    Text,
    /// ASCII of any length, on the file's heap.
    AsciiText,
}

impl Element {
    /// The column type that holds every value: small numbers are widened; a u64 beyond the range of i64 is an error of reading.
    #[must_use]
    pub fn dtype(self) -> Dtype {
        match self {
            Element::Bool => Dtype::Bool,
            Element::U8 => Dtype::U8,
            Element::I8 | Element::I16 | Element::I32 | Element::U16 => Dtype::I32,
            Element::I64 | Element::U32 | Element::U64 => Dtype::I64,
            Element::F16 | Element::Bf16 | Element::F32 => Dtype::F32,
            Element::F64 => Dtype::F64,
            Element::FixedText(_) | Element::Text | Element::AsciiText => Dtype::Str,
        }
    }

    /// Bytes per element in the file; `None` for what stands on the heap.
    #[must_use]
    pub fn size(self) -> Option<usize> {
        match self {
            Element::Bool | Element::I8 | Element::U8 => Some(1),
            Element::I16 | Element::U16 | Element::F16 | Element::Bf16 => Some(2),
            Element::I32 | Element::U32 | Element::F32 => Some(4),
            Element::I64 | Element::U64 | Element::F64 => Some(8),
            Element::FixedText(size) => Some(size),
            Element::Text | Element::AsciiText => None,
        }
    }
}

/// Fills `out`, which has as many values as `bytes` holds elements.
///
/// # Errors
///
/// `out` is of another type, or a value is none that columns hold.
pub fn from_bytes(element: Element, bytes: &[u8], out: SliceMut<'_>) -> Result<()> {
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
                *value = signed(u64::from_le_bytes(*bytes))?;
            }
        }
        (Element::F16, SliceMut::F32(out)) => {
            for (value, bytes) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *value = half(u16::from_le_bytes(*bytes));
            }
        }
        (Element::Bf16, SliceMut::F32(out)) => {
            for (value, bytes) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *value = f32::from_bits(u32::from(u16::from_le_bytes(*bytes)) << 16);
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

/// The error for a text that is longer than a format holds, which has room for `most` of `unit` in every row.
pub(crate) fn long_text(length: usize, most: usize, unit: &str) -> FormatError {
    invalid(format!(
        "a text of {length} {unit} does not fit: this format holds texts of at most {most}; shorten it, or write the dataset in the format \
         `mcap`, `lerobot` or `lance`, which hold texts of any length"
    ))
}

/// A u64 as the i64 that columns hold.
///
/// # Errors
///
/// It is beyond the range.
pub fn signed(value: u64) -> Result<i64> {
    i64::try_from(value).map_err(|_| {
        unsupported(format!(
            "it holds the u64 {value}, and whole numbers are read up to {}; store it as text or f64",
            i64::MAX
        ))
    })
}

/// Why a column of u64 is left out, if one of its first `looked_at` values is beyond the range of i64. A look at all of them would cost
/// as much as reading the file: one that lies further behind is an error of reading it.
#[must_use]
pub fn too_large(
    looked_at: usize,
    rows: usize,
    dim: usize,
    read: impl FnOnce(Steps, SliceMut<'_>) -> Result<()>,
) -> Option<String> {
    let count = (looked_at / dim.max(1)).max(1).min(rows);
    let mut values = vec![0; count * dim];
    let error = read(Steps { first: 0, count, stride: 1 }, SliceMut::I64(&mut values)).err()?;
    error.is_unsupported().then(|| error.to_string())
}

/// Reads rows of `dim` values by `read`. The error for a u64 beyond the range of i64 has its row.
pub(crate) fn read_rows(
    steps: Steps,
    dim: usize,
    out: SliceMut<'_>,
    mut read: impl FnMut(Steps, SliceMut<'_>) -> Result<()>,
) -> Result<()> {
    let dtype = out.dtype();
    match read(steps, out) {
        Err(error) if dtype == Dtype::I64 && error.is_unsupported() => {
            let read = |steps: Steps| read(steps, SliceMut::I64(&mut vec![0; steps.count * dim]));
            let (row, error) = first_failing(steps, error, read);
            Err(error.at(format_args!("row {row}")))
        }
        read => read,
    }
}

/// The first row that `read` fails for, and why, as it does for all of `steps`.
pub fn first_failing(
    mut steps: Steps,
    mut error: FormatError,
    mut read: impl FnMut(Steps) -> Result<()>,
) -> (usize, FormatError) {
    while steps.count > 1 {
        let half = steps.count / 2;
        match read(Steps { count: half, ..steps }) {
            Err(earlier) => (steps.count, error) = (half, earlier),
            Ok(()) => (steps.first, steps.count) = (steps.first + half * steps.stride, steps.count - half),
        }
    }
    (steps.first, error)
}

/// A number of half precision: 1 bit of sign, 5 of exponent, 10 of fraction.
#[must_use]
pub fn half(bits: u16) -> f32 {
    let (sign, exponent, fraction) = (u32::from(bits >> 15) << 31, bits >> 10 & 31, u32::from(bits & 1023));
    match exponent {
        // Subnormal: so many 2⁻²⁴.
        0 => f32::from_bits(sign | (fraction as f32 / 16_777_216.0).to_bits()),
        31 => f32::from_bits(sign | 0x7f80_0000 | fraction << 13),
        exponent => f32::from_bits(sign | (u32::from(exponent) + 112) << 23 | fraction << 13),
    }
}

/// What is wrong with a text that is none.
pub const NOT_UTF8: &str = "a text is not valid UTF-8";

/// Whether it is the error of a text that is none.
#[must_use]
pub fn is_not_utf8(error: &FormatError) -> bool {
    match error {
        FormatError::Invalid(reason) => reason == NOT_UTF8,
        FormatError::At { source, .. } => is_not_utf8(source),
        _ => false,
    }
}

/// Text up to the padding.
pub(crate) fn text(bytes: &[u8]) -> Result<String> {
    let end = bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    let text = std::str::from_utf8(&bytes[..end]);
    text.map(str::to_owned).map_err(|_| invalid(NOT_UTF8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_widened_or_refused() {
        let mut out = [0i32; 2];
        from_bytes(Element::I16, &[0xff, 0xff, 1, 0], SliceMut::I32(&mut out)).unwrap();
        assert_eq!(out, [-1, 1]);
        let mut out = [0i64; 2];
        let bytes = [4_000_000_000u32.to_le_bytes(), 7u32.to_le_bytes()].concat();
        from_bytes(Element::U32, &bytes, SliceMut::I64(&mut out)).unwrap();
        assert_eq!(out, [4_000_000_000, 7]);
        let mut bytes = [(1u64 << 63) - 1, 7].map(u64::to_le_bytes).concat();
        from_bytes(Element::U64, &bytes, SliceMut::I64(&mut out)).unwrap();
        assert_eq!(out, [i64::MAX, 7]);
        bytes[7] = 0x80;
        let message = from_bytes(Element::U64, &bytes, SliceMut::I64(&mut out)).unwrap_err().to_string();
        assert!(message.contains("the u64 9295429630892703743, and whole numbers"), "{message}");
    }

    #[test]
    fn the_row_of_a_number_that_is_too_large_is_found() {
        for (rows, large) in [(1, 0), (9, 0), (9, 4), (9, 8)] {
            let mut bytes = vec![0; rows * 16];
            bytes[large * 16 + 15] = 0x80;
            let read = |steps: Steps, mut out: SliceMut<'_>| {
                (0..steps.count).try_for_each(|at| {
                    let row = (steps.first + at * steps.stride - 5) / 2;
                    let SliceMut::I64(out) = &mut out else { panic!("not i64") };
                    let out = SliceMut::I64(&mut out[at * 2..at * 2 + 2]);
                    from_bytes(Element::U64, &bytes[row * 16..row * 16 + 16], out)
                })
            };
            let steps = Steps { first: 5, count: rows, stride: 2 };
            let message =
                read_rows(steps, 2, SliceMut::I64(&mut vec![0; rows * 2]), read).unwrap_err().to_string();
            let part = format!("row {}: it holds the u64 9223372036854775808", 5 + large * 2);
            assert!(message.contains(&part), "{message}");
        }
    }

    /// All 65,536 of each.
    #[test]
    fn numbers_of_16_bits_are_read_exactly() {
        for bits in 0..=u16::MAX {
            let mut out = [0f32; 2];
            from_bytes(Element::F16, &[bits.to_le_bytes(); 2].concat(), SliceMut::F32(&mut out)).unwrap();
            let (sign, exponent) = (if bits >> 15 == 1 { -1.0 } else { 1.0 }, i32::from(bits >> 10 & 31));
            let fraction = f64::from(bits & 1023) / 1024.0;
            let expected = match exponent {
                0 => sign * fraction * 2f64.powi(-14),
                31 if fraction == 0.0 => sign * f64::INFINITY,
                31 => f64::NAN,
                _ => sign * (1.0 + fraction) * 2f64.powi(exponent - 15),
            };
            let is_same = f64::from(out[0]).to_bits() == expected.to_bits();
            assert!(is_same || out[0].is_nan() && expected.is_nan(), "{bits:#x}: {}", out[0]);
            from_bytes(Element::Bf16, &[bits.to_le_bytes(); 2].concat(), SliceMut::F32(&mut out)).unwrap();
            assert_eq!(out[1].to_bits(), u32::from(bits) << 16);
        }
    }

    #[test]
    fn text_loses_its_padding_and_must_be_utf8() {
        let mut out = [String::new(), String::new()];
        from_bytes(Element::FixedText(3), b"ab\0xyz", SliceMut::Str(&mut out)).unwrap();
        assert_eq!(out, ["ab", "xyz"]);
        assert!(from_bytes(Element::FixedText(3), b"\xff\xff\0xyz", SliceMut::Str(&mut out)).is_err());
    }
}
