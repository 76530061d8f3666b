//! Where things stand in the file: names of the index and of our attributes, element types, chunk shapes. Facts of
//! the reference's layout, which readers and writers share; no data is read or written here.
//!
//! Every column is a dataset at the root, `[T, …shape]`, rows of all episodes end to end; `ep_len` and `ep_offset`
//! say where episodes lie. The reference takes every other root dataset for a column, so what else is to be said
//! stands in attributes of the root.

use hdf5_metno::types::{FloatSize, IntSize, TypeDescriptor};
use swm_core::{Dtype, Field};

use crate::error::{Result, unsupported};
use crate::formats::element::Element;

/// Rows of each episode, i32.
pub(super) const EP_LEN: &str = "ep_len";
/// First row of each episode, i64.
pub(super) const EP_OFFSET: &str = "ep_offset";

/// Attribute: the columns in order, with their kinds, as JSON.
pub(super) const COLUMNS_ATTRIBUTE: &str = "swm_columns";
/// Attribute: what is known of the data, as JSON. Episodes that were appended with other settings add
/// `swm_metadata_<first episode>`.
pub(super) const METADATA_ATTRIBUTE: &str = "swm_metadata";

/// Rows per chunk of scalars and vectors.
const ROWS_PER_CHUNK: usize = 1024;
/// Chunks of wide vectors hold fewer rows, so that reading one row stays cheap.
pub(super) const MAX_CHUNK_BYTES: usize = 1 << 20;
/// Rows of this size (images) are compressed, one per chunk: random access decodes nothing that is not wanted.
const IMAGE_BYTES: usize = 4096;

/// Room for one text, in bytes of UTF-8. Text of any length would stand on the file's heap, which is not safe against
/// a kill: what was written last cannot be overwritten afterwards.
pub(super) const TEXT_BYTES: usize = 256;

/// Size in bytes of one stored element.
pub(super) fn element_size(dtype: Dtype) -> usize {
    dtype.bytes().unwrap_or(TEXT_BYTES)
}

/// Whether a column is compressed, and how many of its rows make a chunk.
pub(super) fn chunking(field: &Field) -> (bool, usize) {
    let row_bytes = field.dim() * element_size(field.dtype);
    if field.shape.len() >= 2 && row_bytes >= IMAGE_BYTES && field.dtype != Dtype::Str {
        return (true, 1);
    }
    (false, (MAX_CHUNK_BYTES / row_bytes.max(1)).clamp(1, ROWS_PER_CHUNK))
}

/// The element type behind an HDF5 type, or why there is none.
pub(super) fn element_of(descriptor: &TypeDescriptor) -> Result<Element> {
    Ok(match descriptor {
        TypeDescriptor::Boolean => Element::Bool,
        TypeDescriptor::Integer(IntSize::U1) => Element::I8,
        TypeDescriptor::Integer(IntSize::U2) => Element::I16,
        TypeDescriptor::Integer(IntSize::U4) => Element::I32,
        TypeDescriptor::Integer(IntSize::U8) => Element::I64,
        TypeDescriptor::Unsigned(IntSize::U1) => Element::U8,
        TypeDescriptor::Unsigned(IntSize::U2) => Element::U16,
        TypeDescriptor::Unsigned(IntSize::U4) => Element::U32,
        TypeDescriptor::Unsigned(IntSize::U8) => Element::U64,
        TypeDescriptor::Float(FloatSize::U4) => Element::F32,
        TypeDescriptor::Float(FloatSize::U8) => Element::F64,
        TypeDescriptor::FixedAscii(size) | TypeDescriptor::FixedUnicode(size) => Element::FixedText(*size),
        TypeDescriptor::VarLenUnicode => Element::Text,
        TypeDescriptor::VarLenAscii => Element::AsciiText,
        other => return Err(unsupported(format!("elements of type {other} are not supported"))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_compressed_frame_by_frame_and_vectors_are_not() {
        assert_eq!(chunking(&Field::step("pixels", Dtype::U8, &[64, 64, 3])), (true, 1));
        assert_eq!(chunking(&Field::step("state", Dtype::F64, &[7])), (false, 1024));
        assert_eq!(chunking(&Field::step("reward", Dtype::F64, &[])), (false, 1024));
        assert_eq!(chunking(&Field::episode("variation.x", Dtype::F64, &[2, 3])), (false, 1024));
        assert_eq!(chunking(&Field::step("embedding", Dtype::F32, &[4096])), (false, 64));
    }
}
