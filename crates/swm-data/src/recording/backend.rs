//! What a format adds to a recording: how rows are stored, and the open files that are written.

use std::path::Path;
use std::sync::Arc;

use swm_core::{Batch, Field, Metadata, Schema};

use crate::dataset::{Dataset, EncodedBatch, RowEncoder, WriteOptions};
use crate::error::{DataError, Result, unsupported};

/// How a format stores datasets.
pub trait Backend: Send + 'static {
    /// An open recording.
    type Session: Session;

    /// The format's name.
    fn name(&self) -> &'static str;

    /// Whether a dataset is a folder; else it is a file.
    fn is_folder(&self) -> bool;

    /// Whether nothing is there yet that could be continued or replaced.
    ///
    /// # Errors
    ///
    /// What is there cannot be looked at.
    fn is_new(&self, path: &Path) -> Result<bool, DataError> {
        Ok(!path.exists())
    }

    /// Whether what is there is a dataset in this format, whole or damaged: nothing else is continued or replaced.
    fn is_dataset(&self, _path: &Path) -> bool {
        true
    }

    /// Opens what is there.
    ///
    /// # Errors
    ///
    /// What is there is no dataset of this format, or is damaged.
    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError>;

    /// Why it cannot hold a column of this name, to complete "`name` cannot name a column: …".
    fn refuses(&self, name: &str) -> Option<&'static str>;

    /// Removes a dataset that a recording made and that holds no episode, so that nothing is left of a recording that failed before its
    /// first one. A file: [`remove_file`](super::remove_file). A folder: the dataset's files; what else is in it stays, and so does the
    /// folder itself, which [`BackendWriter`](super::BackendWriter) removes where it made it.
    ///
    /// # Errors
    ///
    /// It cannot be removed.
    fn remove(&self, path: &Path) -> Result<(), DataError>;

    /// Makes, continues or replaces a dataset.
    ///
    /// # Errors
    ///
    /// It cannot be made, or what is there does not fit.
    fn start(&self, start: &SessionStart<'_>) -> Result<Self::Session, DataError>;
}

/// [`Backend::remove`] of a format whose datasets are files.
///
/// # Errors
///
/// The file cannot be removed.
pub fn remove_file(path: &Path) -> Result<(), DataError> {
    std::fs::remove_file(path).map_err(|source| DataError::io(path, "remove", source))
}

/// What a recording begins with.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct SessionStart<'a> {
    /// The file or folder.
    pub path: &'a Path,
    /// How it is written.
    pub options: &'a WriteOptions,
    /// What is at the path.
    pub existing: Existing,
    /// The columns of the tables that will come.
    pub schema: &'a Arc<Schema>,
    /// Those of them that are to be stored: all but [`EP_IDX`](super::EP_IDX).
    pub fields: &'a [Field],
    /// What is known of the new episodes.
    pub metadata: &'a Metadata,
    /// The episodes that are there, and stay.
    pub episodes: u64,
}

/// What a recording finds at its path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// No dataset.
    None,
    /// One that is to be continued.
    Continued,
    /// One that is to be replaced.
    Replaced,
}

/// The open files of a dataset that is being recorded.
pub trait Session: Send {
    /// Appends rows to the open episode.
    ///
    /// # Errors
    ///
    /// What failed, and in which column; the recording takes no more after it.
    fn append(&mut self, at: StepIndex, rows: &Batch) -> Result<()>;

    /// How a column is stored, by its position in the schema: see [`Dataset::encoding`].
    fn encoding(&self, _column: usize) -> Option<&str> {
        None
    }

    /// Rows per second that it assumed: see [`crate::DatasetWriter::assumed_rate`].
    fn assumed_rate(&self) -> Option<f64> {
        None
    }

    /// What encodes the rows of a column, by its position in the schema, as [`Session::append`] would: see
    /// [`EpisodeSink::row_encoder`](swm_core::EpisodeSink::row_encoder).
    fn row_encoder(&self, _column: usize) -> Option<Box<dyn RowEncoder>> {
        None
    }

    /// As [`Session::append`], with some columns as they are stored: those that have an [`Session::encoding`].
    ///
    /// # Errors
    ///
    /// As of [`Session::append`].
    fn append_encoded(&mut self, _at: StepIndex, _rows: &EncodedBatch) -> Result<()> {
        Err(unsupported("this format takes no rows as they are stored"))
    }

    /// Commits the open episode, which ends at `end`: when this returns, no kill can lose it.
    ///
    /// # Errors
    ///
    /// As of [`Session::append`].
    fn commit(&mut self, end: StepIndex) -> Result<()>;

    /// Brings everything that was committed from the system's memory to the disk, where a loss of power does not reach it.
    /// Called from time to time, for it takes long, and before [`Session::close`].
    ///
    /// # Errors
    ///
    /// As of [`Session::append`].
    fn sync(&mut self) -> Result<()> {
        Ok(())
    }

    /// Ends the recording. No episode is open.
    ///
    /// # Errors
    ///
    /// As of [`Session::append`].
    fn close(self) -> Result<()>;

    /// Ends the recording amid an episode, of which nothing may be seen. As a kill would, if nothing better is known.
    fn cancel(self)
    where
        Self: Sized,
    {
        self.abandon();
    }

    /// Leaves everything as a kill would: after an error.
    fn abandon(self)
    where
        Self: Sized,
    {
    }
}

/// A step of the open episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct StepIndex {
    /// The episode's number.
    pub episode: i32,
    /// The step of the episode.
    pub step: usize,
}
