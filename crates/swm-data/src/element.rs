//! Types of stored elements, and their values as columns.

pub use crate::formats::element::{
    Element, LOOKED_AT, NOT_UTF8, first_failing, from_bytes, half, is_not_utf8, signed, too_large,
};
