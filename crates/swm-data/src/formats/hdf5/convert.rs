//! From the stored form of elements (little-endian bytes) to column values.

use swm_core::SliceMut;

use super::layout::Element;

/// Fills `out`, which has as many values as `bytes` holds elements.
pub(in crate::formats) fn from_bytes(
    element: Element,
    bytes: &[u8],
    out: SliceMut<'_>,
) -> Result<(), String> {
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
        (element, out) => return Err(format!("{element:?} elements were asked for as {}", out.dtype())),
    }
    Ok(())
}

/// Text up to the padding.
pub(super) fn text(bytes: &[u8]) -> Result<String, String> {
    let end = bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    let text = std::str::from_utf8(&bytes[..end]);
    text.map(str::to_owned).map_err(|_| "a text is not valid UTF-8".to_owned())
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
