//! What every format offers beyond the core's `EpisodeSink` and `EpisodeSource`: reading single columns at a stride,
//! a second handle for another thread, and the write modes.

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

use swm_core::error::BoxError;
use swm_core::{
    Batch, Contents, Dtype, EpisodeSink, EpisodeSource, Field, Metadata, Schema, Slice, SliceMut,
};

use crate::error::DataError;

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

/// What a dataset is, beyond its rows: known once it is open, the same for all of its handles. Cheap to clone.
#[derive(Clone, Debug)]
pub struct About {
    /// The file or folder.
    pub path: Arc<Path>,
    /// The name of its format.
    pub format: &'static str,
    /// Columns, episodes, runs.
    pub contents: Contents,
    /// Columns that this program cannot represent, with the reason.
    pub skipped: Arc<[(String, String)]>,
    /// Whether it holds checksums, which [`Dataset::check_episode`] compares.
    pub has_checksums: bool,
}

impl About {
    /// A dataset without runs, skipped columns or checksums.
    pub fn new(path: &Path, format: &'static str, schema: Arc<Schema>, lengths: Vec<usize>) -> Self {
        let contents = Contents { schema, lengths: lengths.into(), runs: Arc::default() };
        Self { path: path.into(), format, contents, skipped: Arc::default(), has_checksums: false }
    }

    /// The same with other columns.
    pub fn with_schema(&self, schema: Arc<Schema>) -> Self {
        let mut about = self.clone();
        about.contents.schema = schema;
        about
    }

    /// A column, by its position; the caller knows that it exists.
    pub fn field(&self, column: usize) -> &Field {
        &self.contents.schema.fields()[column]
    }

    /// What is stored of an episode in a column is damaged.
    pub fn damaged(&self, column: usize, episode: usize, reason: impl fmt::Display) -> DataError {
        let name = self.contents.schema.fields().get(column).map_or("?", |field| &field.name);
        DataError::damaged(&self.path, format!("column `{name}`, episode {episode}: {reason}"))
    }

    /// What is stored of an episode is damaged.
    pub fn damaged_episode(&self, episode: usize, reason: impl fmt::Display) -> DataError {
        DataError::damaged(&self.path, format!("episode {episode}: {reason}"))
    }
}

/// An open dataset.
///
/// A new kind of dataset has an [`About`], gives rows of its columns, and shares itself; all else follows from these. Behind
/// a box or a reference, it is the core's [`EpisodeSource`].
pub trait Dataset: Send {
    /// What it is.
    fn about(&self) -> &About;

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

    /// Compares what is stored of an episode with its checksums, if there are any.
    ///
    /// # Errors
    ///
    /// [`DataError::Damaged`] at the first difference, or it cannot be read.
    fn check_episode(&mut self, _episode: usize) -> Result<(), DataError> {
        Ok(())
    }

    /// As [`Dataset::rows`], for requests of any origin.
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
        check_request(self.about(), column, episode, steps, &out)?;
        self.rows(column, episode, steps, out)
    }

    /// Reads rows of one episode into `out`, whose schema names the wanted columns; its old rows are replaced.
    ///
    /// # Errors
    ///
    /// No such column, one of another type or shape, and those of [`Dataset::read_column`].
    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), DataError> {
        let steps = Steps { first: rows.start, count: rows.len(), stride: 1 };
        out.resize(steps.count);
        let wanted = out.schema().clone();
        for (target, field) in wanted.fields().iter().enumerate() {
            let column = find_column(self.about(), field)?;
            self.read_column(column, episode, steps, out.column_mut(target))?;
        }
        Ok(())
    }

    /// Columns, episodes, runs.
    fn contents(&self) -> &Contents {
        &self.about().contents
    }

    /// The columns.
    fn schema(&self) -> &Arc<Schema> {
        &self.contents().schema
    }

    /// The number of episodes.
    fn num_episodes(&self) -> usize {
        self.contents().lengths.len()
    }

    /// The number of rows of one episode; 0 for one that does not exist.
    fn episode_len(&self, episode: usize) -> usize {
        self.contents().len_of(episode)
    }

    /// What is known of the data; `None` for files that say nothing of themselves.
    fn metadata(&self) -> Option<&Metadata> {
        self.contents().metadata()
    }

    /// The file or folder.
    fn path(&self) -> &Path {
        &self.about().path
    }

    /// The name of its format.
    fn format(&self) -> &'static str {
        self.about().format
    }

    /// The runs that were recorded into it, each with its first episode; empty for files that say nothing of themselves.
    fn runs(&self) -> &[(u64, Metadata)] {
        &self.about().contents.runs
    }

    /// Whether the dataset holds checksums, which [`Dataset::check_episode`] compares.
    fn has_checksums(&self) -> bool {
        self.about().has_checksums
    }

    /// Columns of the file that this program cannot represent, with the reason.
    fn skipped(&self) -> &[(String, String)] {
        &self.about().skipped
    }
}

impl EpisodeSource for Box<dyn Dataset> {
    fn contents(&self) -> &Contents {
        self.as_ref().contents()
    }

    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError> {
        Ok(self.as_mut().read(episode, rows, out)?)
    }
}

impl EpisodeSource for &mut (dyn Dataset + '_) {
    fn contents(&self) -> &Contents {
        (**self).contents()
    }

    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError> {
        Ok((**self).read(episode, rows, out)?)
    }
}

/// A dataset that is being recorded.
pub trait DatasetWriter: EpisodeSink {
    /// Episodes that the file holds: before `begin`, those that were there; then also the written ones.
    fn num_episodes(&self) -> u64;

    /// Appends rows to the open episode; the first call opens one. An episode may come in as many pieces as memory asks
    /// for: files hold the same whatever the pieces.
    ///
    /// # Errors
    ///
    /// The rows have other columns than were committed, or cannot be written. The open episode is then lost, those
    /// before it are not.
    fn write_rows(&mut self, rows: &Batch) -> Result<(), BoxError>;

    /// Ends the open episode. When it returns, the episode is safe: a crash cannot lose it.
    ///
    /// # Errors
    ///
    /// As of [`DatasetWriter::write_rows`].
    fn end_episode(&mut self) -> Result<(), BoxError>;
}

/// How a dataset is written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WriteOptions {
    /// What to do about a dataset that exists.
    pub mode: WriteMode,
    /// Quality of images from 1 to 100, in formats that lose some: JPEG's own scale; for videos, 1 is the quantizer 51,
    /// 100 the quantizer 12. Default: 95 for JPEG, 85 for videos.
    pub quality: Option<u8>,
    /// Frames from one key frame of a video to the next. Default: 10. More is smaller, and slower to read at random.
    pub key_frame_period: Option<u32>,
    /// Frames per second that a video tells its players. Default: 25.
    pub frames_per_second: Option<f64>,
}

impl From<WriteMode> for WriteOptions {
    fn from(mode: WriteMode) -> Self {
        Self { mode, ..Self::default() }
    }
}

/// What to do about a file that exists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WriteMode {
    /// Continue it; create it if it does not exist.
    #[default]
    Append,
    /// Replace it.
    Overwrite,
    /// Refuse.
    Error,
}

impl WriteMode {
    /// All modes, in the order of the help text.
    pub const ALL: [WriteMode; 3] = [WriteMode::Append, WriteMode::Overwrite, WriteMode::Error];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            WriteMode::Append => "append",
            WriteMode::Overwrite => "overwrite",
            WriteMode::Error => "error",
        }
    }
}

impl fmt::Display for WriteMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for WriteMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let known = Self::ALL.into_iter().find(|mode| mode.name() == text);
        known.ok_or_else(|| format!("unknown write mode `{text}`; use append, overwrite or error"))
    }
}

/// Refuses columns, episodes and rows that do not exist, and an `out` of another size or type than they need.
fn check_request(
    about: &About,
    column: usize,
    episode: usize,
    steps: Steps,
    out: &SliceMut<'_>,
) -> Result<(), DataError> {
    let refuse = |reason| Err(DataError::request(&about.path, reason));
    let Contents { schema, lengths, .. } = &about.contents;
    let Some(field) = schema.fields().get(column) else {
        return refuse(format!("column {column} of {} does not exist", schema.fields().len()));
    };
    let Some(&len) = lengths.get(episode) else {
        return refuse(format!("episode {episode} of {} does not exist", lengths.len()));
    };
    if steps.stride == 0 || steps.end().is_none_or(|end| end > len) {
        let Steps { first, count, stride } = steps;
        return refuse(format!(
            "episode {episode} has {len} rows, too few for {count} from row {first} on at a stride of {stride}"
        ));
    }
    if out.dtype() != field.dtype || out.len() != steps.count * field.width() {
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

/// What is said of stored bytes whose checksum is another.
pub const CHANGED: &str = "its checksum is wrong, it was changed after it was written";

/// Copies rows of `width` values from `source`, which begins at the episode's first row. The caller has checked that
/// they exist and that `out` fits.
pub fn copy_rows(source: Slice<'_>, width: usize, steps: Steps, mut out: SliceMut<'_>) {
    const FITS: &str = "the caller has checked type and size";
    if steps.stride == 1 {
        assert!(out.copy_from(source.range(steps.first * width, steps.count * width)), "{FITS}");
        return;
    }
    for row in 0..steps.count {
        let (mut one, rest) = out.split_at(width);
        out = rest;
        assert!(one.copy_from(source.range((steps.first + row * steps.stride) * width, width)), "{FITS}");
    }
}

/// Bytes of rows that are held at once where episodes of any length are copied.
const PIECE_BYTES: usize = 32 << 20;
/// A text counts as so many bytes.
const TEXT_BYTES: usize = 64;
/// Rows to a piece at most, however small they are.
const PIECE_ROWS: usize = 1 << 13;

/// The rows of an episode of `len` rows in pieces of bounded size, for whoever reads or writes all of it. At least one row
/// is in each, and one piece is in all but the longest episodes.
pub fn pieces(schema: &Schema, len: usize) -> impl Iterator<Item = Range<usize>> + use<> {
    let rows = (PIECE_BYTES / row_bytes(schema.fields()).max(1)).clamp(1, PIECE_ROWS);
    (0..len).step_by(rows).map(move |first| first..len.min(first + rows))
}

/// Bytes of a row in memory; texts are guessed.
pub(crate) fn row_bytes(fields: &[Field]) -> usize {
    let bytes = |field: &Field| match field.dtype {
        Dtype::Bool | Dtype::U8 => 1,
        Dtype::I32 | Dtype::F32 => 4,
        Dtype::I64 | Dtype::F64 => 8,
        Dtype::Str => TEXT_BYTES,
    };
    fields.iter().map(|field| bytes(field) * field.width()).sum()
}

/// The column that has the name, type and shape of `wanted`.
fn find_column(about: &About, wanted: &Field) -> Result<usize, DataError> {
    let Contents { schema, .. } = &about.contents;
    let refused = |reason| DataError::request(&about.path, reason);
    let column = schema.require(&wanted.name).map_err(|error| refused(error.to_string()))?;
    let stored = &schema.fields()[column];
    if stored.dtype != wanted.dtype || stored.shape != wanted.shape {
        return Err(refused(format!(
            "column `{}` holds {} {:?}, not {} {:?}",
            wanted.name, stored.dtype, stored.shape, wanted.dtype, wanted.shape
        )));
    }
    Ok(column)
}
