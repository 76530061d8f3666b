//! Types of stored elements, and their values as columns.

pub use crate::formats::element::{Element, LOOKED_AT, failing_row, from_bytes, half, signed, too_large};
