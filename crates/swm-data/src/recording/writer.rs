//! The writer of a recording: every call has the recording for itself.

use std::fmt;
use std::path::Path;
use std::sync::{Arc, Mutex, Weak};

use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSink, Metadata, Schema};

use super::end::{self, End, locked};
use super::{Backend, Recording};
use crate::dataset::{DatasetWriter, EncodedBatch, RowEncoder, WriteOptions};
use crate::error::DataError;

/// The [`DatasetWriter`] over a [`Backend`].
pub struct BackendWriter<S: Backend> {
    recording: Arc<Mutex<Recording<S>>>,
    /// How columns are stored, since `begin`.
    encodings: Vec<Option<String>>,
}

impl<S: Backend> BackendWriter<S> {
    /// Takes the dataset at `path` for itself. Nothing of it is changed before `begin`.
    ///
    /// # Errors
    ///
    /// Something is there that the mode does not allow for or that is no dataset, another writer has it, or it cannot
    /// be opened.
    pub fn new(path: &Path, options: &WriteOptions, backend: S) -> Result<Self, DataError> {
        let recording = Arc::new(Mutex::new(Recording::new(path, options, backend)?));
        let shared: Weak<Mutex<Recording<S>>> = Arc::downgrade(&recording);
        let shared: Weak<Mutex<dyn End>> = shared;
        end::register(shared);
        Ok(Self { recording, encodings: Vec::new() })
    }
}

impl<S: Backend> EpisodeSink for BackendWriter<S> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        let mut recording = locked(&self.recording);
        let episodes = recording.begin(schema, metadata)?;
        let columns = 0..schema.fields().len();
        self.encodings = columns.map(|column| recording.encoding(column).map(str::to_owned)).collect();
        Ok(episodes)
    }

    fn holds(&self, column: &str) -> bool {
        locked(&self.recording).holds(column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        locked(&self.recording).write_episode(rows)
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        locked(&self.recording).row_encoder(column)
    }

    fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        locked(&self.recording).write_encoded_episode(rows)
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        locked(&self.recording).finish()
    }
}

impl<S: Backend> DatasetWriter for BackendWriter<S> {
    fn num_episodes(&self) -> u64 {
        locked(&self.recording).num_episodes()
    }

    fn write_rows(&mut self, rows: &Batch) -> Result<(), BoxError> {
        locked(&self.recording).write_rows(rows)
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        self.encodings.get(column)?.as_deref()
    }

    fn assumed_rate(&self) -> Option<f64> {
        locked(&self.recording).assumed_rate()
    }

    fn write_encoded_rows(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        locked(&self.recording).write_encoded_rows(rows)
    }

    fn end_episode(&mut self) -> Result<(), BoxError> {
        locked(&self.recording).end_episode()
    }
}

impl<S: Backend> Drop for BackendWriter<S> {
    fn drop(&mut self) {
        locked(&self.recording).end();
    }
}

impl<S: Backend> fmt::Debug for BackendWriter<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Recording { path, episodes, open, .. } = &*locked(&self.recording);
        f.debug_struct("BackendWriter")
            .field("path", path)
            .field("episodes", episodes)
            .field("open", open)
            .finish()
    }
}
