//! Where things stand in the file: names of the index and of our attributes, element types, chunk shapes. Facts of
//! the reference's layout, which readers and writers share; no data is read or written here.
//!
//! Every column is a dataset at the root, `[T, …shape]`, rows of all episodes end to end; `ep_len` and `ep_offset`
//! say where episodes lie. The reference takes every other root dataset for a column, so what else is to be said
//! stands in attributes of the root.

use hdf5_metno::Datatype;
use hdf5_metno::types::{FloatSize, IntSize, TypeDescriptor};
use swm_core::{Dtype, Field};

use super::ffi::{self, StoredType};
use super::handles::library_error;
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
pub(super) fn element_of(dtype: &Datatype) -> Result<Element> {
    let stored = ffi::stored_type(dtype);
    let none = |name: String| Err(unsupported(format!("elements of type {name} are not supported")));
    match &stored {
        StoredType::Float { size: 2, parts: [15, 10, 5, 0, 10] } => return Ok(Element::F16),
        StoredType::Float { size: 2, parts: [15, 7, 8, 0, 7] } => return Ok(Element::Bf16),
        // How h5py stores bfloat16 of the package ml_dtypes: the only elements of two bytes of which it knows nothing else.
        StoredType::Opaque { size: 2, tag } if tag.is_empty() => return Ok(Element::Bf16),
        StoredType::Opaque { size, tag } => return none(format!("opaque ({size} bytes, tag `{tag}`)")),
        StoredType::Float { size, .. } if ![4, 8].contains(size) => {
            return none(format!("float of {} bits", 8 * size));
        }
        _ => {}
    }
    Ok(match dtype.to_descriptor() {
        Ok(TypeDescriptor::Boolean) => Element::Bool,
        Ok(TypeDescriptor::Integer(IntSize::U1)) => Element::I8,
        Ok(TypeDescriptor::Integer(IntSize::U2)) => Element::I16,
        Ok(TypeDescriptor::Integer(IntSize::U4)) => Element::I32,
        Ok(TypeDescriptor::Integer(IntSize::U8)) => Element::I64,
        Ok(TypeDescriptor::Unsigned(IntSize::U1)) => Element::U8,
        Ok(TypeDescriptor::Unsigned(IntSize::U2)) => Element::U16,
        Ok(TypeDescriptor::Unsigned(IntSize::U4)) => Element::U32,
        Ok(TypeDescriptor::Unsigned(IntSize::U8)) => Element::U64,
        Ok(TypeDescriptor::Float(FloatSize::U4)) => Element::F32,
        Ok(TypeDescriptor::Float(FloatSize::U8)) => Element::F64,
        Ok(TypeDescriptor::FixedAscii(size) | TypeDescriptor::FixedUnicode(size)) => Element::FixedText(size),
        Ok(TypeDescriptor::VarLenUnicode) => Element::Text,
        Ok(TypeDescriptor::VarLenAscii) => Element::AsciiText,
        Ok(other) => return none(other.to_string()),
        Err(error) => match stored {
            StoredType::Other(name) => return none(format!("{name} ({})", library_error(error))),
            _ => return Err(library_error(error)),
        },
    })
}

/// Whether elements are bytes of which the library knows nothing, so that it cannot convert them.
pub(super) fn is_opaque(dtype: &Datatype) -> bool {
    matches!(ffi::stored_type(dtype), StoredType::Opaque { .. })
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
