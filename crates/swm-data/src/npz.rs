//! Archives of NumPy: the arrays of an archive, of which rows are read by position. No pickled objects.

pub use crate::formats::npz::{Array, ArrayType, check_end, members};
