//! The dataset that a recording is written to: which recording it continues, and how far it is.

use std::path::Path;
use std::sync::Arc;

use serde_json::Value as Json;
use swm_core::dataset::{EncodedBatch, RowEncoder};
use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeEnd, EpisodeSink, LiveStep, Metadata, Recorder, RecordingPart, Schema};
use swm_data::DatasetWriter;
use swm_data::tools::parts::other_recording;

use super::super::Progress;
use super::{Assignment, Fix, Message};

/// Counts the rows and successes of a recording.
#[derive(Clone, Copy, Debug, Default)]
pub struct Count {
    rows: u64,
    judged: u64,
    successes: u64,
}

impl Count {
    pub(super) fn rows(&self) -> u64 {
        self.rows
    }

    /// In %.
    pub(super) fn success_rate(&self) -> Option<f64> {
        (self.judged > 0).then(|| 100.0 * self.successes as f64 / self.judged as f64)
    }
}

impl Recorder for Count {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        self.rows += 1;
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.judged += u64::from(end.success.is_some());
        self.successes += u64::from(end.success == Some(true));
        Ok(())
    }
}

/// What a recording continues.
pub(super) struct Continued {
    /// The run that it follows in the file.
    pub(super) run: Option<Metadata>,
    /// Whether it must be of the same recording; else a note has what differs.
    pub(super) must_continue: bool,
    /// Which part of a divided recording it is.
    pub(super) part: Option<RecordingPart>,
    /// Episodes of other parts, before this one's.
    pub(super) offset: u64,
}

/// The writer of a dataset, with reports of committed episodes.
pub(super) struct Sink<'a> {
    writer: &'a mut dyn DatasetWriter,
    path: &'a Path,
    continued: Continued,
    progress: Box<dyn Progress>,
    /// The index of the next episode.
    next: u64,
    refused: Option<Message>,
    note: Option<Message>,
}

impl<'a> Sink<'a> {
    pub(super) fn new(
        writer: &'a mut dyn DatasetWriter,
        path: &'a Path,
        continued: Continued,
        progress: Box<dyn Progress>,
    ) -> Self {
        Self { writer, path, continued, progress, next: 0, refused: None, note: None }
    }

    /// Why the recording does not continue that of the file, though it must, and a note where it is another one.
    pub(super) fn into_messages(self) -> (Option<Message>, Option<Message>) {
        (self.refused, self.note)
    }

    fn committed(&mut self, rows: usize) {
        self.progress.written(self.next, rows);
        self.next += 1;
    }
}

impl EpisodeSink for Sink<'_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        let Continued { run, must_continue, part, offset } = &self.continued;
        let metadata = Metadata { part: *part, ..metadata.clone() };
        let differs = run.as_ref().and_then(|run| other_recording(run, &metadata));
        let path = self.path.display();
        if let Some(reason) = differs.as_ref().filter(|_| *must_continue) {
            let mix = Assignment::of("mix", Json::Bool(true));
            let refused = Message::new(format!("{path}: {reason}"))
                .fix(Fix::Set { setting: mix, to: "to append all the same" });
            let reason = refused.to_string();
            self.refused = Some(refused);
            return Err(reason.into());
        }
        let held = self.writer.begin(schema, &metadata)?;
        // The format may refuse it, too: then nothing is appended.
        if let Some(reason) = differs {
            let text = format!("{path}: these episodes were appended to it, though {reason}");
            self.note = Some(Message::new(text));
        }
        self.next = offset + held;
        Ok(self.next)
    }

    fn holds(&self, column: &str) -> bool {
        self.writer.holds(column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.writer.write_episode(rows)?;
        self.committed(rows.rows());
        Ok(())
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        self.writer.row_encoder(column)
    }

    fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        self.writer.write_encoded_episode(rows)?;
        self.committed(rows.rows());
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.writer.finish()
    }
}
