//! Where recorded episodes go: sinks, and the way into one.

use std::collections::BTreeMap;
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

    /// Whether the dataset holds a column already; the writer that has it open answers, and a sink around one passes that on. A
    /// factor of variation that it holds is recorded even where a run does not vary it, so that the run can be appended.
    fn holds(&self, column: &str) -> bool;

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

/// Where whole episodes go: into a sink at once, or into a queue before one. They may come in any order.
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
    fn write(&mut self, episode: u64, rows: EncodedBatch) -> Result<(), BoxError>;

    /// As [`EpisodeSink::finish`], after the last episode is written.
    fn finish(&mut self) -> Result<(), BoxError>;

    /// The same output, for another environment that is on a thread of its own; `None`: there is one way in only. Where episodes
    /// wait for one before them, this way in does not.
    fn part(&self) -> Option<Box<dyn Output + '_>> {
        None
    }

    /// Whether there is room for another episode.
    fn has_room(&self) -> bool {
        true
    }
}

/// Whole episodes on their way to a sink: those behind one that is not complete wait for it.
#[derive(Default)]
pub(super) struct InOrder {
    next: u64,
    waiting: BTreeMap<u64, EncodedBatch>,
    bytes: usize,
}

impl InOrder {
    pub(super) fn from(next: u64) -> Self {
        Self { next, ..Self::default() }
    }

    pub(super) fn put(&mut self, episode: u64, rows: EncodedBatch) {
        self.bytes += rows.bytes();
        self.waiting.insert(episode, rows);
    }

    /// The next episode, if it is complete.
    pub(super) fn take(&mut self) -> Option<EncodedBatch> {
        let rows = self.waiting.remove(&self.next)?;
        self.next += 1;
        self.bytes -= rows.bytes();
        Some(rows)
    }

    pub(super) fn has_next(&self) -> bool {
        self.waiting.contains_key(&self.next)
    }

    /// How many wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// How much memory they take.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }
}

/// Writes every episode before the next step.
pub(super) struct DirectOutput<'a> {
    sink: &'a mut dyn EpisodeSink,
    order: InOrder,
    spare: Vec<EncodedBatch>,
}

impl<'a> DirectOutput<'a> {
    pub(super) fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        Self { sink, order: InOrder::default(), spare: Vec::new() }
    }
}

impl Output for DirectOutput<'_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        let held = self.sink.begin(schema, metadata)?;
        self.order = InOrder::from(held);
        Ok(held)
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

    fn write(&mut self, episode: u64, rows: EncodedBatch) -> Result<(), BoxError> {
        self.order.put(episode, rows);
        while let Some(rows) = self.order.take() {
            self.sink.write_encoded_episode(&rows)?;
            self.spare.push(rows);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.sink.finish()
    }
}
