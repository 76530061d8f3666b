//! Columns of a Parquet file as columns of ours: numbers, texts, and lists of as many numbers in every row.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::Path;

use parquet::basic::{ConvertedType, Type};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{ByteArray, FixedLenByteArray};
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use swm_core::Column;
use swm_data::element;
use swm_data::error::{At as _, FormatError, Result, guarded, invalid, missing, unsupported, wrong_type};
use swm_files::open_regular;

use super::codecs;
use super::images::Encoded;
use super::values::{MAX_VALUES, Values, is_half, is_unsigned, type_name};

/// An error of the crate `parquet`; what it lacks is no damage.
pub(super) fn not_parquet(error: ParquetError) -> FormatError {
    let lacking = match &error {
        ParquetError::NYI(what) => Some(what.as_str()),
        ParquetError::General(text) => text.strip_prefix("Disabled feature at compile time: "),
        _ => None,
    };
    match lacking {
        Some(what) => {
            unsupported(format!("Parquet with {what} is not read; write the table anew with pyarrow"))
        }
        None => FormatError::other(error),
    }
}

/// Whether an error is that a file has no column of which this program has values. Any other is one of a column that is there and
/// cannot be decoded.
pub(super) fn is_no_column(error: &FormatError) -> bool {
    match error {
        FormatError::At { source, .. } => is_no_column(source),
        FormatError::Missing(_) | FormatError::Unsupported(_) => true,
        _ => false,
    }
}

/// An open file of Parquet.
pub struct Table {
    reader: SerializedFileReader<File>,
    /// By name: where the column stands, and how many parts a value has.
    columns: BTreeMap<String, (usize, usize)>,
    rows: usize,
}

impl Table {
    /// Opens a file.
    ///
    /// # Errors
    ///
    /// It is no Parquet file, is damaged, or is compressed by what is not read.
    pub fn open(path: &Path) -> Result<Self> {
        let file = open_regular(path).at(path.display())?;
        let reader = guarded(|| SerializedFileReader::new(file).map_err(not_parquet));
        let reader = reader.at(path.display())?;
        codecs::check(reader.metadata()).at(path.display())?;
        let metadata = reader.metadata().file_metadata();
        let rows = usize::try_from(metadata.num_rows()).ok().filter(|&rows| rows as i64 <= MAX_VALUES);
        let rows = rows.ok_or(invalid(format!("{} rows", metadata.num_rows()))).at(path.display())?;
        let mut columns: BTreeMap<String, (usize, usize)> = BTreeMap::new();
        for (at, leaf) in metadata.schema_descr().columns().iter().enumerate() {
            if let Some(name) = leaf.path().parts().first() {
                columns.entry(name.clone()).or_insert((at, 0)).1 += 1;
            }
        }
        Ok(Self { reader, columns, rows })
    }

    /// Its rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Whether there is a column of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.columns.contains_key(name)
    }

    /// All values of a column, row after row.
    pub(super) fn column(&self, name: &str) -> Result<Column> {
        let found = self.columns.get(name).ok_or_else(|| missing(format!("there is no column `{name}`")))?;
        match *found {
            (leaf, 1) => guarded(|| self.read(leaf)),
            (_, parts) => {
                Err(unsupported(format!("its values are structures of {parts} parts, which are not read")))
            }
        }
        .at(format_args!("column `{name}`"))
    }

    /// The columns of structures and of lists, by their paths without the levels of lists, and whether their values are bytes that are no
    /// text.
    #[must_use]
    pub fn leaves(&self) -> Vec<(String, bool)> {
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let of = |leaf: &std::sync::Arc<parquet::schema::types::ColumnDescriptor>| {
            let mut parts = leaf.path().parts();
            if leaf.max_rep_level() > 0 && parts.len() > 2 {
                parts = &parts[..parts.len() - 2];
            }
            let is_text = leaf.converted_type() == ConvertedType::UTF8;
            (parts.join("/"), leaf.physical_type() == Type::BYTE_ARRAY && !is_text)
        };
        schema.columns().iter().map(of).collect()
    }

    /// All values of a leaf, row after row.
    ///
    /// # Errors
    ///
    /// They are damaged, or of a type that is not read.
    pub fn leaf(&self, leaf: usize) -> Result<Column> {
        guarded(|| self.read(leaf))
    }

    /// The bytes of all rows of a leaf.
    ///
    /// # Errors
    ///
    /// They are damaged, missing, or no bytes.
    pub fn bytes(&self, leaf: usize) -> Result<Vec<Vec<u8>>> {
        let all = guarded(|| self.read_bytes(leaf, 0..self.rows))?;
        let bytes = |(row, bytes): (usize, Option<ByteArray>)| match bytes {
            Some(bytes) => Ok(bytes.data().to_vec()),
            None => Err(missing(format!("the bytes of row {row} are missing (null)"))),
        };
        all.into_iter().enumerate().map(bytes).collect()
    }

    /// All values of a column of whole numbers, one a row; `None`: there is no such column, or it holds others.
    ///
    /// # Errors
    ///
    /// There is one, and it cannot be decoded.
    pub(super) fn integers(&self, name: &str) -> Result<Option<Vec<i64>>> {
        let numbers = match self.column(name) {
            Ok(Column::I64(values)) => values,
            Ok(Column::I32(values)) => values.into_iter().map(i64::from).collect(),
            Ok(_) => return Ok(None),
            Err(error) if is_no_column(&error) => return Ok(None),
            Err(error) => return Err(error),
        };
        Ok((numbers.len() == self.rows).then_some(numbers))
    }

    /// All values of a column of texts, one a row; `None` as of [`Table::integers`].
    ///
    /// # Errors
    ///
    /// As of [`Table::integers`].
    pub(super) fn texts(&self, name: &str) -> Result<Option<Vec<String>>> {
        match self.column(name) {
            Ok(Column::Str(texts)) => Ok((texts.len() == self.rows).then_some(texts)),
            Ok(_) => Ok(None),
            Err(error) if is_no_column(&error) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The images of rows of a column of structs of `bytes` and `path`.
    pub(super) fn images(&self, name: &str, rows: Range<usize>) -> Result<Vec<Encoded>> {
        guarded(|| self.read_images(name, rows)).at(format_args!("column `{name}`"))
    }

    fn read_images(&self, name: &str, rows: Range<usize>) -> Result<Vec<Encoded>> {
        if !self.has(name) {
            return Err(missing("it is not there"));
        }
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let part = |part| {
            let leaf = schema.columns().iter().position(|leaf| *leaf.path().parts() == [name, part]);
            leaf.map(|leaf| self.read_bytes(leaf, rows.clone())).transpose()
        };
        let (bytes, paths) = (part("bytes")?, part("path")?);
        if bytes.is_none() && paths.is_none() {
            return Err(unsupported(
                "its values are no structures of `bytes` and `path`, as LeRobot stores images",
            ));
        }
        let mut bytes = bytes.unwrap_or_default().into_iter();
        let mut paths = paths.unwrap_or_default().into_iter();
        let image = |_| match (bytes.next().flatten(), paths.next().flatten()) {
            (Some(bytes), _) => Encoded::Bytes(bytes),
            (None, Some(path)) => Encoded::File(String::from_utf8_lossy(path.data()).into_owned()),
            (None, None) => Encoded::Nothing,
        };
        Ok(rows.map(image).collect())
    }

    /// The bytes of rows of a leaf, and where they are missing.
    fn read_bytes(&self, leaf: usize, rows: Range<usize>) -> Result<Vec<Option<ByteArray>>> {
        let (mut images, mut begin) = (Vec::new(), 0_usize);
        for group in 0..self.reader.num_row_groups() {
            let group = self.reader.get_row_group(group).map_err(not_parquet)?;
            let count = usize::try_from(group.metadata().num_rows())
                .map_err(|_| invalid("a negative number of rows"))?;
            let end = begin.checked_add(count).ok_or(invalid("too many rows"))?;
            let wanted = rows.start.max(begin)..rows.end.min(end);
            if !wanted.is_empty() {
                let about = group.metadata().column(leaf).column_descr();
                let column = group.get_column_reader(leaf).map_err(not_parquet)?;
                let ColumnReader::ByteArrayColumnReader(mut reader) = column else {
                    return Err(unsupported("its images are no bytes"));
                };
                let skipped = reader.skip_records(wanted.start - begin).map_err(not_parquet)?;
                if skipped != wanted.start - begin {
                    return Err(missing(format!("row {} is not there", wanted.start)));
                }
                images.extend(Values::read(reader, about, wanted.len())?.each(about)?);
            }
            begin = end;
        }
        match images.len() == rows.len() {
            true => Ok(images),
            false => Err(missing(format!("{} of {} images are there", images.len(), rows.len()))),
        }
    }

    fn read(&self, leaf: usize) -> Result<Column> {
        let mut all: Option<Column> = None;
        for group in 0..self.reader.num_row_groups() {
            let group = self.reader.get_row_group(group).map_err(not_parquet)?;
            let chunk = group.metadata().column(leaf);
            if !(0..=MAX_VALUES).contains(&chunk.num_values()) {
                return Err(invalid(format!("{} values", chunk.num_values())));
            }
            let about = chunk.column_descr();
            let rows = usize::try_from(group.metadata().num_rows())
                .map_err(|_| invalid("a negative number of rows"))?;
            let column = group.get_column_reader(leaf).map_err(not_parquet)?;
            let part = match column {
                ColumnReader::BoolColumnReader(reader) => {
                    Column::Bool(Values::read(reader, about, rows)?.whole()?)
                }
                ColumnReader::Int32ColumnReader(reader) => {
                    let values = Values::read(reader, about, rows)?.whole()?;
                    match is_unsigned(about, 32) {
                        true => {
                            Column::I64(values.into_iter().map(|value| i64::from(value as u32)).collect())
                        }
                        false => Column::I32(values),
                    }
                }
                ColumnReader::Int64ColumnReader(reader) => {
                    let values = Values::read(reader, about, rows)?.whole()?;
                    if is_unsigned(about, 64)
                        && let Some(&large) = values.iter().find(|&&value| value < 0)
                    {
                        return element::signed(large as u64).map(|_| Column::I64(values));
                    }
                    Column::I64(values)
                }
                ColumnReader::FloatColumnReader(reader) => {
                    Column::F32(Values::read(reader, about, rows)?.with_missing(about, f32::NAN)?)
                }
                ColumnReader::DoubleColumnReader(reader) => {
                    Column::F64(Values::read(reader, about, rows)?.with_missing(about, f64::NAN)?)
                }
                ColumnReader::FixedLenByteArrayColumnReader(reader) if is_half(about) => {
                    let half = |value: FixedLenByteArray| match *value.data() {
                        [low, high] => element::half(u16::from_le_bytes([low, high])),
                        _ => f32::NAN,
                    };
                    Column::F32(Values::read(reader, about, rows)?.map(half).with_missing(about, f32::NAN)?)
                }
                ColumnReader::ByteArrayColumnReader(reader) => {
                    let all = Values::read(reader, about, rows)?;
                    let no_text = || match about.converted_type() {
                        ConvertedType::UTF8 => invalid("a text is not UTF-8"),
                        _ => unsupported("its values are bytes and no text"),
                    };
                    let texts = all
                        .with_missing(about, ByteArray::from(Vec::<u8>::new()))?
                        .into_iter()
                        .map(|text: ByteArray| text.as_utf8().map(str::to_owned).map_err(|_| no_text()));
                    Column::Str(texts.collect::<Result<_, _>>()?)
                }
                _ => {
                    let name = type_name(about);
                    return Err(unsupported(format!("values of type {name} are not supported")));
                }
            };
            match &mut all {
                None => all = Some(part),
                Some(all) => {
                    if !all.extend(part.as_slice()) {
                        return Err(wrong_type("its type changes"));
                    }
                }
            }
        }
        all.ok_or(missing("the file is empty"))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use parquet::basic::{Compression, GzipLevel, ZstdLevel};
    use parquet::data_type::{ByteArrayType, Int64Type};
    use parquet::file::properties::WriterProperties;
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    use super::*;

    #[test]
    fn tables_are_read_as_other_programs_compress_them() {
        let folder = tempfile::tempdir().unwrap();
        let values: Vec<i64> = (0..1000).map(|value| value % 7).collect();
        for compression in [
            Compression::UNCOMPRESSED,
            Compression::SNAPPY,
            Compression::ZSTD(ZstdLevel::default()),
            Compression::GZIP(GzipLevel::default()),
            // As Hadoop frames it, and old versions of Arrow did.
            Compression::LZ4,
            Compression::LZ4_RAW,
        ] {
            let path = folder.path().join("a.parquet");
            let schema = Arc::new(parse_message_type("message table { required int64 a; }").unwrap());
            let properties = Arc::new(WriterProperties::builder().set_compression(compression).build());
            let mut file =
                SerializedFileWriter::new(File::create(&path).unwrap(), schema, properties).unwrap();
            let mut group = file.next_row_group().unwrap();
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<Int64Type>().write_batch(&values, None, None).unwrap();
            column.close().unwrap();
            group.close().unwrap();
            file.close().unwrap();
            let column = Table::open(&path).unwrap().leaf(0).unwrap();
            assert_eq!(column, Column::I64(values.clone()), "{compression:?}");
        }
    }

    #[test]
    fn a_text_that_is_missing_is_empty() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.parquet");
        let schema = parse_message_type("message table { optional binary a (UTF8); }").unwrap();
        let mut file =
            SerializedFileWriter::new(File::create(&path).unwrap(), Arc::new(schema), Arc::default())
                .unwrap();
        let mut group = file.next_row_group().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        let texts = ["one", "two"].map(ByteArray::from);
        column.typed::<ByteArrayType>().write_batch(&texts, Some(&[1, 0, 1]), None).unwrap();
        column.close().unwrap();
        group.close().unwrap();
        file.close().unwrap();
        let column = Table::open(&path).unwrap().leaf(0).unwrap();
        assert_eq!(column, Column::Str(["one", "", "two"].map(str::to_owned).to_vec()));
    }

    #[test]
    fn what_the_reader_lacks_is_no_damage() {
        let lacking = ParquetError::General("Disabled feature at compile time: arrow".to_owned());
        let error = not_parquet(lacking);
        assert!(
            error.is_unsupported() && error.to_string().contains("Parquet with arrow is not read"),
            "{error}"
        );
        assert!(!not_parquet(ParquetError::EOF("cut".to_owned())).is_unsupported());
    }
}
