//! One typed array with a shape: the value of a factor, an option, or a field of a recorded row.

use std::fmt;

use super::{Column, Dtype, Slice};
use crate::error::BatchError;

/// A typed array; a scalar has the empty shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    /// Shape; its product is the number of values.
    pub shape: Vec<usize>,
    /// The values, row-major.
    pub data: Column,
}

impl Value {
    /// A scalar.
    pub fn scalar<T: super::Element>(value: T) -> Self {
        Self { shape: Vec::new(), data: T::into_column(vec![value]) }
    }

    /// A one-dimensional array.
    pub fn vector<T: super::Element>(values: &[T]) -> Self {
        Self { shape: vec![values.len()], data: T::into_column(values.to_vec()) }
    }

    /// A copy of borrowed values.
    pub fn from_slice(shape: &[usize], values: Slice<'_>) -> Self {
        Self { shape: shape.to_vec(), data: values.to_column() }
    }

    /// All values as `f64`. `what` names them in errors.
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: it is text.
    pub fn to_f64s(&self, what: &str) -> Result<Vec<f64>, BatchError> {
        let slice = self.data.as_slice();
        (0..slice.len())
            .map(|i| slice.as_f64(i))
            .collect::<Option<_>>()
            .ok_or_else(|| wrong(what, "numbers", "text".to_owned()))
    }

    /// The same numbers as another type and shape, for values that come from files and command lines. Refuses
    /// what would change them: a fraction for an integer, a number outside the type's range, another count.
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: the numbers are not as many as `shape` asks for, or the type cannot hold them.
    pub fn cast(&self, what: &str, dtype: Dtype, shape: &[usize]) -> Result<Self, BatchError> {
        let dim: usize = shape.iter().product();
        if self.data.len() != dim {
            return Err(wrong(what, &describe(dtype, shape), format!("{} value(s)", self.data.len())));
        }
        if self.data.dtype() == dtype {
            return Ok(Self { shape: shape.to_vec(), data: self.data.clone() });
        }
        let numbers = self.to_f64s(what)?;
        let integer = |words: &str, low: f64, high: f64| -> Result<(), BatchError> {
            match numbers.iter().find(|v| v.fract() != 0.0 || **v < low || **v > high) {
                Some(bad) => Err(wrong(what, &format!("whole numbers {words}"), bad.to_string())),
                None => Ok(()),
            }
        };
        let data = match dtype {
            Dtype::F64 => Column::F64(numbers),
            Dtype::F32 => Column::F32(numbers.iter().map(|&v| v as f32).collect()),
            Dtype::U8 => {
                integer("between 0 and 255", 0.0, 255.0)?;
                Column::U8(numbers.iter().map(|&v| v as u8).collect())
            }
            Dtype::I32 => {
                integer("of 32 bits", f64::from(i32::MIN), f64::from(i32::MAX))?;
                Column::I32(numbers.iter().map(|&v| v as i32).collect())
            }
            Dtype::I64 => {
                integer("of up to 53 bits", -(2f64.powi(53)), 2f64.powi(53))?;
                Column::I64(numbers.iter().map(|&v| v as i64).collect())
            }
            Dtype::Bool => {
                integer("0 or 1", 0.0, 1.0)?;
                Column::Bool(numbers.iter().map(|&v| v == 1.0).collect())
            }
            Dtype::Str => return Err(wrong(what, "text", "numbers".to_owned())),
        };
        Ok(Self { shape: shape.to_vec(), data })
    }

    /// JSON: a number, a text, or a flat list.
    pub fn to_json(&self) -> serde_json::Value {
        let list: Vec<serde_json::Value> = match &self.data {
            Column::Bool(v) => v.iter().map(|&x| x.into()).collect(),
            Column::U8(v) => v.iter().map(|&x| x.into()).collect(),
            Column::I32(v) => v.iter().map(|&x| x.into()).collect(),
            Column::I64(v) => v.iter().map(|&x| x.into()).collect(),
            Column::F32(v) => v.iter().map(|&x| shortest(x).into()).collect(),
            Column::F64(v) => v.iter().map(|&x| x.into()).collect(),
            Column::Str(v) => v.iter().map(|x| x.as_str().into()).collect(),
        };
        match (self.shape.is_empty(), list) {
            (true, mut list) if list.len() == 1 => list.remove(0),
            (_, list) => list.into(),
        }
    }

    /// From JSON: a number, a boolean, a text, or a list (of lists) of numbers.
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: `null`, an object, or text within a list.
    pub fn from_json(what: &str, json: &serde_json::Value) -> Result<Self, BatchError> {
        use serde_json::Value as Json;
        match json {
            Json::Bool(flag) => Ok(Self::scalar(*flag)),
            Json::String(text) => Ok(Self::scalar(text.clone())),
            Json::Number(number) => Ok(match number.as_i64() {
                Some(integer) => Self::scalar(integer),
                None => Self::scalar(number.as_f64().unwrap_or(f64::NAN)),
            }),
            Json::Array(items) => {
                let mut numbers = Vec::new();
                for item in items {
                    numbers.extend(Self::from_json(what, item)?.to_f64s(what)?);
                }
                Ok(Self::vector(&numbers))
            }
            Json::Null | Json::Object(_) => {
                Err(wrong(what, "a number or a list of numbers", json.to_string()))
            }
        }
    }
}

/// Scalars, arrays and lists of numbers, each by the type that values of files and command lines have.
macro_rules! from_numbers {
    ($($number:ty => $stored:ty),*) => {$(
        impl From<$number> for Value {
            fn from(value: $number) -> Self {
                Self::scalar(<$stored>::from(value))
            }
        }

        impl<const N: usize> From<[$number; N]> for Value {
            fn from(values: [$number; N]) -> Self {
                Self::vector(&values.map(<$stored>::from))
            }
        }

        impl From<&[$number]> for Value {
            fn from(values: &[$number]) -> Self {
                Self::vector(&values.iter().map(|&value| <$stored>::from(value)).collect::<Vec<_>>())
            }
        }

        impl From<Vec<$number>> for Value {
            fn from(values: Vec<$number>) -> Self {
                Self::from(values.as_slice())
            }
        }
    )*};
}

from_numbers!(bool => bool, u8 => u8, i32 => i64, i64 => i64, f32 => f32, f64 => f64);

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::scalar(text.to_owned())
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Self::scalar(text)
    }
}

/// The `f64` with the shortest decimal form that is this `f32`, so that 0.1f32 prints as 0.1.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| f64::from(value))
}

fn describe(dtype: Dtype, shape: &[usize]) -> String {
    match shape {
        [] => format!("one {dtype}"),
        shape => format!("{dtype} {shape:?}"),
    }
}

fn wrong(name: &str, expected: &str, found: String) -> BatchError {
    BatchError::WrongValue { name: name.to_owned(), expected: expected.to_owned(), found }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.to_json())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn casting_keeps_numbers_or_refuses() {
        let value = Value::vector(&[255.0, 0.0, 1.0]);
        assert_eq!(value.cast("c", Dtype::U8, &[3]).unwrap(), Value::vector(&[255u8, 0, 1]));
        assert!(Value::vector(&[256.0]).cast("c", Dtype::U8, &[1]).is_err());
        assert!(Value::scalar(0.5).cast("c", Dtype::I64, &[]).is_err());
        let message = value.cast("block.color", Dtype::U8, &[2]).unwrap_err().to_string();
        assert!(message.contains("block.color") && message.contains("uint8 [2]"), "{message}");
    }

    #[test]
    fn json_round_trips() {
        for value in [Value::scalar(3i64), Value::scalar(0.25), Value::vector(&[1.5, -2.0])] {
            assert_eq!(Value::from_json("x", &value.to_json()).unwrap(), value);
        }
        assert_eq!(Value::scalar(0.1f32).to_json().to_string(), "0.1");
    }
}
