//! Writing Parquet files: numbers, texts, and lists of as many numbers in every row. The other
//! direction is `table`.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{
    BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type,
};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};
use swm_core::{Dtype, Slice};
use swm_data::error::{FormatError, Result};

/// One column of a file.
#[derive(Debug)]
pub(super) struct ColumnOut<'a> {
    pub(super) name: String,
    /// All rows, end to end.
    pub(super) values: Slice<'a>,
    /// How many values a row has as a list; `None` for rows of one value that is no list.
    pub(super) list: Option<usize>,
}

impl<'a> ColumnOut<'a> {
    /// A column of single values.
    pub(super) fn scalar(name: impl Into<String>, values: Slice<'a>) -> Self {
        Self { name: name.into(), values, list: None }
    }
}

/// The bytes of a file with these columns, which have equally many rows. `about` is its description, by key.
pub(super) fn bytes(columns: &[ColumnOut<'_>], about: &[(&str, String)]) -> Result<Vec<u8>> {
    let mut writer = TableWriter::new(Vec::new(), columns, about)?;
    writer.group(columns)?;
    writer.finish()
}

/// A file that is being written, group of rows by group of rows.
pub(super) struct TableWriter<W: Write + Send>(SerializedFileWriter<W>);

impl<W: Write + Send> TableWriter<W> {
    /// Begins a file with the columns of these names and types. `about` is its description, by key.
    pub(super) fn new(out: W, columns: &[ColumnOut<'_>], about: &[(&str, String)]) -> Result<Self> {
        begin(out, columns, about).map(Self).map_err(FormatError::other)
    }

    /// Writes rows of all columns.
    pub(super) fn group(&mut self, columns: &[ColumnOut<'_>]) -> Result<()> {
        group(&mut self.0, columns).map_err(FormatError::other)
    }

    /// Ends the file.
    pub(super) fn finish(self) -> Result<W> {
        self.0.into_inner().map_err(FormatError::other)
    }
}

fn begin<W: Write + Send>(
    out: W,
    columns: &[ColumnOut<'_>],
    about: &[(&str, String)],
) -> Result<SerializedFileWriter<W>, ParquetError> {
    let fields = columns.iter().map(column_type).collect::<Result<_, _>>()?;
    let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
    let about = about.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(about))
        .build();
    SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties))
}

fn group<W: Write + Send>(
    writer: &mut SerializedFileWriter<W>,
    columns: &[ColumnOut<'_>],
) -> Result<(), ParquetError> {
    let mut group = writer.next_row_group()?;
    for column in columns {
        let Some(mut out) = group.next_column()? else {
            return Err(ParquetError::General("fewer columns than the schema has".to_owned()));
        };
        write_values(&mut out, column)?;
        out.close()?;
    }
    group.close().map(|_| ())
}

fn column_type(column: &ColumnOut<'_>) -> Result<TypePtr, ParquetError> {
    let (physical, converted) = match column.values.dtype() {
        Dtype::Bool => (Physical::BOOLEAN, ConvertedType::NONE),
        Dtype::U8 => (Physical::INT32, ConvertedType::UINT_8),
        Dtype::I32 => (Physical::INT32, ConvertedType::NONE),
        Dtype::I64 => (Physical::INT64, ConvertedType::NONE),
        Dtype::F32 => (Physical::FLOAT, ConvertedType::NONE),
        Dtype::F64 => (Physical::DOUBLE, ConvertedType::NONE),
        Dtype::Str => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
    };
    let value = |name| {
        let builder = Type::primitive_type_builder(name, physical).with_converted_type(converted);
        builder.with_repetition(Repetition::REQUIRED).build().map(Arc::new)
    };
    if column.list.is_none() {
        return value(&column.name);
    }
    // The three levels that the format prescribes for lists.
    let list = Type::group_type_builder("list").with_repetition(Repetition::REPEATED);
    let list = list.with_fields(vec![value("element")?]).build()?;
    let outer = Type::group_type_builder(&column.name).with_repetition(Repetition::REQUIRED);
    let outer = outer.with_converted_type(ConvertedType::LIST).with_logical_type(Some(LogicalType::List));
    outer.with_fields(vec![Arc::new(list)]).build().map(Arc::new)
}

fn write_values(out: &mut SerializedColumnWriter<'_>, column: &ColumnOut<'_>) -> Result<(), ParquetError> {
    let list = column.list;
    match column.values {
        Slice::Bool(values) => put::<BoolType>(out, values, list),
        Slice::U8(values) => {
            put::<Int32Type>(out, &values.iter().map(|&value| i32::from(value)).collect::<Vec<_>>(), list)
        }
        Slice::I32(values) => put::<Int32Type>(out, values, list),
        Slice::I64(values) => put::<Int64Type>(out, values, list),
        Slice::F32(values) => put::<FloatType>(out, values, list),
        Slice::F64(values) => put::<DoubleType>(out, values, list),
        Slice::Str(values) => {
            let values: Vec<_> = values.iter().map(|text| ByteArray::from(text.as_str())).collect();
            put::<ByteArrayType>(out, &values, list)
        }
    }
}

fn put<T: DataType>(
    out: &mut SerializedColumnWriter<'_>,
    values: &[T::T],
    list: Option<usize>,
) -> Result<(), ParquetError> {
    let levels = list.map(|width| {
        let repeats: Vec<i16> = (0..values.len()).map(|at| i16::from(at % width.max(1) != 0)).collect();
        (vec![1i16; values.len()], repeats)
    });
    let (depths, repeats) = levels
        .as_ref()
        .map_or((None, None), |(depths, repeats)| (Some(depths.as_slice()), Some(repeats.as_slice())));
    out.typed::<T>().write_batch(values, depths, repeats).map(|_| ())
}
