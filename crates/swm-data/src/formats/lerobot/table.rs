//! Columns of a Parquet file as columns of ours: numbers, texts, and lists of as many numbers in every row.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::Path;

use crate::error::{At as _, FormatError, Result, guarded, invalid, missing, unsupported, wrong_type};
use crate::formats::disk::open_regular;
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::file::reader::{FileReader, SerializedFileReader};
use swm_core::Column;

/// More values than this in a column of one file are taken for damage: the head of a file may claim any number.
const MAX_VALUES: i64 = 1 << 28;

/// An open file.
pub(super) struct Table {
    reader: SerializedFileReader<File>,
    /// By name: where the column stands.
    columns: BTreeMap<String, usize>,
    rows: usize,
}

impl Table {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = open_regular(path).at(path.display())?;
        let reader = guarded(|| SerializedFileReader::new(file).map_err(FormatError::other));
        let reader = reader.at(path.display())?;
        let metadata = reader.metadata().file_metadata();
        let rows = usize::try_from(metadata.num_rows()).ok().filter(|&rows| rows as i64 <= MAX_VALUES);
        let rows = rows.ok_or(invalid(format!("{} rows", metadata.num_rows()))).at(path.display())?;
        let leaves = metadata.schema_descr().columns().iter().enumerate();
        // The first leaf of a name: lists have just one.
        let columns = leaves
            .rev()
            .filter_map(|(at, leaf)| leaf.path().parts().first().map(|name| (name.clone(), at)))
            .collect();
        Ok(Self { reader, columns, rows })
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Whether there is a column of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.columns.contains_key(name)
    }

    /// All values of a column, row after row.
    pub(super) fn column(&self, name: &str) -> Result<Column> {
        let &leaf = self.columns.get(name).ok_or_else(|| missing(format!("there is no column `{name}`")))?;
        guarded(|| self.read(leaf)).at(format_args!("column `{name}`"))
    }

    /// The encoded images of rows of a column of structs of `bytes` and `path`.
    pub(super) fn images(&self, name: &str, rows: Range<usize>) -> Result<Vec<ByteArray>> {
        guarded(|| self.read_images(name, rows)).at(format_args!("column `{name}`"))
    }

    fn read_images(&self, name: &str, rows: Range<usize>) -> Result<Vec<ByteArray>> {
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let leaf = schema.columns().iter().position(|leaf| *leaf.path().parts() == [name, "bytes"]);
        let leaf = leaf.ok_or(missing("it holds no encoded images"))?;
        let (mut images, mut begin) = (Vec::new(), 0_usize);
        for group in 0..self.reader.num_row_groups() {
            let group = self.reader.get_row_group(group).map_err(FormatError::other)?;
            let count = usize::try_from(group.metadata().num_rows())
                .map_err(|_| invalid("a negative number of rows"))?;
            let end = begin.checked_add(count).ok_or(invalid("too many rows"))?;
            let wanted = rows.start.max(begin)..rows.end.min(end);
            if !wanted.is_empty() {
                let depth = group.metadata().column(leaf).column_descr().max_def_level() > 0;
                let column = group.get_column_reader(leaf).map_err(FormatError::other)?;
                let ColumnReader::ByteArrayColumnReader(mut reader) = column else {
                    return Err(unsupported("its images are no bytes"));
                };
                let skipped = reader.skip_records(wanted.start - begin).map_err(FormatError::other)?;
                if skipped != wanted.start - begin {
                    return Err(missing(format!("row {} is not there", wanted.start)));
                }
                images.extend(values(reader, wanted.len(), depth, false)?);
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
            let group = self.reader.get_row_group(group).map_err(FormatError::other)?;
            let chunk = group.metadata().column(leaf);
            if !(0..=MAX_VALUES).contains(&chunk.num_values()) {
                return Err(invalid(format!("{} values", chunk.num_values())));
            }
            let depth = chunk.column_descr().max_def_level() > 0;
            let lists = chunk.column_descr().max_rep_level() > 0;
            let rows = usize::try_from(group.metadata().num_rows())
                .map_err(|_| invalid("a negative number of rows"))?;
            let column = group.get_column_reader(leaf).map_err(FormatError::other)?;
            let part = match column {
                ColumnReader::BoolColumnReader(reader) => Column::Bool(values(reader, rows, depth, lists)?),
                ColumnReader::Int32ColumnReader(reader) => Column::I32(values(reader, rows, depth, lists)?),
                ColumnReader::Int64ColumnReader(reader) => Column::I64(values(reader, rows, depth, lists)?),
                ColumnReader::FloatColumnReader(reader) => Column::F32(values(reader, rows, depth, lists)?),
                ColumnReader::DoubleColumnReader(reader) => Column::F64(values(reader, rows, depth, lists)?),
                ColumnReader::ByteArrayColumnReader(reader) => {
                    let texts = values(reader, rows, depth, lists)?.into_iter().map(|text| {
                        text.as_utf8().map(str::to_owned).map_err(|_| invalid("a text is not UTF-8"))
                    });
                    Column::Str(texts.collect::<Result<_, _>>()?)
                }
                _ => return Err(unsupported("values of its type are not supported")),
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

fn values<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    rows: usize,
    has_depth: bool,
    has_lists: bool,
) -> Result<Vec<T::T>> {
    let (mut values, mut depths, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
    let mut done = 0;
    while done < rows {
        let read = reader.read_records(
            rows - done,
            has_depth.then_some(&mut depths),
            has_lists.then_some(&mut repeats),
            &mut values,
        );
        let (records, ..) = read.map_err(FormatError::other)?;
        if records == 0 {
            return Err(missing(format!("{done} of {rows} rows are there")));
        }
        if values.len() as i64 > MAX_VALUES {
            return Err(invalid(format!("{} values", values.len())));
        }
        done += records;
    }
    match has_depth && depths.len() != values.len() {
        true => Err(missing("some values are missing")),
        false => Ok(values),
    }
}
