//! Files of rows: writing one, and reading rows of a column from those of a table. Which rows are an episode is not known
//! here.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::num::NonZeroU64;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use arrow_array::{ArrayRef, RecordBatch, UInt32Array};
use arrow_schema::Schema as ArrowSchema;
use futures::TryStreamExt as _;
use lance_core::cache::LanceCache;
use lance_encoding::decoder::{DecoderPlugins, FilterExpression};
use lance_file::reader::{FileReader, FileReaderOptions, ReaderProjection};
use lance_file::versions::{create_writer, data_file_columns, reader_projection_from_field_ids};
use lance_file::writer::{FileWriter, FileWriterOptions};
use lance_io::ReadBatchParams;
use lance_io::scheduler::{ScanScheduler, SchedulerConfig};
use lance_io::utils::CachedFileSize;
use lance_table::format::{DataFile, Fragment};

use crate::table::{DATA, FILE_VERSION, Table, wait};
use swm_data::error::{FormatError, Result, invalid, missing};

/// Bytes that a file of rows holds back until it writes a page; shared by its columns.
const HELD_BYTES: u64 = 64 << 20;
/// Bytes that are read ahead.
const AHEAD_BYTES: u64 = 64 << 20;
/// Bytes of descriptions of files that are kept.
const CACHE_BYTES: usize = 64 << 20;
/// Files that are open at once: a table may have one per episode.
const OPEN_FILES: usize = 256;
/// Rows of a batch.
const BATCH_ROWS: u32 = 4096;

/// A file of rows that is being written.
pub(crate) struct DataWriter {
    name: String,
    writer: FileWriter,
    schema: Arc<ArrowSchema>,
    rows: usize,
}

impl DataWriter {
    /// Begins the file of this name, in place of what an interrupted recording left there.
    pub(crate) fn create(table: &Table, name: &str) -> Result<Self> {
        let path = table.path(&format!("{DATA}/{name}"));
        let options =
            FileWriterOptions { data_cache_bytes: Some(HELD_BYTES), ..FileWriterOptions::default() };
        let writer = wait(async {
            let out = table.store.create(&path).await?;
            create_writer(FILE_VERSION, out, table.schema().clone(), options)
        })?;
        Ok(Self { name: name.to_owned(), writer, schema: Arc::new(table.schema().into()), rows: 0 })
    }

    /// Appends rows, a column after the other.
    pub(crate) fn append(&mut self, columns: Vec<ArrayRef>) -> Result<()> {
        let batch = RecordBatch::try_new(self.schema.clone(), columns).map_err(FormatError::other)?;
        self.rows += batch.num_rows();
        wait(self.writer.write_batch(&batch))
    }

    /// Ends the file: the fragment that it is. `about` is its description.
    pub(crate) fn finish(mut self, table: &Table, about: &[(&str, String)]) -> Result<Fragment> {
        for (key, value) in about {
            self.writer.add_schema_metadata(*key, value.clone());
        }
        let summary = wait(self.writer.finish())?;
        Ok(fragment_of(table, self.name, self.rows, summary.size_bytes.try_into().ok()))
    }
}

/// The fragment that a file of all columns is.
pub(crate) fn fragment_of(table: &Table, name: String, rows: usize, size: Option<NonZeroU64>) -> Fragment {
    let (fields, columns) = data_file_columns(FILE_VERSION, table.schema());
    let fragment = Fragment::new(table.next_id()).with_physical_rows(rows);
    fragment.with_file(name, fields, columns, FILE_VERSION, size)
}

/// Reads rows of a table; all handles share it.
#[derive(Debug)]
pub(crate) struct DataReader {
    table: Table,
    /// First row of each fragment, and the end; rows that are deleted do not count.
    firsts: Vec<usize>,
    /// By fragment and deleted row, in order: how many rows that are not deleted stand before it.
    deleted: Vec<Vec<u32>>,
    scheduler: Arc<ScanScheduler>,
    cache: LanceCache,
    open: Mutex<HashMap<(usize, usize), FileReader>>,
}

/// Rows of a table that are read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows {
    pub(crate) first: usize,
    pub(crate) count: usize,
    pub(crate) stride: usize,
}

impl DataReader {
    pub(crate) fn new(table: Table) -> Result<Self> {
        let (mut firsts, mut all_deleted) = (vec![0usize], Vec::new());
        for fragment in table.fragments() {
            let deleted = table.deleted(fragment)?;
            let rows = fragment.physical_rows.ok_or(invalid("it does not say how many rows it has"))?;
            if deleted.last().is_some_and(|&last| last as usize >= rows) {
                return Err(invalid(format!("a row is deleted that its file of {rows} rows does not have")));
            }
            let end = firsts[firsts.len() - 1].checked_add(rows - deleted.len());
            firsts.push(end.ok_or(invalid("it has more rows than can be counted"))?);
            all_deleted.push(deleted.iter().zip(0..).map(|(&row, before)| row - before).collect());
        }
        let (store, config) = (table.store.clone(), SchedulerConfig::new(AHEAD_BYTES));
        let scheduler = wait(async { Ok(ScanScheduler::new(store, config)) })?;
        let cache = LanceCache::with_capacity(CACHE_BYTES);
        Ok(Self { table, firsts, deleted: all_deleted, scheduler, cache, open: Mutex::default() })
    }

    pub(crate) fn table(&self) -> &Table {
        &self.table
    }

    pub(crate) fn rows(&self) -> usize {
        self.firsts[self.firsts.len() - 1]
    }

    /// The rows of each fragment.
    pub(crate) fn fragments(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        self.firsts.windows(2).map(|ends| ends[0]..ends[1])
    }

    /// The rows in front of which some are deleted.
    pub(crate) fn behind_deleted(&self) -> BTreeSet<usize> {
        let rows = self.firsts.iter().zip(&self.deleted);
        rows.flat_map(|(first, deleted)| deleted.iter().map(move |&before| first + before as usize)).collect()
    }

    /// Hands rows of the field with this id to `take`, array by array.
    pub(crate) fn read(
        &self,
        field: i32,
        rows: Rows,
        take: &mut dyn FnMut(&ArrayRef) -> Result<()>,
    ) -> Result<()> {
        let mut at = 0;
        while at < rows.count {
            let row = rows.first + at * rows.stride;
            let fragment = self.firsts.partition_point(|&first| first <= row) - 1;
            let Some(&end) = self.firsts.get(fragment + 1) else {
                return Err(missing(format!("it has no row {row}")));
            };
            let count = ((end - 1 - row) / rows.stride + 1).min(rows.count - at);
            let here = Rows { first: row - self.firsts[fragment], count, ..rows };
            self.read_fragment(fragment, field, here, take)?;
            at += count;
        }
        Ok(())
    }

    /// As [`Self::read`], all at once.
    pub(crate) fn read_all(&self, field: i32) -> Result<Vec<ArrayRef>> {
        let mut arrays = Vec::new();
        let rows = Rows { first: 0, count: self.rows(), stride: 1 };
        self.read(field, rows, &mut |array| {
            arrays.push(array.clone());
            Ok(())
        })?;
        Ok(arrays)
    }

    fn read_fragment(
        &self,
        fragment: usize,
        field: i32,
        rows: Rows,
        take: &mut dyn FnMut(&ArrayRef) -> Result<()>,
    ) -> Result<()> {
        let (reader, projection) = self.file(fragment, field)?;
        let deleted = &self.deleted[fragment];
        let stored = |row: usize| row + deleted.partition_point(|&before| before as usize <= row);
        let last = rows.first + (rows.count - 1) * rows.stride;
        let end = stored(last) + 1;
        if end as u64 > reader.num_rows() {
            return Err(invalid(format!("a file has {} rows, the table counts on {end}", reader.num_rows())));
        }
        let which = if end - stored(rows.first) == rows.count {
            ReadBatchParams::Range(stored(rows.first)..end)
        } else {
            let index = (0..rows.count).map(|at| stored(rows.first + at * rows.stride) as u32);
            ReadBatchParams::Indices(UInt32Array::from_iter_values(index))
        };
        let batches: Vec<RecordBatch> = wait(async {
            let all = FilterExpression::no_filter();
            let stream = reader.read_stream_projected(which, BATCH_ROWS, 1, projection, all).await?;
            stream.try_collect().await
        })?;
        let found: usize = batches.iter().map(RecordBatch::num_rows).sum();
        if found != rows.count || batches.iter().any(|batch| batch.num_columns() != 1) {
            return Err(invalid(format!("{found} rows of {}", rows.count)));
        }
        batches.iter().try_for_each(|batch| take(batch.column(0)))
    }

    /// The description in the file of a fragment.
    pub(crate) fn about(&self, fragment: usize, field: i32) -> Result<HashMap<String, String>> {
        Ok(self.file(fragment, field)?.0.schema().metadata.clone())
    }

    /// The file of a fragment that holds a field, and where it is in that.
    fn file(&self, fragment: usize, field: i32) -> Result<(FileReader, ReaderProjection)> {
        let files = &self.table.fragments()[fragment].files;
        let holds = |file: &DataFile| file.fields.contains(&field);
        let Some(index) = files.iter().position(holds) else {
            return Err(missing("a part of it is missing"));
        };
        let file = &files[index];
        let reader = self.open(fragment, index, file)?;
        let version = file.file_version().map_err(FormatError::other)?;
        let places: BTreeMap<u32, u32> = file
            .fields
            .iter()
            .zip(file.column_indices.iter())
            .filter_map(|(&field, &column)| Some((field.try_into().ok()?, column.try_into().ok()?)))
            .collect();
        let schema = self.table.schema().project_by_ids(&[field], true);
        let projection = reader_projection_from_field_ids(version, &schema, &places);
        Ok((reader, projection.map_err(FormatError::other)?))
    }

    fn open(&self, fragment: usize, index: usize, file: &DataFile) -> Result<FileReader> {
        let lock = || self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reader) = lock().get(&(fragment, index)) {
            return Ok(reader.clone());
        }
        let path = self.table.path(&format!("{DATA}/{}", file.path));
        let reader = wait(async {
            let file = self.scheduler.open_file(&path, &CachedFileSize::unknown()).await?;
            let plugins = Arc::<DecoderPlugins>::default();
            FileReader::try_open(file, None, plugins, &self.cache, FileReaderOptions::default()).await
        })?;
        let mut open = lock();
        if open.len() >= OPEN_FILES {
            open.clear();
        }
        open.insert((fragment, index), reader.clone());
        Ok(reader)
    }
}
