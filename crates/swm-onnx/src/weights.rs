//! NaN in the weights of an ONNX file. Reductions of ONNX Runtime lose a NaN that is not in the first place, so that costs need
//! not show it. Reads the file's protocol buffers as far as that takes.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use crate::error::OnnxError;

// Numbers of fields in `onnx.proto`.
const MODEL_GRAPH: u64 = 7;
const GRAPH_INITIALIZER: u64 = 5;
const TENSOR_DIMS: u64 = 1;
const TENSOR_TYPE: u64 = 2;
const TENSOR_FLOATS: u64 = 4;
const TENSOR_NAME: u64 = 8;
const TENSOR_RAW: u64 = 9;
const TENSOR_DOUBLES: u64 = 10;
const TENSOR_EXTERNAL: u64 = 13;
const ENTRY_KEY: u64 = 1;
const ENTRY_VALUE: u64 = 2;
// Types of elements.
const FLOAT: u64 = 1;
const FLOAT16: u64 = 10;
const DOUBLE: u64 = 11;
const BFLOAT16: u64 = 16;

/// Refuses a file with NaN in a weight of two or more values. One value is a constant, which may be NaN on purpose.
///
/// # Errors
///
/// [`OnnxError::Model`], which names the weight; or the file cannot be read.
pub(crate) fn check_weights(path: &Path) -> Result<(), OnnxError> {
    let unreadable = |error: std::io::Error| OnnxError::unreadable(path, &error);
    let bytes = std::fs::read(path).map_err(unreadable)?;
    let graphs = fields(&bytes).filter_map(|field| field.bytes_of(MODEL_GRAPH));
    for tensor in graphs.flat_map(fields).filter_map(|field| field.bytes_of(GRAPH_INITIALIZER)) {
        let folder = path.parent().unwrap_or(Path::new("."));
        if has_nan(tensor, folder).map_err(unreadable)? {
            let name = fields(tensor).find_map(|field| field.bytes_of(TENSOR_NAME)).unwrap_or_default();
            let reason =
                format!("its weight `{}` has NaN; export a trained model", String::from_utf8_lossy(name));
            return Err(OnnxError::Model { path: path.to_owned(), reason });
        }
    }
    Ok(())
}

/// Whether a `TensorProto` of two or more values has a NaN; its data may be in another file of `folder`.
fn has_nan(tensor: &[u8], folder: &Path) -> std::io::Result<bool> {
    let (mut kind, mut count) = (0, 1u64);
    for field in fields(tensor) {
        match field {
            Field { number: TENSOR_TYPE, value: Wire::Varint(value) } => kind = value,
            Field { number: TENSOR_DIMS, value: Wire::Varint(size) } => count = count.saturating_mul(size),
            Field { number: TENSOR_DIMS, value: Wire::Bytes(mut packed) } => {
                while let Some(size) = varint(&mut packed) {
                    count = count.saturating_mul(size);
                }
            }
            _ => {}
        }
    }
    if count < 2 {
        return Ok(false);
    }
    let inside = fields(tensor).any(|field| match field {
        Field { number: TENSOR_FLOATS, value: Wire::Bytes(values) } => any_nan(FLOAT, values),
        Field { number: TENSOR_DOUBLES, value: Wire::Bytes(values) } => any_nan(DOUBLE, values),
        Field { number: TENSOR_RAW, value: Wire::Bytes(values) } => any_nan(kind, values),
        _ => false,
    });
    let is_float = [FLOAT, FLOAT16, DOUBLE, BFLOAT16].contains(&kind);
    let entries = fields(tensor).filter_map(|field| field.bytes_of(TENSOR_EXTERNAL));
    let entry = |wanted: &str| {
        entries.clone().find_map(|entry| {
            let text = |number| fields(entry).find_map(|field| field.bytes_of(number));
            (text(ENTRY_KEY)? == wanted.as_bytes()).then(|| text(ENTRY_VALUE)).flatten()
        })
    };
    let Some(location) = entry("location").filter(|_| is_float && !inside) else { return Ok(inside) };
    let number = |key| entry(key).and_then(|text| std::str::from_utf8(text).ok()?.parse::<u64>().ok());
    let mut file = File::open(folder.join(String::from_utf8_lossy(location).as_ref()))?;
    file.seek(SeekFrom::Start(number("offset").unwrap_or(0)))?;
    let mut values = Vec::new();
    file.take(number("length").unwrap_or(u64::MAX)).read_to_end(&mut values)?;
    Ok(any_nan(kind, &values))
}

/// Whether there is a NaN among little-endian values of a type of `onnx.proto`.
fn any_nan(kind: u64, values: &[u8]) -> bool {
    // Without its sign, a NaN is above infinity.
    let above = |infinity: u16| move |bytes: &[u8; 2]| u16::from_le_bytes(*bytes) & 0x7fff > infinity;
    match kind {
        FLOAT => values.as_chunks().0.iter().any(|bytes| f32::from_le_bytes(*bytes).is_nan()),
        DOUBLE => values.as_chunks().0.iter().any(|bytes| f64::from_le_bytes(*bytes).is_nan()),
        FLOAT16 => values.as_chunks().0.iter().any(above(0x7c00)),
        BFLOAT16 => values.as_chunks().0.iter().any(above(0x7f80)),
        _ => false,
    }
}

/// A field of a message.
struct Field<'a> {
    number: u64,
    value: Wire<'a>,
}

enum Wire<'a> {
    Varint(u64),
    Bytes(&'a [u8]),
    /// A number of fixed size, which nothing here needs.
    Fixed,
}

impl<'a> Field<'a> {
    /// The content, if it is the field `number` and has one.
    fn bytes_of(&self, number: u64) -> Option<&'a [u8]> {
        match self.value {
            Wire::Bytes(bytes) if self.number == number => Some(bytes),
            _ => None,
        }
    }
}

/// The fields of a message, up to the first that is damaged: ONNX Runtime has read the file before.
fn fields(mut message: &[u8]) -> impl Iterator<Item = Field<'_>> + Clone {
    std::iter::from_fn(move || {
        let tag = varint(&mut message)?;
        let value = match tag & 7 {
            0 => Wire::Varint(varint(&mut message)?),
            1 => message.split_off(..8).map(|_| Wire::Fixed)?,
            2 => {
                let length = usize::try_from(varint(&mut message)?).ok()?;
                Wire::Bytes(message.split_off(..length)?)
            }
            5 => message.split_off(..4).map(|_| Wire::Fixed)?,
            _ => return None,
        };
        Some(Field { number: tag >> 3, value })
    })
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let byte = *bytes.split_off_first()?;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}
