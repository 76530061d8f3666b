//! Rows of numbers and texts as JSON objects, which Foxglove plots: one member per column, a value or a flat list.
//! Numbers come back exactly; what JSON has no number for is `null` (NaN) or a text (infinities).

use crate::error::{Result, wrong_type};
use serde_json::{Map, Number, Value as Json};
use swm_core::{Column, Field, Slice};

/// The columns of one row.
pub(super) fn to_json<'a>(columns: impl Iterator<Item = (&'a Field, Slice<'a>)>) -> Vec<u8> {
    let mut members = Map::new();
    for (field, values) in columns {
        let value = |at: usize| match values {
            Slice::Bool(values) => values[at].into(),
            Slice::U8(values) => values[at].into(),
            Slice::I32(values) => values[at].into(),
            Slice::I64(values) => values[at].into(),
            Slice::F32(values) => real(f64::from(values[at])),
            Slice::F64(values) => real(values[at]),
            Slice::Str(values) => Json::String(values[at].clone()),
        };
        let json = match field.shape.is_empty() {
            true => value(0),
            false => (0..values.len()).map(value).collect(),
        };
        members.insert(field.name.clone(), json);
    }
    Json::Object(members).to_string().into_bytes()
}

fn real(value: f64) -> Json {
    match Number::from_f64(value) {
        Some(number) => Json::Number(number),
        None if value.is_nan() => Json::Null,
        None => Json::String(if value > 0.0 { "Infinity" } else { "-Infinity" }.to_owned()),
    }
}

/// Appends the columns of one row.
pub(super) fn from_json(bytes: &[u8], fields: &[&Field], columns: &mut [Column]) -> Result<()> {
    let members: Map<String, Json> = serde_json::from_slice(bytes)?;
    for (field, column) in fields.iter().zip(columns) {
        let Field { name, dtype, shape, .. } = field;
        let wrong = || wrong_type(format!("column `{name}` does not hold {dtype} {shape:?}"));
        let value = members.get(&field.name).ok_or_else(wrong)?;
        let single = std::slice::from_ref(value);
        let values = if field.shape.is_empty() { single } else { value.as_array().ok_or_else(wrong)? };
        if values.len() != field.dim() {
            return Err(wrong());
        }
        for value in values {
            let taken = match column {
                Column::Bool(out) => value.as_bool().map(|value| out.push(value)),
                Column::U8(out) => integer(value).map(|value| out.push(value)),
                Column::I32(out) => integer(value).map(|value| out.push(value)),
                Column::I64(out) => value.as_i64().map(|value| out.push(value)),
                Column::F32(out) => from_real(value).map(|value| out.push(value as f32)),
                Column::F64(out) => from_real(value).map(|value| out.push(value)),
                Column::Str(out) => value.as_str().map(|value| out.push(value.to_owned())),
            };
            taken.ok_or_else(wrong)?;
        }
    }
    Ok(())
}

fn integer<T: TryFrom<i64>>(value: &Json) -> Option<T> {
    value.as_i64().and_then(|value| T::try_from(value).ok())
}

fn from_real(value: &Json) -> Option<f64> {
    match value {
        Json::Null => Some(f64::NAN),
        Json::String(text) if text == "Infinity" => Some(f64::INFINITY),
        Json::String(text) if text == "-Infinity" => Some(f64::NEG_INFINITY),
        value => value.as_f64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use swm_core::Dtype;

    #[test]
    fn rows_come_back_exactly() {
        let fields = [
            Field::step("a", Dtype::F32, &[3]),
            Field::step("b", Dtype::I64, &[]),
            Field::step("c", Dtype::F64, &[2]),
        ];
        let values = [
            Column::F32(vec![0.1, f32::NAN, f32::MIN_POSITIVE]),
            Column::I64(vec![i64::MIN]),
            Column::F64(vec![f64::NEG_INFINITY, 1.0 / 3.0]),
        ];
        let json = to_json(fields.iter().zip(values.iter().map(Column::as_slice)));
        let mut read = fields.clone().map(|field| Column::zeros(field.dtype, 0));
        from_json(&json, &fields.each_ref(), &mut read).unwrap();
        assert_eq!(format!("{read:?}"), format!("{values:?}"));
        for wrong in [
            "{}",
            "[]",
            r#"{"a": [1, 2], "b": 0, "c": [0, 0]}"#,
            r#"{"a": [1, 2, 3], "b": 0.5, "c": [0, 0]}"#,
        ] {
            let mut read = fields.clone().map(|field| Column::zeros(field.dtype, 0));
            assert!(from_json(wrong.as_bytes(), &fields.each_ref(), &mut read).is_err(), "{wrong}");
        }
    }
}
