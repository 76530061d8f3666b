//! Reading recorded episodes: what an open dataset holds, and single columns of it at a stride.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Map, Value as Json};

use super::{DataError, EncodedRows, Metadata};
use crate::batch::{Batch, Field, Schema, SliceMut};
use crate::error::BoxError;

/// Rows of one episode: `first`, `first + stride`, …, `count` of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    /// The first row, counted from the start of the episode.
    pub first: usize,
    /// How many rows.
    pub count: usize,
    /// Distance between two rows, at least 1.
    pub stride: usize,
}

impl Steps {
    /// The row after the last one that is read; `None` if it does not fit a `usize`.
    pub fn end(&self) -> Option<usize> {
        match self.count {
            0 => Some(self.first),
            count => (count - 1).checked_mul(self.stride)?.checked_add(self.first)?.checked_add(1),
        }
    }
}

/// What an open dataset holds: known once it is open, the same for all of its handles. Cheap to clone.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct DatasetInfo {
    /// The file or folder; a name for datasets in memory.
    pub path: Arc<Path>,
    /// The name of its format.
    pub format: &'static str,
    /// The columns.
    pub schema: Arc<Schema>,
    /// The number of rows, by episode.
    pub lengths: Arc<[usize]>,
    /// The runs that recorded it, each with its first episode; empty for files without metadata.
    pub runs: Arc<[(u64, Metadata)]>,
    /// Rows per second, where files of another program say so; those of this one say it in `runs`.
    pub rows_per_second: Option<f64>,
    /// Columns that this program cannot represent, with the reason.
    pub skipped: Arc<[(String, String)]>,
    /// For columns of a dataset of another program, the names in its files.
    pub mapping: Arc<[(String, String)]>,
    /// What a user of a dataset of another program has to know about it, one line each.
    pub notes: Arc<[String]>,
    /// How it was opened, where something was asked for: by name, as whoever opens it again has to ask.
    pub opening: Arc<Map<String, Json>>,
    /// Whether it holds checksums, which [`Dataset::check_episode`] compares.
    pub has_checksums: bool,
}

impl DatasetInfo {
    /// A dataset without runs, skipped columns or checksums.
    pub fn new(path: &Path, format: &'static str, schema: Arc<Schema>, lengths: Vec<usize>) -> Self {
        Self {
            path: path.into(),
            format,
            schema,
            lengths: lengths.into(),
            runs: Arc::default(),
            rows_per_second: None,
            skipped: Arc::default(),
            mapping: Arc::default(),
            notes: Arc::default(),
            opening: Arc::default(),
            has_checksums: false,
        }
    }

    /// The same with other columns.
    pub fn with_schema(&self, schema: Arc<Schema>) -> Self {
        Self { schema, ..self.clone() }
    }

    /// A column, by its position; the caller knows that it exists.
    pub fn field(&self, column: usize) -> &Field {
        &self.schema.fields()[column]
    }

    /// The error for damage in one column of an episode.
    pub fn damaged(&self, column: usize, episode: usize, reason: impl Into<BoxError>) -> DataError {
        let column = self.schema.fields().get(column).map_or("?", |field| &field.name).to_owned();
        self.damaged_part(Some(column), episode, reason.into())
    }

    /// The error for damage in an episode.
    pub fn damaged_episode(&self, episode: usize, reason: impl Into<BoxError>) -> DataError {
        self.damaged_part(None, episode, reason.into())
    }

    fn damaged_part(&self, column: Option<String>, episode: usize, reason: BoxError) -> DataError {
        DataError::damaged_part(&self.path, column, Some(episode), reason)
    }
}

/// What the rows of a dataset are a function of: files, and what is taken from them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Origin {
    /// The files and folders that it is read from, or their addresses.
    pub paths: Vec<PathBuf>,
    /// How they were opened, and which of their episodes and columns it has.
    pub choice: String,
}

impl Origin {
    /// All of the dataset at `info.path`.
    #[must_use]
    pub fn of(info: &DatasetInfo) -> Self {
        Self { paths: vec![info.path.to_path_buf()], choice: format!("opened {:?};", info.opening) }
    }

    /// That of a dataset that makes this of the rows.
    #[must_use]
    pub fn with(mut self, choice: fmt::Arguments<'_>) -> Self {
        self.choice.push_str(&format!("{choice};"));
        self
    }

    /// That of a dataset made of two.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.paths.extend(other.paths);
        self.with(format_args!("and ({})", other.choice))
    }
}

/// An open dataset: rows of recorded episodes.
///
/// A new kind of dataset has a [`DatasetInfo`], reads rows of its columns, and shares itself; everything else follows
/// from these.
pub trait Dataset: Send {
    /// What it holds.
    fn info(&self) -> &DatasetInfo;

    /// Reads rows of column `column` (its position in the schema) into `out`, `[steps.count, …shape]` values of the
    /// column's type. Column, episode and rows exist, and `out` fits: [`Dataset::read_column`] has checked it.
    ///
    /// # Errors
    ///
    /// What is stored is damaged or cannot be read.
    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError>;

    /// A second handle on the same open dataset, for another thread. Costs scratch memory only.
    fn share(&self) -> Box<dyn Dataset>;

    /// What its rows are a function of, so that what is computed from them can be kept. `None`: not of files alone.
    fn origin(&self) -> Option<Origin> {
        None
    }

    /// Chooses the look of images that are rendered when they are read: reads that follow show a look that depends on `key` (of the
    /// loader: epoch and clip) alone; with `None`, that of the recording. Datasets without looks do nothing.
    ///
    /// # Errors
    ///
    /// A look cannot be rendered.
    fn dress(&mut self, _key: Option<[u64; 2]>) -> Result<(), DataError> {
        Ok(())
    }

    /// Compares what is stored of an episode with its checksums, if there are any.
    ///
    /// # Errors
    ///
    /// [`DataError::Damaged`] at the first difference, or it cannot be read.
    fn check_episode(&mut self, _episode: usize) -> Result<(), DataError> {
        Ok(())
    }

    /// Compares checksums that cover more than an episode, such as its index, if there are any.
    ///
    /// # Errors
    ///
    /// [`DataError::Damaged`] at the first difference, or it cannot be read.
    fn check_whole(&mut self) -> Result<(), DataError> {
        Ok(())
    }

    /// How a column is stored, if each of its rows is stored on its own: its format and compression in words. Columns of one
    /// type, shape and encoding hold the same bytes for the same values, so that a copy may pass them on as they are.
    fn encoding(&self, _column: usize) -> Option<&str> {
        None
    }

    /// Reads the stored form of rows of a column that has an [`Dataset::encoding`]; what was in `out` is replaced. Column,
    /// episode and rows exist.
    ///
    /// # Errors
    ///
    /// What is stored is damaged or cannot be read, or the column has no encoding.
    fn encoded_rows(
        &mut self,
        column: usize,
        _episode: usize,
        _rows: Range<usize>,
        _out: &mut EncodedRows,
    ) -> Result<(), DataError> {
        let name = &self.info().field(column).name;
        Err(DataError::request(
            self.path(),
            format!("rows of column `{name}` are not stored each on its own"),
        ))
    }

    /// As [`Dataset::rows`], for unchecked requests.
    ///
    /// # Errors
    ///
    /// [`DataError::Request`] for what does not exist or does not fit, and those of [`Dataset::rows`].
    fn read_column(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        check_request(self.info(), column, episode, steps, &out)?;
        self.rows(column, episode, steps, out)
    }

    /// Reads rows of one episode into `out`, whose schema names the wanted columns; its old rows are replaced.
    ///
    /// # Errors
    ///
    /// No such column, one of another type or shape, and those of [`Dataset::read_column`].
    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), DataError> {
        let steps = Steps { first: rows.start, count: rows.len(), stride: 1 };
        check_size(self.info(), episode, steps, out.schema())?;
        out.resize(steps.count);
        let wanted = out.schema().clone();
        for (target, field) in wanted.fields().iter().enumerate() {
            let column = find_column(self.info(), field)?;
            self.read_column(column, episode, steps, out.column_mut(target))?;
        }
        Ok(())
    }

    /// The file or folder.
    fn path(&self) -> &Path {
        &self.info().path
    }

    /// The columns.
    fn schema(&self) -> &Arc<Schema> {
        &self.info().schema
    }

    /// The number of episodes.
    fn num_episodes(&self) -> usize {
        self.info().lengths.len()
    }

    /// The number of rows of one episode; 0 for one that does not exist.
    fn episode_len(&self, episode: usize) -> usize {
        self.info().lengths.get(episode).copied().unwrap_or(0)
    }

    /// The metadata of the first run; `None` for files without metadata.
    fn metadata(&self) -> Option<&Metadata> {
        self.info().runs.first().map(|(_, metadata)| metadata)
    }
}

impl<D: Dataset + ?Sized> Dataset for Box<D> {
    fn info(&self) -> &DatasetInfo {
        (**self).info()
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        (**self).rows(column, episode, steps, out)
    }

    fn share(&self) -> Box<dyn Dataset> {
        (**self).share()
    }

    fn origin(&self) -> Option<Origin> {
        (**self).origin()
    }

    fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), DataError> {
        (**self).dress(key)
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        (**self).check_episode(episode)
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        (**self).check_whole()
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        (**self).encoding(column)
    }

    fn encoded_rows(
        &mut self,
        column: usize,
        episode: usize,
        rows: Range<usize>,
        out: &mut EncodedRows,
    ) -> Result<(), DataError> {
        (**self).encoded_rows(column, episode, rows, out)
    }
}

/// Refuses columns, episodes and rows that do not exist, and an `out` of another size or type than they need.
fn check_request(
    info: &DatasetInfo,
    column: usize,
    episode: usize,
    steps: Steps,
    out: &SliceMut<'_>,
) -> Result<(), DataError> {
    let refuse = |reason| Err(DataError::request(&info.path, reason));
    let schema = &info.schema;
    let Some(field) = schema.fields().get(column) else {
        return refuse(format!("column {column} of {} does not exist", schema.fields().len()));
    };
    check_rows(info, episode, steps)?;
    if out.dtype() != field.dtype || out.len() != steps.count * field.dim() {
        return refuse(format!(
            "{} values of {} cannot hold {} rows of column `{}`, {} {:?}",
            out.len(),
            out.dtype(),
            steps.count,
            field.name,
            field.dtype,
            field.shape
        ));
    }
    Ok(())
}

/// Refuses an episode and rows that do not exist.
fn check_rows(info: &DatasetInfo, episode: usize, steps: Steps) -> Result<(), DataError> {
    let refuse = |reason| Err(DataError::request(&info.path, reason));
    let Some(&len) = info.lengths.get(episode) else {
        return refuse(format!("episode {episode} of {} does not exist", info.lengths.len()));
    };
    if steps.stride == 0 || steps.end().is_none_or(|end| end > len) {
        let Steps { first, count, stride } = steps;
        return refuse(format!(
            "episode {episode} has {len} rows, too few for {count} from row {first} on at a stride of {stride}"
        ));
    }
    Ok(())
}

/// So many bytes may be read at once, whatever the size of the file…
const MAX_BYTES: u64 = 1 << 30;
/// …and so many times its size: no compression of images or numbers of any use saves more.
const MAX_RATIO: u64 = 1 << 16;

/// Refuses rows that do not exist, and more of them than the file can hold: a few bytes can claim a trillion rows.
fn check_size(info: &DatasetInfo, episode: usize, steps: Steps, wanted: &Schema) -> Result<(), DataError> {
    check_rows(info, episode, steps)?;
    let bytes = (wanted.row_bytes() as u64).saturating_mul(steps.count as u64);
    if bytes <= MAX_BYTES {
        return Ok(());
    }
    match std::fs::metadata(&info.path) {
        Ok(file) if file.is_file() && bytes / MAX_RATIO > file.len() => Err(DataError::damaged(
            &info.path,
            format!(
                "episode {episode} claims {} rows, {} GB, more than a file of {} bytes can hold",
                steps.count,
                bytes >> 30,
                file.len()
            ),
        )),
        _ => Ok(()),
    }
}

/// The column that has the name, type and shape of `wanted`.
fn find_column(info: &DatasetInfo, wanted: &Field) -> Result<usize, DataError> {
    let refused = |reason| DataError::request(&info.path, reason);
    let column = info.schema.require(&wanted.name).map_err(|error| refused(error.to_string()))?;
    let stored = &info.schema.fields()[column];
    if stored.dtype != wanted.dtype || stored.shape != wanted.shape {
        return Err(refused(format!(
            "column `{}` holds {} {:?}, not {} {:?}",
            wanted.name, stored.dtype, stored.shape, wanted.dtype, wanted.shape
        )));
    }
    Ok(column)
}
