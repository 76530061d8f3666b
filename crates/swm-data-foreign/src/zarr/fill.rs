//! What the elements of a chunk are that is not stored.

use serde_json::Value as Json;
use swm_data::element::{Element, half};
use swm_data::error::{Result, unsupported};
use swm_data::npz::ArrayType;

/// The bytes of an element, little-endian. Nothing stands for zero.
pub(super) fn bytes(elements: ArrayType, value: &Json) -> Result<Vec<u8>> {
    let unknown = || unsupported(format!("its fill value {value} is not read"));
    let zeros = || vec![0; elements.size()];
    if value.is_null() {
        return Ok(zeros());
    }
    let ArrayType::Plain(element) = elements else {
        return if value == "" || value == 0 { Ok(zeros()) } else { Err(unknown()) };
    };
    let found = match element {
        Element::Bool => {
            value.as_bool().or_else(|| value.as_u64().map(|bit| bit != 0)).map(|bit| vec![u8::from(bit)])
        }
        Element::F16 | Element::Bf16 | Element::F32 | Element::F64 => float(element, value),
        // Bytes in base64: zeros.
        Element::FixedText(_) => {
            let is_zeros = |text: &str| text.bytes().all(|digit| matches!(digit, b'A' | b'='));
            (value == 0 || value.as_str().is_some_and(is_zeros)).then(zeros)
        }
        Element::Text | Element::AsciiText => None,
        whole => integer(value).and_then(|value| narrowed(value, whole.size()?)),
    };
    found.ok_or_else(unknown)
}

fn integer(value: &Json) -> Option<i128> {
    let whole = |value: f64| (value.fract() == 0.0 && value.abs() < 1e15).then_some(value as i128);
    value
        .as_i64()
        .map(i128::from)
        .or_else(|| value.as_u64().map(i128::from))
        .or_else(|| value.as_f64().and_then(whole))
}

/// The lowest bytes of a number that fits, with a sign or without.
fn narrowed(value: i128, size: usize) -> Option<Vec<u8>> {
    let bound = 1_i128 << (8 * size);
    (-bound / 2 <= value && value < bound).then(|| value.to_le_bytes()[..size].to_vec())
}

/// A number, or its name, or its bits as hexadecimal text.
fn float(element: Element, value: &Json) -> Option<Vec<u8>> {
    let size = element.size()?;
    if let Some(bits) = value.as_str().and_then(|text| text.strip_prefix("0x")) {
        let bits = u64::from_str_radix(bits, 16).ok()?;
        return narrowed(i128::from(bits), size);
    }
    let number = match value.as_str() {
        Some("NaN") => f64::NAN,
        Some("Infinity") => f64::INFINITY,
        Some("-Infinity") => f64::NEG_INFINITY,
        Some(_) => return None,
        None => value.as_f64()?,
    };
    match element {
        Element::F64 => Some(number.to_le_bytes().to_vec()),
        Element::F32 => Some((number as f32).to_le_bytes().to_vec()),
        Element::Bf16 => Some((number as f32).to_le_bytes()[2..].to_vec()),
        // Of half precision, the nearest: descriptions have the shortest text of a number, or all of its digits.
        _ => {
            const NAN: u16 = 0x7e00;
            const INFINITY: u16 = 0x7c00;
            let distance = |&bits: &u16| (f64::from(half(bits)) - number.abs()).abs();
            let finite = || (0..INFINITY).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let bits = if number.is_nan() {
                NAN
            } else if number.is_infinite() {
                INFINITY
            } else {
                finite()?
            };
            let sign = if number.is_sign_negative() && !number.is_nan() { 0x8000 } else { 0 };
            Some((bits | sign).to_le_bytes().to_vec())
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn values_are_numbers_names_or_bits() {
        let of = |element, value| bytes(ArrayType::Plain(element), &value).ok();
        assert_eq!(of(Element::F32, json!(1.5)), Some(1.5_f32.to_le_bytes().to_vec()));
        assert_eq!(of(Element::F32, json!("-Infinity")), Some(f32::NEG_INFINITY.to_le_bytes().to_vec()));
        assert_eq!(of(Element::F64, json!("0x7ff8000000000000")), Some(f64::NAN.to_le_bytes().to_vec()));
        assert_eq!(of(Element::F16, json!("NaN")), Some(vec![0, 0x7e]));
        assert_eq!(of(Element::F16, json!(0.3)), Some(vec![0xcd, 0x34]));
        assert_eq!(of(Element::F16, json!(-0.5)), Some(vec![0, 0xb8]));
        assert_eq!(of(Element::FixedText(2), json!("AAA=")), Some(vec![0, 0]));
        assert_eq!(of(Element::U8, json!(255)), Some(vec![255]));
        assert_eq!(of(Element::U8, json!(256)), None);
        assert_eq!(of(Element::I16, json!(-2)), Some(vec![254, 255]));
        assert_eq!(of(Element::I64, json!(null)), Some(vec![0; 8]));
        assert_eq!(of(Element::Bool, json!(true)), Some(vec![1]));
        assert_eq!(of(Element::F32, json!("AAA=")), None);
        assert_eq!(bytes(ArrayType::Wide(2), &json!("")).ok(), Some(vec![0; 8]));
    }
}
