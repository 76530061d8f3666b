//! Typed storage of one column, and borrowed slices of it. Nothing here knows names or shapes: see `schema`.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The element type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Dtype {
    /// `true` or `false`.
    Bool,
    /// Unsigned 8-bit integers: pixels, colors.
    U8,
    /// Signed 32-bit integers: lengths and indices of dataset files.
    I32,
    /// Signed 64-bit integers: discrete actions, counters, identifiers.
    I64,
    /// 32-bit floats: actions and observations of most environments.
    F32,
    /// 64-bit floats: simulator states.
    F64,
    /// UTF-8 text. Never used in a hot path.
    Str,
}

impl Dtype {
    /// The name that numpy gives this type (`uint8`, `float64`, …), which files and JSON use.
    pub fn name(self) -> &'static str {
        match self {
            Dtype::Bool => "bool",
            Dtype::U8 => "uint8",
            Dtype::I32 => "int32",
            Dtype::I64 => "int64",
            Dtype::F32 => "float32",
            Dtype::F64 => "float64",
            Dtype::Str => "string",
        }
    }

    /// Bytes of one value; `None` for text, which has any length.
    pub fn bytes(self) -> Option<usize> {
        match self {
            Dtype::Bool | Dtype::U8 => Some(1),
            Dtype::I32 | Dtype::F32 => Some(4),
            Dtype::I64 | Dtype::F64 => Some(8),
            Dtype::Str => None,
        }
    }
}

impl fmt::Display for Dtype {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A Rust type that a column can hold.
pub trait Element: Clone + Default + PartialEq + fmt::Debug + Send + Sync + 'static {
    /// Its [`Dtype`].
    const DTYPE: Dtype;
    /// Takes ownership of the values.
    fn into_column(values: Vec<Self>) -> Column;
    /// The slice, if it has this type.
    fn of(slice: Slice<'_>) -> Option<&[Self]>;
    /// The mutable slice, if it has this type.
    fn of_mut(slice: SliceMut<'_>) -> Option<&mut [Self]>;
}

macro_rules! column_types {
    ($($variant:ident: $type:ty),* $(,)?) => {
        /// The values of one column, row after row.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        pub enum Column { $(#[doc = concat!("Values of type `", stringify!($type), "`.")] $variant(Vec<$type>)),* }

        /// A borrowed range of a column.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum Slice<'a> { $(#[doc = concat!("Values of type `", stringify!($type), "`.")] $variant(&'a [$type])),* }

        /// A mutably borrowed range of a column.
        #[derive(Debug, PartialEq)]
        pub enum SliceMut<'a> { $(#[doc = concat!("Values of type `", stringify!($type), "`.")] $variant(&'a mut [$type])),* }

        $(impl Element for $type {
            const DTYPE: Dtype = Dtype::$variant;
            fn into_column(values: Vec<Self>) -> Column { Column::$variant(values) }
            fn of(slice: Slice<'_>) -> Option<&[Self]> {
                if let Slice::$variant(values) = slice { Some(values) } else { None }
            }
            fn of_mut(slice: SliceMut<'_>) -> Option<&mut [Self]> {
                if let SliceMut::$variant(values) = slice { Some(values) } else { None }
            }
        })*

        impl Column {
            /// `len` default values (zero, `false`, empty text).
            pub fn zeros(dtype: Dtype, len: usize) -> Self {
                match dtype { $(Dtype::$variant => Column::$variant(vec![Default::default(); len])),* }
            }
            /// Its element type.
            pub fn dtype(&self) -> Dtype {
                match self { $(Column::$variant(_) => Dtype::$variant),* }
            }
            /// The number of values.
            pub fn len(&self) -> usize {
                match self { $(Column::$variant(values) => values.len()),* }
            }
            /// All values.
            pub fn as_slice(&self) -> Slice<'_> {
                match self { $(Column::$variant(values) => Slice::$variant(values)),* }
            }
            /// All values, mutably.
            pub fn as_slice_mut(&mut self) -> SliceMut<'_> {
                match self { $(Column::$variant(values) => SliceMut::$variant(values)),* }
            }
            /// Forgets the values and keeps the memory.
            pub fn clear(&mut self) {
                match self { $(Column::$variant(values) => values.clear()),* }
            }
            /// Appends values of the same type; `false` if the types differ, and nothing is appended.
            #[must_use]
            pub fn extend(&mut self, slice: Slice<'_>) -> bool {
                match (self, slice) {
                    $((Column::$variant(values), Slice::$variant(new)) => values.extend_from_slice(new),)*
                    _ => return false,
                }
                true
            }
            /// Changes the length; new values are zero.
            pub fn resize(&mut self, len: usize) {
                match self { $(Column::$variant(values) => values.resize(len, Default::default())),* }
            }
        }

        impl<'a> Slice<'a> {
            /// Its element type.
            pub fn dtype(&self) -> Dtype {
                match self { $(Slice::$variant(_) => Dtype::$variant),* }
            }
            /// The number of values.
            pub fn len(&self) -> usize {
                match self { $(Slice::$variant(values) => values.len()),* }
            }
            /// Values `start..start + len`. Panics when out of range, as slices do.
            pub fn range(self, start: usize, len: usize) -> Slice<'a> {
                match self { $(Slice::$variant(values) => Slice::$variant(&values[start..start + len])),* }
            }
            /// A copy that owns its values.
            pub fn to_column(self) -> Column {
                match self { $(Slice::$variant(values) => Column::$variant(values.to_vec())),* }
            }
        }

        impl<'a> SliceMut<'a> {
            /// Its element type.
            pub fn dtype(&self) -> Dtype {
                match self { $(SliceMut::$variant(_) => Dtype::$variant),* }
            }
            /// The number of values.
            pub fn len(&self) -> usize {
                match self { $(SliceMut::$variant(values) => values.len()),* }
            }
            /// The same values for a shorter time.
            pub fn reborrow(&mut self) -> SliceMut<'_> {
                match self { $(SliceMut::$variant(values) => SliceMut::$variant(values)),* }
            }
            /// The same values, read-only.
            pub fn as_slice(&self) -> Slice<'_> {
                match self { $(SliceMut::$variant(values) => Slice::$variant(values)),* }
            }
            /// Two disjoint parts: the first `at` values and the rest.
            pub fn split_at(self, at: usize) -> (SliceMut<'a>, SliceMut<'a>) {
                match self { $(SliceMut::$variant(values) => {
                    let (left, right) = values.split_at_mut(at);
                    (SliceMut::$variant(left), SliceMut::$variant(right))
                }),* }
            }
            /// Copies values of the same type and number; `false` (and no change) otherwise.
            #[must_use]
            pub fn copy_from(&mut self, source: Slice<'_>) -> bool {
                if self.len() != source.len() {
                    return false;
                }
                match (self, source) {
                    $((SliceMut::$variant(values), Slice::$variant(new)) => values.clone_from_slice(new),)*
                    _ => return false,
                }
                true
            }
        }
    };
}

column_types! { Bool: bool, U8: u8, I32: i32, I64: i64, F32: f32, F64: f64, Str: String }

impl Column {
    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> Slice<'a> {
    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values as `T`, if that is their type.
    pub fn get<T: Element>(self) -> Option<&'a [T]> {
        T::of(self)
    }

    /// Value `index` as a number (`true` is 1); `None` for text.
    pub fn as_f64(&self, index: usize) -> Option<f64> {
        Some(match self {
            Slice::Bool(values) => f64::from(u8::from(values[index])),
            Slice::U8(values) => f64::from(values[index]),
            Slice::I32(values) => f64::from(values[index]),
            Slice::I64(values) => values[index] as f64,
            Slice::F32(values) => f64::from(values[index]),
            Slice::F64(values) => values[index],
            Slice::Str(_) => return None,
        })
    }

    /// Whether every floating-point value is finite; true for other types.
    pub fn is_finite(&self) -> bool {
        match self {
            Slice::F32(values) => values.iter().all(|v| v.is_finite()),
            Slice::F64(values) => values.iter().all(|v| v.is_finite()),
            _ => true,
        }
    }
}

impl SliceMut<'_> {
    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Marks every value as missing: NaN for floats, -1 for signed integers, zero or empty for the rest.
    pub fn fill_missing(&mut self) {
        match self {
            SliceMut::F32(values) => values.fill(f32::NAN),
            SliceMut::F64(values) => values.fill(f64::NAN),
            SliceMut::I32(values) => values.fill(-1),
            SliceMut::I64(values) => values.fill(-1),
            SliceMut::U8(values) => values.fill(0),
            SliceMut::Bool(values) => values.fill(false),
            SliceMut::Str(values) => values.iter_mut().for_each(String::clear),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_grows_only_by_its_own_type() {
        let mut column = Column::zeros(Dtype::F32, 2);
        assert!(column.extend(Slice::F32(&[1.0])));
        assert!(!column.extend(Slice::F64(&[1.0])));
        assert_eq!(column, Column::F32(vec![0.0, 0.0, 1.0]));
    }

    #[test]
    fn missing_values_are_recognizable() {
        let mut floats = Column::zeros(Dtype::F64, 1);
        floats.as_slice_mut().fill_missing();
        assert!(floats.as_slice().as_f64(0).is_some_and(f64::is_nan));
        let mut integers = Column::zeros(Dtype::I64, 1);
        integers.as_slice_mut().fill_missing();
        assert_eq!(integers, Column::I64(vec![-1]));
    }
}
