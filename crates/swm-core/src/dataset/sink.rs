//! Where recorded episodes go: sinks, and the way into one.

use std::sync::Arc;

use super::{EncodedBatch, Metadata, RowEncoder};
use crate::batch::{Batch, Schema};
use crate::error::BoxError;

/// Takes whole episodes, in the order of their index.
pub trait EpisodeSink: Send {
    /// Called once, before the first episode: the columns (kind tells step from episode columns) and what is
    /// known of the data. Returns how many episodes the dataset holds already.
    ///
    /// # Errors
    ///
    /// What is there has other columns or settings, or cannot be written.
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError>;

    /// Whether the dataset holds a column already. A factor of variation that it holds is recorded even where a run does
    /// not vary it, so that the run can be appended.
    fn holds(&self, _column: &str) -> bool {
        false
    }

    /// Appends one episode; row = step. When it returns, the episode is safe: a crash cannot lose it.
    ///
    /// # Errors
    ///
    /// The rows have other columns than were committed, or cannot be written. The episode is then not part of the
    /// dataset.
    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError>;

    /// What encodes the rows of a column, by its position in the schema of [`EpisodeSink::begin`], as they are made; `None`: the sink takes
    /// values. Asked for once for every episode that may be open at a time.
    fn row_encoder(&self, _column: usize) -> Option<Box<dyn RowEncoder>> {
        None
    }

    /// As [`EpisodeSink::write_episode`], where the columns that have a [`EpisodeSink::row_encoder`] come as it encodes them.
    ///
    /// # Errors
    ///
    /// As of [`EpisodeSink::write_episode`].
    fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        match rows.encoded[..] {
            [] => self.write_episode(&rows.plain),
            _ => Err("this dataset takes no rows as they are stored".into()),
        }
    }

    /// Ends the dataset cleanly.
    ///
    /// # Errors
    ///
    /// The rest cannot be written.
    fn finish(&mut self) -> Result<(), BoxError>;
}

/// Where whole episodes go: into a sink at once, or into a queue before one.
pub(super) trait Output: Send {
    /// As [`EpisodeSink::begin`].
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError>;

    /// As [`EpisodeSink::holds`].
    fn holds(&self, column: &str) -> bool;

    /// As [`EpisodeSink::row_encoder`].
    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>>;

    /// Rows of an episode that was written, to be filled again.
    fn spare(&mut self) -> Option<EncodedBatch>;

    /// Takes an episode. Errors may be those of an earlier one.
    fn write(&mut self, rows: EncodedBatch) -> Result<(), BoxError>;

    /// As [`EpisodeSink::finish`], after the last episode is written.
    fn finish(&mut self) -> Result<(), BoxError>;
}

/// Writes every episode before the next step.
pub(super) struct AtOnce<'a> {
    sink: &'a mut dyn EpisodeSink,
    spare: Vec<EncodedBatch>,
}

impl<'a> AtOnce<'a> {
    pub(super) fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        Self { sink, spare: Vec::new() }
    }
}

impl Output for AtOnce<'_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        self.sink.begin(schema, metadata)
    }

    fn holds(&self, column: &str) -> bool {
        self.sink.holds(column)
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        self.sink.row_encoder(column)
    }

    fn spare(&mut self) -> Option<EncodedBatch> {
        self.spare.pop()
    }

    fn write(&mut self, rows: EncodedBatch) -> Result<(), BoxError> {
        self.sink.write_encoded_episode(&rows)?;
        self.spare.push(rows);
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.sink.finish()
    }
}
