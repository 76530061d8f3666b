//! Columns of ours as Arrow arrays, and back: numbers, texts, and JPEG files; and their types. Nothing here knows files or
//! tables.

use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type,
    UInt32Type, UInt64Type,
};
use arrow_array::{
    Array, ArrayRef, BinaryArray, FixedSizeListArray, Float32Array, Float64Array, Int32Array, Int64Array,
    StringArray, UInt8Array,
};
use arrow_schema::{DataType, Field as ArrowField};
use crc32fast::Hasher;
use swm_core::{Column, Dtype, Field, Slice, SliceMut};
use swm_data::error::{FormatError, Result, invalid, missing, unsupported, wrong_type};
use swm_media::jpeg;

/// How single numbers of a type are stored. Bits are bytes: Lance has no lists of bits.
fn item_type(dtype: Dtype) -> DataType {
    match dtype {
        Dtype::Bool | Dtype::U8 => DataType::UInt8,
        Dtype::I32 => DataType::Int32,
        Dtype::I64 => DataType::Int64,
        Dtype::F32 => DataType::Float32,
        Dtype::F64 => DataType::Float64,
        Dtype::Str => DataType::Utf8,
    }
}

/// Whether a column's rows are JPEG files where they are no videos.
pub(crate) fn is_image(field: &Field) -> bool {
    let (Dtype::U8, &[height, width, 1 | 3]) = (field.dtype, &field.shape[..]) else { return false };
    height.max(width) <= 16_384
}

/// How a column is typed in the table. The reference has `float32` for all numbers, and reads any.
pub(crate) fn stored_type(field: &Field) -> DataType {
    match field.dtype {
        _ if is_image(field) => DataType::Binary,
        // Several texts are one, in JSON.
        Dtype::Str => DataType::Utf8,
        dtype => {
            let item = ArrowField::new("item", item_type(dtype), true);
            DataType::FixedSizeList(Arc::new(item), field.dim() as i32)
        }
    }
}

/// Rows of a column that is no image.
pub(crate) fn to_array(field: &Field, values: Slice<'_>) -> Result<ArrayRef> {
    let numbers: ArrayRef = match values {
        Slice::Bool(values) => {
            Arc::new(UInt8Array::from_iter_values(values.iter().map(|&value| u8::from(value))))
        }
        Slice::U8(values) => Arc::new(UInt8Array::from(values.to_vec())),
        Slice::I32(values) => Arc::new(Int32Array::from(values.to_vec())),
        Slice::I64(values) => Arc::new(Int64Array::from(values.to_vec())),
        Slice::F32(values) => Arc::new(Float32Array::from(values.to_vec())),
        Slice::F64(values) => Arc::new(Float64Array::from(values.to_vec())),
        Slice::Str(texts) if field.shape.is_empty() => {
            return Ok(Arc::new(StringArray::from_iter_values(texts)));
        }
        Slice::Str(texts) => {
            let rows = texts.chunks_exact(field.dim()).map(serde_json::to_string);
            let rows = rows.collect::<Result<Vec<_>, _>>()?;
            return Ok(Arc::new(StringArray::from(rows)));
        }
    };
    let item = Arc::new(ArrowField::new("item", numbers.data_type().clone(), true));
    let width = i32::try_from(field.dim()).map_err(|_| invalid("a row is too wide"))?;
    let list = FixedSizeListArray::try_new(item, width, numbers, None);
    Ok(Arc::new(list.map_err(FormatError::other)?))
}

/// Files of images as a column.
pub(crate) fn files_to_array<'a>(files: impl IntoIterator<Item = &'a [u8]>) -> ArrayRef {
    Arc::new(BinaryArray::from_iter_values(files))
}

/// Adds the values of an array to a checksum.
pub(crate) fn sum_up(checksum: &mut Hasher, array: &dyn Array) {
    match array.data_type() {
        DataType::Binary => array.as_binary::<i32>().iter().flatten().for_each(|file| checksum.update(file)),
        DataType::Utf8 => {
            array.as_string::<i32>().iter().flatten().for_each(|text| checksum.update(text.as_bytes()));
        }
        DataType::FixedSizeList(..) => sum_up(checksum, &items(array)),
        DataType::UInt8 => checksum.update(array.as_primitive::<UInt8Type>().values()),
        DataType::Int32 => checksum.update(array.as_primitive::<Int32Type>().values().inner()),
        DataType::Int64 => checksum.update(array.as_primitive::<Int64Type>().values().inner()),
        DataType::Float32 => checksum.update(array.as_primitive::<Float32Type>().values().inner()),
        DataType::Float64 => checksum.update(array.as_primitive::<Float64Type>().values().inner()),
        _ => {}
    }
}

/// The numbers of an array of lists, end to end.
fn items(array: &dyn Array) -> ArrayRef {
    let list = array.as_fixed_size_list();
    let width = list.value_length() as usize;
    list.values().slice(list.value_offset(0) as usize, list.len() * width)
}

/// The type and the width of a column of another program; the reason if it cannot be one.
pub(crate) fn infer(stored: &DataType) -> Result<(Dtype, Vec<usize>)> {
    let dtype = |stored: &DataType| match stored {
        DataType::Boolean => Ok(Dtype::Bool),
        DataType::UInt8 => Ok(Dtype::U8),
        DataType::Int8 | DataType::Int16 | DataType::Int32 | DataType::UInt16 => Ok(Dtype::I32),
        DataType::Int64 | DataType::UInt32 | DataType::UInt64 => Ok(Dtype::I64),
        DataType::Float16 | DataType::Float32 => Ok(Dtype::F32),
        DataType::Float64 => Ok(Dtype::F64),
        DataType::Utf8 | DataType::LargeUtf8 => Ok(Dtype::Str),
        other => Err(unsupported(format!("values of type {other} are not supported"))),
    };
    match stored {
        // The reference stores single numbers so.
        DataType::FixedSizeList(item, 1) => Ok((dtype(item.data_type())?, Vec::new())),
        DataType::FixedSizeList(item, width) if *width > 0 && item.data_type() != &DataType::Utf8 => {
            Ok((dtype(item.data_type())?, vec![*width as usize]))
        }
        stored => Ok((dtype(stored)?, Vec::new())),
    }
}

/// Copies the rows of an array into `out`, `[rows, …shape]` values of the field's type.
pub(crate) fn from_array(array: &ArrayRef, field: &Field, out: SliceMut<'_>) -> Result<()> {
    if is_image(field) {
        let SliceMut::U8(out) = out else { return Err(wrong_type("images are bytes")) };
        return decode(array, field, out);
    }
    let values = if matches!(array.data_type(), DataType::FixedSizeList(..)) {
        if array.null_count() > 0 {
            return Err(missing("some rows are missing"));
        }
        items(array)
    } else {
        array.clone()
    };
    let mut out = out;
    let found = column(values.as_ref(), field)?;
    match found.len() == out.len() && out.copy_from(found.as_slice()) {
        true => Ok(()),
        false => Err(wrong_type(format!(
            "{} values of {} instead of {} of {}",
            found.len(),
            found.dtype(),
            out.len(),
            out.dtype()
        ))),
    }
}

/// The values of an array as a column of the field's type.
fn column(values: &dyn Array, field: &Field) -> Result<Column> {
    // Missing numbers are NaN where there is such a thing.
    let is_real = matches!(values.data_type(), DataType::Float16 | DataType::Float32 | DataType::Float64);
    if values.null_count() > 0 && !is_real {
        return Err(missing("some values are missing"));
    }
    macro_rules! integers {
        ($stored:ty, $ours:ty) => {
            values
                .as_primitive::<$stored>()
                .values()
                .iter()
                .map(|&value| <$ours>::try_from(value).map_err(|_| invalid(format!("{value} is too large"))))
                .collect::<Result<Vec<$ours>>>()?
        };
    }
    macro_rules! reals {
        ($stored:ty, $map:expr) => {
            values.as_primitive::<$stored>().iter().map(|value| value.map_or(f32::NAN.into(), $map)).collect()
        };
    }
    Ok(match (field.dtype, values.data_type()) {
        (Dtype::Bool, DataType::Boolean) => Column::Bool(values.as_boolean().values().iter().collect()),
        (Dtype::Bool, DataType::UInt8) => Column::Bool(
            values.as_primitive::<UInt8Type>().values().iter().map(|&value| value != 0).collect(),
        ),
        (Dtype::U8, DataType::UInt8) => Column::U8(values.as_primitive::<UInt8Type>().values().to_vec()),
        (Dtype::I32, DataType::Int8) => Column::I32(integers!(Int8Type, i32)),
        (Dtype::I32, DataType::Int16) => Column::I32(integers!(Int16Type, i32)),
        (Dtype::I32, DataType::UInt16) => Column::I32(integers!(UInt16Type, i32)),
        (Dtype::I32, DataType::Int32) => Column::I32(values.as_primitive::<Int32Type>().values().to_vec()),
        (Dtype::I64, DataType::UInt32) => Column::I64(integers!(UInt32Type, i64)),
        (Dtype::I64, DataType::UInt64) => Column::I64(integers!(UInt64Type, i64)),
        (Dtype::I64, DataType::Int64) => Column::I64(values.as_primitive::<Int64Type>().values().to_vec()),
        (Dtype::F32, DataType::Float16) => Column::F32(reals!(Float16Type, f32::from)),
        (Dtype::F32, DataType::Float32) => Column::F32(reals!(Float32Type, |value| value)),
        (Dtype::F64, DataType::Float64) => Column::F64(reals!(Float64Type, |value| value)),
        (Dtype::Str, DataType::Utf8) => texts(values.as_string::<i32>().iter().flatten(), field)?,
        (Dtype::Str, DataType::LargeUtf8) => texts(values.as_string::<i64>().iter().flatten(), field)?,
        (dtype, stored) => return Err(wrong_type(format!("it holds {stored} instead of {dtype}"))),
    })
}

fn texts<'a>(rows: impl Iterator<Item = &'a str>, field: &Field) -> Result<Column> {
    if field.shape.is_empty() {
        return Ok(Column::Str(rows.map(str::to_owned).collect()));
    }
    let mut all = Vec::new();
    for row in rows {
        let texts: Vec<String> = serde_json::from_str(row)?;
        if texts.len() != field.dim() {
            return Err(wrong_type(format!("{} texts instead of {}", texts.len(), field.dim())));
        }
        all.extend(texts);
    }
    Ok(Column::Str(all))
}

/// The file of a row of images.
pub(crate) fn file(array: &dyn Array, row: usize) -> Result<&[u8]> {
    let file = match array.data_type() {
        _ if array.is_null(row) => None,
        DataType::Binary => Some(array.as_binary::<i32>().value(row)),
        DataType::LargeBinary => Some(array.as_binary::<i64>().value(row)),
        other => return Err(wrong_type(format!("it holds {other} instead of files"))),
    };
    file.ok_or(missing("a file is missing"))
}

fn decode(array: &ArrayRef, field: &Field, out: &mut [u8]) -> Result<()> {
    let &[height, width, channels] = &field.shape[..] else { return Err(wrong_type("no images")) };
    if out.len() != array.len() * field.dim() {
        return Err(invalid(format!("{} images", array.len())));
    }
    for (row, out) in out.chunks_exact_mut(field.dim()).enumerate() {
        jpeg::decode_into(file(array, row)?, [height, width, channels], out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_come_back_exactly() {
        let cases = [
            (Field::step("a", Dtype::F32, &[2]), Column::F32(vec![0.5, f32::MAX, -0.0, 1e-40])),
            (Field::step("b", Dtype::Bool, &[]), Column::Bool(vec![true, false])),
            (Field::step("c", Dtype::I64, &[1, 2]), Column::I64(vec![i64::MIN, 1, 2, i64::MAX])),
            (Field::step("d", Dtype::Str, &[]), Column::Str(vec!["é".into(), String::new()])),
            (
                Field::step("e", Dtype::Str, &[2]),
                Column::Str(["a", "", "\"", "d"].map(str::to_owned).to_vec()),
            ),
            (Field::step("f", Dtype::U8, &[2, 2, 4]), Column::U8((0..32).collect())),
        ];
        for (field, values) in cases {
            let array = to_array(&field, values.as_slice()).unwrap();
            let mut read = Column::zeros(field.dtype, values.len());
            from_array(&array, &field, read.as_slice_mut()).unwrap();
            assert_eq!(read, values, "{}", field.name);
            // A part of an array is not its beginning.
            let (half, mut read) = (values.len() / 2, Column::zeros(field.dtype, values.len() / 2));
            from_array(&array.slice(array.len() / 2, array.len() / 2), &field, read.as_slice_mut()).unwrap();
            assert_eq!(read.as_slice(), values.as_slice().range(half, half), "{}", field.name);
        }
    }

    #[test]
    fn what_is_no_column_of_ours_is_said() {
        let list =
            |item, width| DataType::FixedSizeList(Arc::new(ArrowField::new("item", item, true)), width);
        assert_eq!(infer(&list(DataType::Float32, 3)).unwrap(), (Dtype::F32, vec![3]));
        assert_eq!(infer(&list(DataType::Float64, 1)).unwrap(), (Dtype::F64, vec![]));
        assert_eq!(infer(&DataType::UInt16).unwrap(), (Dtype::I32, vec![]));
        assert!(infer(&DataType::Date32).unwrap_err().to_string().contains("Date32"));
        let missing: ArrayRef = Arc::new(Int32Array::from(vec![Some(1), None]));
        let field = Field::step("a", Dtype::I32, &[]);
        let error = from_array(&missing, &field, SliceMut::I32(&mut [0; 2])).unwrap_err();
        assert!(matches!(&error, FormatError::Missing(_)), "{error}");
        let missing: ArrayRef = Arc::new(Float32Array::from(vec![Some(1.0), None]));
        let (field, mut out) = (Field::step("a", Dtype::F32, &[]), [0.0; 2]);
        from_array(&missing, &field, SliceMut::F32(&mut out)).unwrap();
        assert!(out[0] == 1.0 && out[1].is_nan());
    }
}
