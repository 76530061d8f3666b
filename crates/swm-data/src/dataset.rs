//! What every format offers beyond the core's `EpisodeSink` and [`Dataset`]: write modes and options, episodes in pieces,
//! and what readers share.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSink, Field, Schema, Slice, SliceMut};

pub use swm_core::dataset::{
    Dataset, DatasetInfo, EncodedBatch, EncodedRow, EncodedRows, Origin, RowEncoder, Steps,
};

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

    /// How it stores a column of those that were committed, as [`Dataset::encoding`] says it of open datasets.
    fn encoding(&self, _column: usize) -> Option<&str> {
        None
    }

    /// Rows per second that it took, after `begin`, because neither [`WriteOptions::frames_per_second`] nor the record has a rate
    /// and its format needs one. `None`: it assumed none.
    fn assumed_rate(&self) -> Option<f64> {
        None
    }

    /// As [`DatasetWriter::write_rows`], where some columns are given as they are stored.
    ///
    /// # Errors
    ///
    /// As of [`DatasetWriter::write_rows`]; a column is given that has no [`DatasetWriter::encoding`].
    fn write_encoded_rows(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        match rows.encoded[..] {
            [] => self.write_rows(&rows.plain),
            _ => Err("this format takes no rows as they are stored".into()),
        }
    }

    /// Ends the open episode. When it returns, the episode is safe: a crash cannot lose it.
    ///
    /// # Errors
    ///
    /// As of [`DatasetWriter::write_rows`].
    fn end_episode(&mut self) -> Result<(), BoxError>;
}

/// How a dataset is written.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct WriteOptions {
    /// What to do about a dataset that exists.
    pub mode: WriteMode,
    /// Quality of images from 1 to 100, in formats that lose some: JPEG's own scale; for videos, 1 is the quantizer 51,
    /// 100 the quantizer 12. Default: 95 for JPEG, 85 for videos.
    pub quality: Option<u8>,
    /// Frames from one key frame of a video to the next. Default: 10. More is smaller, and slower to read at random.
    pub key_frame_period: Option<u32>,
    /// Rows per second of time stamps, and frames per second that a video tells its players. Default: those of the environment's time
    /// for time stamps, where they are known; else 10 in MCAP, and 25 in videos and LeRobot.
    pub frames_per_second: Option<f64>,
    /// What becomes of the last row of an episode where it has no action, in formats that may leave it out of their tables. Default: it
    /// is dropped there.
    pub last_row: Option<LastRow>,
}

/// What becomes of the row of an episode that no action follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LastRow {
    /// It is beside the tables that other programs read, so that these have an action in every row.
    Drop,
    /// It is a row of the tables, and its action is NaN.
    Keep,
}

impl LastRow {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 2] = [("drop", Self::Drop), ("keep", Self::Keep)];
}

by_name!(LastRow, "no value", "drop or keep");

setters!(WriteOptions {
    mode: WriteMode,
    quality: Option<u8>,
    key_frame_period: Option<u32>,
    frames_per_second: Option<f64>,
    last_row: Option<LastRow>,
});

impl From<WriteMode> for WriteOptions {
    fn from(mode: WriteMode) -> Self {
        Self { mode, ..Self::default() }
    }
}

/// What to do about a file that exists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
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
#[must_use]
pub fn row_bytes(fields: &[Field]) -> usize {
    fields.iter().map(|field| field.dtype.bytes().unwrap_or(TEXT_BYTES) * field.dim()).sum()
}
